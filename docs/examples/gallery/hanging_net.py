#!/usr/bin/env python3
"""A net that hangs from four points: springs in space, under a weight that grows."""

import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% A square net of springs, 1 m wide, held at its corners.
size = 15
grid = np.stack([*np.meshgrid(*2 * [np.linspace(0, 1, size)], indexing="ij"), np.zeros((size, size))], axis=-1).reshape(-1, 3)
number = np.arange(size * size).reshape(size, size)
links = [*zip(number[:, :-1].ravel(), number[:, 1:].ravel()), *zip(number[:-1].ravel(), number[1:].ravel())]
net = asterism.SpringSystem(asterism.Topology.from_links(size * size, links), dim=3)
net.set_rest_lengths(grid)
net.link_stiffness = 1000  # [N/m]
for corner in number[[0, 0, -1, -1], [0, -1, 0, -1]]:
    net.fix(int(corner))

# %% Nothing but the corners and the threads holds the knots, which have a weight.
net.anchors, net.anchor_stiffness = grid, 0
x = grid + np.random.default_rng(1).normal(scale=1e-3, size=grid.shape) * [0, 0, 1]
figure = plt.figure(figsize=(9, 3.2), layout="constrained")
for place, weight in enumerate((0.01, 0.1, 1), 1):  # of each knot [N]
    net.loads = np.tile([0, 0, -weight], (size * size, 1))
    summary = asterism.solve(net, x)  # starts from the shape under the previous weight
    stretch = np.linalg.norm(np.diff(x[net.topology.links], axis=1)[:, 0], axis=1) / net.rest_length - 1
    print(f"{weight} N a knot: {summary.solver}, hangs {-x[:, 2].min():.3f} m deep, threads longer by up to {stretch.max():.1%}")
    axes = figure.add_subplot(1, 3, place, projection="3d")
    for link, longer in zip(net.topology.links, stretch):
        axes.plot(*x[link].T, color=plt.cm.viridis(np.clip(longer / 0.3, 0, 1)), linewidth=1)
    axes.set(title=f"{weight} N", zlim=(-0.7, 0.05), zticks=[-0.6, -0.3, 0], xticks=[0, 1], yticks=[0, 1])
    axes.set_box_aspect(None, zoom=0.8)
    axes.view_init(elev=15, azim=-50)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "hanging_net.png", dpi=80)
