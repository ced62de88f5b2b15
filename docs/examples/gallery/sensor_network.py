#!/usr/bin/env python3
"""Sensors that measure how far their neighbours are: where each one is, and how far it may be off."""

import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

# %% Fifty sensors in a field of 100 m. Each measures the distances to its neighbours up to 30 m away, with a standard deviation of
# 2 m; eight know their positions, to 0.1 m.
random = np.random.default_rng(5)
true = random.uniform(0, 100, (50, 2))
between = np.linalg.norm(true[:, None] - true, axis=2)
measured = np.triu(between + random.normal(scale=2.0, size=between.shape), 1)
measured = np.where(between < 30, np.abs(measured + measured.T), np.nan)
anchors = np.full(true.shape, np.nan)
anchors[:8] = true[:8]

# %% Weights are 1 / variance, so that the stress is twice the negative logarithm of the likelihood.
result = asterism.mds(measured, weights=np.full(between.shape, 1 / 2.0**2), anchors=anchors, anchor_weights=1 / 0.1**2)
covariances = asterism.node_covariances(result.system, result.x)
error = np.linalg.norm(result.x - true, axis=1)
print(f"{result.system.link_count} distances: off by {np.median(error[8:]):.2f} m (median)")

# %% Each ellipse contains its sensor with a probability of 95 %.
figure, axes = plt.subplots(figsize=(6, 6), layout="constrained")
for i, j in result.system.topology.links:
    axes.plot(*result.x[[i, j]].T, color="0.85", linewidth=0.7, zorder=0)
for place, covariance in zip(result.x, covariances):
    variances, directions = np.linalg.eigh(covariance)
    width, height = 2 * np.sqrt(5.99 * variances)
    angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
    axes.add_patch(Ellipse(place, width, height, angle=angle, color="tab:blue", alpha=0.3))
axes.plot(*true.T, "x", color="tab:red", label="true")
axes.plot(*result.x.T, ".", color="tab:blue", label="found")
axes.plot(*true[:8].T, "s", color="black", label="known")
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes.legend(loc="upper right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "sensor_network.png", dpi=80)
