#!/usr/bin/env python3
"""Where a receiver is, from its distances to four beacons: two minima, and a proof which of them is the lower."""

import sys

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

# %% The beacons are nearly on a line, so a place and its mirror image have nearly the same distances to them.
random = np.random.default_rng(4)
beacons = np.array([[0.0, 0], [30, 8], [65, -6], [100, 4]])
true = np.array([55.0, 40])
deviation = 2.0  # of a measured distance [m]
measured = np.linalg.norm(beacons - true, axis=1) + random.normal(scale=deviation, size=4)
system = asterism.SpringSystem(asterism.Topology.from_links(5, [(beacon, 4) for beacon in range(4)]))
system.anchors, system.anchor_stiffness = 0, 0
system.rest_length, system.link_stiffness = measured, 1 / deviation**2
for beacon in range(4):
    system.fix(beacon)

# %% Newton's method ends in the minimum on the side where it starts; branch and bound proves which one is the lowest.
start = np.vstack([beacons, [40.0, -30]])
ends = {}
for method in ("newton", "branch-and-bound"):
    x = start.copy()
    summary = asterism.solve(system, x, method)
    ends[method] = x[4]
    proof = f", least energy at least {summary.lower_bound:.4f}: {summary.message}" if summary.lower_bound >= 0 else ""
    print(f"{method}: energy {summary.final_energy:.4f}, off by {np.linalg.norm(x[4] - true):.1f} m{proof}")

# %% The energy of every place of the receiver.
east, north = np.meshgrid(np.linspace(-10, 110, 160), np.linspace(-70, 70, 160))
r = np.hypot(east[..., None] - beacons[:, 0], north[..., None] - beacons[:, 1])
energy = ((r - measured) ** 2).sum(axis=-1) / (2 * deviation**2)
figure, axes = plt.subplots(figsize=(7, 5.5), layout="constrained")
axes.contourf(east, north, np.log10(energy), 25, cmap="viridis_r")
axes.plot(*beacons.T, "^", color="white", markeredgecolor="black", markersize=10, label="beacons")
axes.plot(*true, "x", color="tab:red", markersize=10, markeredgewidth=2, label="true")
axes.plot(*ends["newton"], "o", color="tab:orange", label="Newton's method")
axes.plot(*ends["branch-and-bound"], "o", color="white", label="proven")
axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes.legend(loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "beacons.png", dpi=80)
