#!/usr/bin/env python3
"""A drawing of dependencies in layers: lengths keep nodes apart, and offsets order them."""

import itertools
import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% What each library and program of this project is built on.
needs = {
    "Python module": ["trackers", "batch", "json"],
    "asterism-eval": ["trackers", "json", "dlib"],
    "asterism-bench": ["batch", "ceres", "petsc", "parts", "json", "dlib"],
    "asterism-track": ["trackers"],
    "trackers": ["parts", "solver"],
    "parts": ["OpenCV", "Eigen"],
    "batch": ["solver"],
    "json": ["solver"],
    "ceres": ["solver", "Ceres"],
    "petsc": ["solver", "PETSc"],
    "solver": ["Eigen"],
}
names = sorted({*needs, *itertools.chain(*needs.values())})
arrows = [(names.index(user), names.index(used)) for user, all_used in needs.items() for used in all_used]



def layer(name):
    return 1 + max(map(layer, needs[name])) if name in needs else 0


# %% One link for each pair, as long as the shortest path between the two, and one for each arrow, with the offset of its layers.
count = len(names)
steps = np.full((count, count), np.inf)
np.fill_diagonal(steps, 0)
for i, j in arrows:
    steps[i, j] = steps[j, i] = 1
for k in range(count):
    steps = np.minimum(steps, steps[:, k, None] + steps[k])
pairs = list(itertools.combinations(range(count), 2))
graph = asterism.SpringSystem(asterism.Topology.from_links(count, pairs + arrows))
graph.anchors, graph.anchor_stiffness = 0, 1e-6
lengths = np.array([steps[pair] for pair in pairs])
graph.rest_length = np.concatenate([lengths, np.zeros(len(arrows))])
graph.link_stiffness = np.concatenate([lengths**-2.0, np.ones(len(arrows))])
down = [[0, layer(names[i]) - layer(names[j])] for i, j in arrows]
graph.rest_offset = np.concatenate([np.zeros((len(pairs), 2)), down])

# %% The lowest of many starts.
x = np.random.default_rng(3).normal(size=(count, 2))
summary = asterism.solve(graph, x, "multi-start", starts=50)
points_down = [x[i, 1] > x[j, 1] for i, j in arrows]
print(f"{count} nodes, energy {summary.final_energy:.4g}: {sum(points_down)} of {len(arrows)} arrows point down")
figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
for i, j in arrows:
    axes.annotate("", x[j], x[i], arrowprops={"arrowstyle": "->", "color": "tab:blue", "shrinkA": 14, "shrinkB": 14})
for name, place in zip(names, x):
    axes.text(*place, name, ha="center", va="center", bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": "tab:orange"})
axes.set(xlim=(x[:, 0].min() - 0.5, x[:, 0].max() + 0.5), ylim=(x[:, 1].min() - 0.3, x[:, 1].max() + 0.3))
axes.set_axis_off()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "layers.png", dpi=80)
