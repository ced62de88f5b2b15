#!/usr/bin/env python3
"""Scores a solver of your own, here a gradient descent, and two of the library's on the problem set."""

import argparse
import pathlib
from collections.abc import Callable

import asterism
import numpy as np


def gradient_descent(system: asterism.SpringSystem, start: np.ndarray) -> np.ndarray:
    """Steps along the negative gradient, with lengths by Barzilai and Borwein (1988). Put your solver here."""
    x, best = start.copy(), start.copy()
    gradient = asterism.gradient(system, x)
    step = 1e-3 / (np.abs(gradient).max() + 1e-300)
    for _ in range(2000):
        moved = x - step * gradient
        changed = asterism.gradient(system, moved)
        s, y = moved - x, changed - gradient
        x, gradient = moved, changed
        if asterism.energy(system, x) < asterism.energy(system, best):
            best = x.copy()
        if (curvature := np.sum(s * y)) <= 0 or np.abs(gradient).max() < 1e-12:
            break
        step = np.sum(s * s) / curvature
    return best


def by_library(method: str) -> Callable[[asterism.SpringSystem, np.ndarray], np.ndarray]:
    def solver(system: asterism.SpringSystem, start: np.ndarray) -> np.ndarray:
        x = start.copy()
        asterism.solve(system, x, method)
        return x

    return solver


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path, nargs="?", default=pathlib.Path("bench/problems"))
    arguments = parser.parse_args()

    solvers = {"mine": gradient_descent, "ida": by_library("ida"), "staircase": by_library("staircase")}
    files = sorted(arguments.folder.glob("*.jsonl"))
    if not files:
        parser.error(f"{arguments.folder}: no files *.jsonl")
    print(f"{'family':20} {'problems':>8}" + "".join(f"{name:>12}" for name in solvers))
    for file in files:
        problems = asterism.read_systems(file)
        solved = dict.fromkeys(solvers, 0)
        for problem in problems:
            for name, solver in solvers.items():
                energy = asterism.energy(problem.system, solver(problem.system, problem.start))
                solved[name] += energy <= problem.origin["minimum"] * (1 + 1e-6)
        print(f"{file.stem:20} {len(problems):8}" + "".join(f"{count:12}" for count in solved.values()))


if __name__ == "__main__":
    main()
