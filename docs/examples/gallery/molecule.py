#!/usr/bin/env python3
"""A molecule from the distances of near atoms: C60, as an experiment that sees only short distances would have it."""

import itertools
import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% The atoms of C60 are the corners of a truncated icosahedron with bonds of 1.44 angstroms.
golden = (1 + 5**0.5) / 2
corners = []
for base in ((0, 1, 3 * golden), (1, 2 + golden, 2 * golden), (golden, 2, 2 * golden + 1)):
    for signs in itertools.product(*[(1, -1) if value else (1,) for value in base]):
        signed = np.multiply(base, signs)
        corners += [np.roll(signed, shift) for shift in range(3)]
atoms = 0.72 * np.array(corners)
exact = np.linalg.norm(atoms[:, None] - atoms, axis=2)

# %% Only distances below 4 angstroms are measured, with errors of 2 %.
random = np.random.default_rng(3)
measured = np.triu(exact < 4, 1)
distances = np.where(measured, exact * random.normal(1, 0.02, exact.shape), np.nan)
distances = np.fmax(distances, distances.T)
result = asterism.mds(distances, dim=3)

# %% Turned, and mirrored if need be, onto the true places.
u, _, v = np.linalg.svd(result.x.T @ atoms)
found = (result.x - result.x.mean(axis=0)) @ u @ v
error = np.linalg.norm(found - atoms, axis=1)
print(f"{measured.sum()} of {60 * 59 // 2} distances; an atom is off by {np.sqrt(np.mean(error**2)):.2f} angstroms (root mean square)")

figure = plt.figure(figsize=(9, 4.2), layout="constrained")
for place, (title, points) in enumerate((("true", atoms), ("from 2 % of error in near distances", found)), 1):
    axes = figure.add_subplot(1, 2, place, projection="3d")
    for i, j in zip(*np.nonzero(np.triu(exact < 1.6, 1))):
        depth = (points[i, 1] + points[j, 1]) / 2
        axes.plot(*points[[i, j]].T, color=plt.cm.viridis(np.clip(0.5 - depth / 9, 0, 1)), linewidth=2)
    axes.set(title=title, xlim=(-3.6, 3.6), ylim=(-3.6, 3.6), zlim=(-3.6, 3.6))
    axes.set_axis_off()
    axes.set_box_aspect((1, 1, 1), zoom=1.4)
    axes.view_init(elev=12, azim=-90)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "molecule.png", dpi=80)
