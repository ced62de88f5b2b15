#!/usr/bin/env python3
"""A directed graph with a label in each node: labels do not overlap, arrows point down, and groups stay together."""

import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

# %% From a clone to a release: which step needs which one.
arrows = [
    ("clone", "configure"), ("install packages", "configure"), ("configure", "solver"), ("solver", "parts"), ("parts", "trackers"),
    ("solver", "Python module"), ("trackers", "Python module"), ("solver", "unit tests"), ("parts", "unit tests"), ("trackers", "unit tests"),
    ("Python module", "Python tests"), ("clone", "check pages"), ("clone", "check format"), ("Python module", "run examples"),
    ("trackers", "sanitizers"), ("clone", "read changelog"), ("trackers", "benchmarks"), ("benchmarks", "compare figures"),
    ("unit tests", "release"), ("Python tests", "release"), ("check pages", "release"), ("check format", "release"),
    ("run examples", "release"), ("sanitizers", "release"), ("read changelog", "release"), ("compare figures", "release"),
]  # fmt: skip
groups = {
    "compile": ["solver", "parts", "trackers", "Python module"],
    "test": ["unit tests", "Python tests", "sanitizers", "run examples"],
    "read": ["check pages", "check format", "read changelog"],
}
names = list(dict.fromkeys(name for arrow in arrows for name in arrow))
sizes = np.array([(0.13 * len(name) + 0.2, 0.4) for name in names])
edges = [(a, b, 1.5) for a, b in arrows]  # in units of the sizes
free = asterism.layout(edges)
ruled = asterism.layout(edges, sizes=sizes + 0.2, downward=0.8, groups=groups.values())  # with a margin around each label

# %% Both drawings.
figure, panels = plt.subplots(1, 2, figsize=(13, 6.5), layout="constrained")
for axes, title, drawn in zip(panels, ("by distances alone", "with rules"), (free, ruled)):
    for a, b in arrows:
        axes.annotate("", drawn.pos[b], drawn.pos[a], arrowprops={"arrowstyle": "->", "color": "tab:blue", "shrinkA": 9, "shrinkB": 9})
    for name, place, size in zip(names, drawn.x, sizes):
        axes.add_patch(Rectangle(place - size / 2, *size, facecolor="white", edgecolor="tab:orange", zorder=2))
        axes.text(*place, name, ha="center", va="center", fontsize=8, zorder=3)
    for members in groups.values() if drawn is ruled else ():
        inside = [names.index(name) for name in members]
        low, high = (drawn.x[inside] - sizes[inside] / 2).min(axis=0) - 0.1, (drawn.x[inside] + sizes[inside] / 2).max(axis=0) + 0.1
        axes.add_patch(Rectangle(low, *(high - low), facecolor="0.92", edgecolor="0.7", zorder=0))
    axes.set_title(title, fontsize=10)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
for title, drawn in (("by distances alone", free), ("with rules", ruled)):
    gaps = np.abs(drawn.x[:, None] - drawn.x) - (sizes[:, None] + sizes) / 2
    overlaps = (int((gaps < 0).all(axis=2).sum()) - len(names)) // 2
    down = sum(drawn.pos[a][1] > drawn.pos[b][1] for a, b in arrows)
    print(f"{title}: {overlaps} pairs of labels overlap, {down} of {len(arrows)} arrows point down")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "labels.png", dpi=70)
