#!/usr/bin/env python3
"""Compares IDA with the other methods and with SciPy's: time and accuracy over constellations of several sizes."""

import argparse
import time

import asterism
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy.optimize


def constellation(nodes: int, seed: int) -> tuple[asterism.SpringSystem, np.ndarray]:
    """Nodes at random in a square, all linked, weak anchors, and a start nearby."""
    random = np.random.default_rng(seed)
    points = random.uniform(0, 30 * np.sqrt(nodes), (nodes, 2))
    system = asterism.SpringSystem(asterism.Topology.full(nodes), dim=2)
    system.set_rest_lengths(points)
    system.anchors = points + random.normal(scale=3, size=points.shape)
    system.anchor_stiffness = random.uniform(0.5, 1.5, nodes)
    system.link_stiffness = random.uniform(0.5, 1.5, system.link_count)
    return system, points + random.normal(scale=3, size=points.shape)


def by_asterism(method: str, system: asterism.SpringSystem, start: np.ndarray) -> tuple[np.ndarray, float]:
    x = start.copy()
    summary = asterism.solve(system, x, method, measure_seconds=True)
    return x, summary.seconds


def by_scipy(method: str, system: asterism.SpringSystem, start: np.ndarray) -> tuple[np.ndarray, float]:
    """SciPy's methods, with the library's energy and gradient."""

    def points(flat: np.ndarray) -> np.ndarray:
        return flat.reshape(start.shape)

    begin = time.perf_counter()
    result = scipy.optimize.minimize(
        lambda flat: asterism.energy(system, points(flat)),
        start.ravel(),
        jac=lambda flat: asterism.gradient(system, points(flat)).ravel(),
        method=method,
        options={"maxiter": 10000},
    )
    return points(result.x), time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[4, 9, 16, 36, 64], help="numbers of nodes")
    parser.add_argument("--methods", nargs="+", default=["ida", "newton", "lbfgs", "newton-cg", "ncg"])
    parser.add_argument("--scipy", nargs="*", default=["L-BFGS-B", "BFGS", "CG"], help="methods of SciPy")
    parser.add_argument("--systems", type=int, default=10, help="of each size; the figure shows medians")
    parser.add_argument("--out", default="solvers.png", help="the figure (default: %(default)s)")
    arguments = parser.parse_args()

    contenders = {method: (by_asterism, method) for method in arguments.methods}
    contenders |= {f"SciPy {method}": (by_scipy, method) for method in arguments.scipy}
    figure, (times, accuracies) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    print(f"{'method':16} {'nodes':>6} {'seconds':>10} {'stationarity':>13}")
    for name, (solve, method) in contenders.items():
        medians = []
        for nodes in arguments.sizes:
            outcomes = []
            for seed in range(arguments.systems):
                system, start = constellation(nodes, seed)
                x, seconds = solve(method, system, start)
                outcomes.append((seconds, asterism.stationarity(system, x)))
            medians.append(np.median(outcomes, axis=0))
            print(f"{name:16} {nodes:6} {medians[-1][0]:10.2e} {medians[-1][1]:13.1e}")
        style = {"marker": "o", "linestyle": "--" if solve is by_scipy else "-", "label": name}
        seconds, stationarities = np.transpose(medians)
        times.loglog(arguments.sizes, seconds, **style)
        accuracies.loglog(arguments.sizes, np.maximum(stationarities, 1e-17), **style)
    times.set(xlabel="nodes", ylabel="seconds", title="median time of a solve")
    accuracies.set(xlabel="nodes", ylabel="stationarity (no unit)", title="median distance from a stationary point")
    for axes in (times, accuracies):
        axes.set_xticks(arguments.sizes, [str(size) for size in arguments.sizes])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    accuracies.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    figure.savefig(arguments.out, dpi=120)


if __name__ == "__main__":
    main()
