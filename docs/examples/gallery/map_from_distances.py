#!/usr/bin/env python3
"""A map from distances alone: multidimensional scaling of cities, half of them unknown."""

import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% Great-circle distances, known to about 3 %; half of them are unknown.
cities = {  # latitude, longitude [degrees]
    "Lisbon": (38.7, -9.1), "Madrid": (40.4, -3.7), "Barcelona": (41.4, 2.2), "Paris": (48.9, 2.4), "London": (51.5, -0.1),
    "Dublin": (53.3, -6.3), "Brussels": (50.8, 4.4), "Berlin": (52.5, 13.4), "Prague": (50.1, 14.4), "Vienna": (48.2, 16.4),
    "Ljubljana": (46.1, 14.5), "Rome": (41.9, 12.5), "Athens": (38.0, 23.7), "Warsaw": (52.2, 21.0), "Stockholm": (59.3, 18.1),
    "Oslo": (59.9, 10.8), "Copenhagen": (55.7, 12.6), "Helsinki": (60.2, 24.9), "Budapest": (47.5, 19.0), "Bucharest": (44.4, 26.1),
}  # fmt: skip
latitude, longitude = np.radians(list(cities.values())).T
on_sphere = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=1)
exact = 6371 * np.arccos(np.clip(on_sphere @ on_sphere.T, -1, 1))  # [km]

random = np.random.default_rng(1)
known = np.triu(random.random(exact.shape) < 0.5, 1)
distances = np.where(known, exact * random.normal(1, 0.03, exact.shape), np.nan)
distances = np.fmax(distances, distances.T)

# %% The places of three cities are known; all others are found.
flat = 6371 * np.stack([longitude * np.cos(np.radians(49)), latitude], axis=1)
flat -= flat.mean(axis=0)
anchors = np.full(flat.shape, np.nan)
pinned = [list(cities).index(name) for name in ("Lisbon", "Athens", "Oslo")]
anchors[pinned] = flat[pinned]
result = asterism.mds(distances, weights=1 / np.fmax(exact, 1) ** 2, anchors=anchors, anchor_weights=np.inf)
error = np.linalg.norm(result.x - flat, axis=1)
print(f"{np.triu(known).sum()} of {len(cities) * (len(cities) - 1) // 2} distances; a city is off by {np.median(error):.0f} km (median)")

# %% The places found, and those on a flat map.
figure, axes = plt.subplots(figsize=(6, 6), layout="constrained")
for i, j in result.system.topology.links:
    axes.plot(*result.x[[i, j]].T, color="0.85", linewidth=0.7, zorder=0)
for found, true in zip(result.x, flat):
    axes.plot(*np.stack([found, true]).T, color="tab:red", linewidth=1, zorder=1)
axes.plot(*flat.T, "x", color="tab:red", label="on a map")
axes.plot(*result.x.T, "o", color="tab:blue", markersize=4, label="from distances")
axes.plot(*result.x[pinned].T, "s", color="black", markersize=6, label="held")
for name, place in zip(cities, result.x):
    axes.annotate(name, place, xytext=(4, 4), textcoords="offset points", fontsize=8)
axes.set(aspect="equal", xlabel="east [km]", ylabel="north [km]")
axes.legend(loc="upper left")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "map_from_distances.png", dpi=80)
