#!/usr/bin/env python3
"""What the rules cost by which the method "auto" of asterism.System might choose between "newton" and "newton-cg".

    terms_auto.py [--seeds FIRST LAST] [--largest NODES]

CPU time of each rule relative to the faster of both methods, for systems of several kinds: the geometric mean and the
largest, over the seeds. Choose on some seeds and report on others. Needs the Python module of Asterism.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Callable

import asterism
import numpy as np

Matrix = np.ndarray


def grid_links(width: int, diagonals: bool) -> Matrix:
    number = np.arange(width * width).reshape(width, width)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    if diagonals:
        pairs += [(number[:-1, :-1], number[1:, 1:]), (number[:-1, 1:], number[1:, :-1])]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


def with_links(rng: np.random.Generator, rest: Matrix, links: Matrix, hold: float) -> tuple[asterism.System, Matrix]:
    """Springs of about the lengths in `rest` (nodes x dim), held by anchors, and a start."""
    system = asterism.System(*rest.shape)
    system.add_anchors(rest, hold)
    lengths = np.linalg.norm(rest[links[:, 0]] - rest[links[:, 1]], axis=1)
    system.add_links(links, lengths * np.exp(0.1 * rng.normal(size=len(links))), 1.0)
    return system, rest + 0.3 * rng.normal(size=rest.shape)


def everyone(n: int, dim: int, rng: np.random.Generator) -> tuple[asterism.System, Matrix]:
    return with_links(rng, 3 * rng.normal(size=(n, dim)), np.transpose(np.triu_indices(n, 1)), 0.5)


def cloth(n: int, dim: int, rng: np.random.Generator, hold: float = 0.1) -> tuple[asterism.System, Matrix]:
    width = max(2, round(n**0.5))
    rest = np.zeros((width * width, dim))
    rest[:, :2] = np.stack(np.divmod(np.arange(width * width), width), axis=1)
    return with_links(rng, rest, grid_links(width, True), hold)


def sheet(n: int, dim: int, rng: np.random.Generator, is_hung: bool) -> tuple[asterism.System, Matrix]:
    """Squares without diagonals, which shear: held at the corners and crumpled, or hung from an edge."""
    width = max(2, round(n**0.5))
    rest = np.zeros((width * width, dim))
    rest[:, :2] = np.stack(np.divmod(np.arange(width * width), width), axis=1)
    system = asterism.System(*rest.shape)
    held = np.arange(width) if is_hung else np.array([0, width - 1, width * (width - 1), width * width - 1])
    stiffness = np.zeros(len(rest))
    stiffness[held] = 1
    system.add_anchors(rest, stiffness)
    system.add_links(grid_links(width, False), 1.0, 1.0)
    if is_hung:
        system.add_loads(np.tile(1e-3 * np.eye(dim)[-1], (len(rest), 1)))
    return system, rest + 0.3 * rng.uniform(-1, 1, size=rest.shape)


def net(n: int, dim: int, rng: np.random.Generator) -> tuple[asterism.System, Matrix]:
    """Each node linked to its five nearest."""
    rest = n ** (1 / dim) * rng.uniform(size=(n, dim))
    near = np.argsort(np.linalg.norm(rest[:, None] - rest, axis=2), axis=1)[:, 1:6]
    links = np.unique(np.sort(np.stack([np.repeat(np.arange(n), near.shape[1]), near.ravel()], axis=1), axis=1), axis=0)
    return with_links(rng, rest, links, 0.1)


def chain(n: int, dim: int, rng: np.random.Generator) -> tuple[asterism.System, Matrix]:
    rest = np.zeros((n, dim))
    rest[:, 0] = np.arange(n)
    return with_links(rng, rest, np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), 0.1)


def smoothing(n: int, dim: int, rng: np.random.Generator) -> tuple[asterism.System, Matrix]:
    """A path through noisy positions, of small second differences: a quadratic energy."""
    positions = np.cumsum(rng.normal(size=(n, dim)), axis=0)
    system = asterism.System(n, dim)
    system.add_anchors(positions, 1.0)
    system.add_differences(np.arange(n - 2)[:, None] + np.arange(3), 1e4)
    return system, positions


KINDS: dict[str, Callable] = {
    "all pairs": everyone,
    "cloth": cloth,
    "cloth on weak anchors": lambda n, dim, rng: cloth(n, dim, rng, 1e-4),
    "sheet held at its corners": lambda n, dim, rng: sheet(n, dim, rng, False),
    "sheet hung from an edge": lambda n, dim, rng: sheet(n, dim, rng, True),
    "net": net,
    "chain": chain,
    "smoothing": smoothing,
}
SIZES = (4, 10, 30, 100, 300, 1000, 3000)

# By the number of unknowns and the kind: chains have a factor with few entries, smoothing a quadratic energy, sheets
# fewer links than coordinates and few anchors.
RULES: dict[str, Callable[[int, str], bool]] = {  # whether to take Newton
    "newton-cg": lambda unknowns, kind: False,
    "newton up to 64 unknowns": lambda unknowns, kind: unknowns <= 64,
    "newton up to 512": lambda unknowns, kind: unknowns <= 512,
    "newton up to 64, and chains": lambda unknowns, kind: unknowns <= 64 or kind in ("chain", "smoothing"),
    "newton up to 512, and chains": lambda unknowns, kind: unknowns <= 512 or kind in ("chain", "smoothing"),
    "newton up to 64, and quadratic": lambda unknowns, kind: unknowns <= 64 or kind == "smoothing",
    "the same, and sheets": lambda unknowns, kind: unknowns <= 64 or kind == "smoothing" or "sheet" in kind,
}


def seconds(system: asterism.System, start: Matrix, method: str) -> float:
    best, total = float("inf"), 0.0
    while total < 0.02:
        x = start.copy()
        begin = time.process_time()
        system.solve(x, method=method)
        took = time.process_time() - begin
        best, total = min(best, took), total + max(took, 1e-6)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 3), metavar=("FIRST", "LAST"))
    parser.add_argument("--largest", type=int, default=1000, metavar="NODES")
    options = parser.parse_args()
    ratios: dict[str, list[float]] = {rule: [] for rule in RULES}
    for kind, make in KINDS.items():
        for n in SIZES:
            if n > options.largest or (kind == "all pairs" and n > 300):
                continue
            for dim in (2, 3):
                took = []
                for seed in range(options.seeds[0], options.seeds[1] + 1):
                    system, start = make(n, dim, np.random.default_rng([seed, n, dim]))
                    took.append([seconds(system, start, method) for method in ("newton", "newton-cg")])
                newton, newton_cg = np.exp(np.mean(np.log(took), axis=0))
                print(f"{kind:26} {n:5} nodes, {dim}-D: newton {newton * 1e3:8.3f} ms, newton-cg {newton_cg * 1e3:8.3f} ms")
                for rule, takes_newton in RULES.items():
                    chosen = newton if takes_newton(system.nodes * dim, kind) else newton_cg
                    ratios[rule].append(chosen / min(newton, newton_cg))
    print(f"\n{len(RULES)} rules; time relative to the faster method: geometric mean, largest")
    for rule, values in ratios.items():
        print(f"{rule:32} {np.exp(np.mean(np.log(values))):6.2f} {max(values):6.2f}")


if __name__ == "__main__":
    main()
