#!/usr/bin/env python3
"""What more starts of asterism.mds gain: the stress of its result, relative to the least of the row, and the CPU time.

    mds_starts.py [--points N] [--dim D] [--seeds FIRST LAST] [--starts K ...]

Mean and largest stress over the seeds, for distances of four kinds. Needs the Python module of Asterism.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import asterism
import numpy as np

Matrix = np.ndarray


def between(points: Matrix) -> Matrix:
    return np.linalg.norm(points[:, None] - points, axis=2)


def clusters(rng: np.random.Generator, n: int, count: int, dim: int, apart: float) -> Matrix:
    centres = apart * rng.normal(size=(count, dim))
    return between(centres[rng.integers(count, size=n)] + rng.normal(size=(n, dim)))


def noisy(rng: np.random.Generator, n: int) -> Matrix:
    distances = between(rng.uniform(size=(n, 2)))
    noise = np.triu(rng.normal(size=distances.shape), 1)
    return distances * np.exp(0.1 * (noise + noise.T))


KINDS = {
    "plane, noise of 10 %": noisy,
    "cube of 5 dimensions": lambda rng, n: between(rng.uniform(size=(n, 5))),
    "10 clusters of 10 dimensions": lambda rng, n: clusters(rng, n, 10, 10, 3),
    "25 clusters of 20 dimensions": lambda rng, n: clusters(rng, n, 25, 20, 2),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=350)
    parser.add_argument("--dim", type=int, default=2, choices=(2, 3))
    parser.add_argument("--seeds", type=int, nargs=2, default=(21, 28), metavar=("FIRST", "LAST"))
    parser.add_argument("--starts", type=int, nargs="+", default=[1, 2, 4, 8])
    options = parser.parse_args()
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    print(f"{options.points} points in {options.dim} dimensions: mean stress (largest), CPU time")
    for name, make in KINDS.items():
        stress = np.empty((len(options.starts), len(seeds)))
        seconds = np.zeros(len(options.starts))
        for s, seed in enumerate(seeds):
            distances = make(np.random.default_rng([seed, options.points]), options.points)
            for k, starts in enumerate(options.starts):
                begin = time.process_time()
                stress[k, s] = asterism.mds(distances, dim=options.dim, starts=starts).stress
                seconds[k] += (time.process_time() - begin) / len(seeds)
        relative = stress / stress.min(axis=0)
        cells = [
            f"{k} starts {r.mean():.4f} ({r.max():.3f}) {t:.2f} s"
            for k, r, t in zip(options.starts, relative, seconds)
        ]
        print(f"{name:30s} " + "   ".join(cells), flush=True)


if __name__ == "__main__":
    main()
