#!/usr/bin/env python3
"""Drawings of graphs in the plane and in space, by the stress of all pairs of nodes."""

import itertools
import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% Lists of edges.
size = 8
number = np.arange(size * size).reshape(size, size)
grid = [*zip(number[:, :-1].ravel(), number[:, 1:].ravel()), *zip(number[:-1].ravel(), number[1:].ravel())]
tree = [((child - 1) // 3, child) for child in range(1, 121)]  # three children each
ring = [(k, (k + 1) % 16) for k in range(16)] + [(k, k + 8) for k in range(8)]  # a Möbius ladder
corners = list(itertools.product((0, 1), repeat=4))
cube = [(i, j) for i, j in itertools.combinations(range(16), 2) if np.abs(np.subtract(corners[i], corners[j])).sum() == 1]

# %% Each graph is drawn in the dimension that suits it.
figure = plt.figure(figsize=(8, 8), layout="constrained")
for place, (title, edges, dim) in enumerate(
    [("grid", grid, 2), ("tree", tree, 2), ("Möbius ladder", ring, 3), ("cube of four dimensions", cube, 3)], 1
):
    result = asterism.layout(edges, dim)
    axes = figure.add_subplot(2, 2, place, projection="3d" if dim == 3 else None)
    for edge in edges:
        axes.plot(*result.x[list(edge)].T, color="tab:blue", linewidth=1)
    axes.plot(*result.x.T, "o", color="tab:orange", markersize=4)
    axes.set_title(f"{title}: {len(result.x)} nodes, stress {result.stress:.3g}", fontsize=10)
    axes.set_aspect("equal")
    axes.set_axis_off()
    print(f"{title}: {result.summary.solver}, stress {result.stress:.4g}")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "graphs.png", dpi=80)
