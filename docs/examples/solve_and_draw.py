#!/usr/bin/env python3
"""Solves a constellation and draws it: anchors, start and solution, with the nodes' uncertainty."""

import argparse

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse


def constellation(rows: int, columns: int, seed: int) -> tuple[asterism.SpringSystem, np.ndarray]:
    """A grid of parts 30 px apart, observed with noise; one was seen far off, with little certainty."""
    random = np.random.default_rng(seed)
    grid = 30.0 * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    system = asterism.SpringSystem(asterism.Topology.full(len(grid)), dim=2)
    system.set_rest_lengths(grid)
    system.link_stiffness = 0.02
    system.anchors = grid + random.normal(scale=4, size=grid.shape)
    system.anchor_stiffness = 0.04
    system.anchors[-1] += 25, 20
    system.anchor_stiffness[-1] = 0.002
    return system, grid + random.normal(scale=8, size=grid.shape)


def draw(axes: plt.Axes, system: asterism.SpringSystem, start: np.ndarray, x: np.ndarray) -> None:
    for i, j in system.topology.links:
        axes.plot(*x[[i, j]].T, color="tab:blue", alpha=0.25, linewidth=1, zorder=1)
    for anchor, node in zip(system.anchors, x):
        axes.plot(*np.stack([anchor, node]).T, color="tab:orange", linestyle=":", zorder=1)
    axes.plot(*system.anchors.T, "x", color="tab:orange", label="anchors")
    axes.plot(*start.T, ".", color="0.6", label="start")
    axes.plot(*x.T, "o", color="tab:blue", label="solution")
    for node, covariance in zip(x, asterism.node_covariances(system, x)):
        variances, directions = np.linalg.eigh(covariance)
        width, height = 4 * np.sqrt(variances)  # two standard deviations to each side
        angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
        axes.add_patch(Ellipse(node, width, height, angle=angle, color="tab:blue", alpha=0.15))
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.set(xlabel="x [px]", ylabel="y [px]")
    axes.legend()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=3)
    parser.add_argument("--columns", type=int, default=3)
    parser.add_argument("--method", default="auto", choices=asterism.methods())
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="constellation.png", help="the figure (default: %(default)s)")
    arguments = parser.parse_args()

    system, start = constellation(arguments.rows, arguments.columns, arguments.seed)
    x = start.copy()
    summary = asterism.solve(system, x, arguments.method)
    print(summary)
    figure, axes = plt.subplots(figsize=(6, 6), layout="constrained")
    draw(axes, system, start, x)
    axes.set_title(f"{summary.solver}: E = {summary.initial_energy:.3g} → {summary.final_energy:.3g}")
    figure.savefig(arguments.out, dpi=120)


if __name__ == "__main__":
    main()
