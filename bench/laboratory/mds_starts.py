#!/usr/bin/env python3
"""What the default of asterism.mds and numbers of starts reach: stress relative to the least of the row, and CPU time.

    mds_starts.py [--points N] [--dim D] [--seeds FIRST LAST] [--starts K ...]

Mean and largest stress over the seeds, for distances of seven kinds; less than a billionth of sum d^2 counts as that much. Needs the Python module of Asterism and SciPy.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import asterism
import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

Matrix = np.ndarray


def between(points: Matrix) -> Matrix:
    return np.linalg.norm(points[:, None] - points, axis=2)


def clusters(rng: np.random.Generator, n: int, count: int, dim: int, apart: float) -> Matrix:
    centres = apart * rng.normal(size=(count, dim))
    return between(centres[rng.integers(count, size=n)] + rng.normal(size=(n, dim)))


def with_noise(rng: np.random.Generator, distances: Matrix) -> Matrix:
    noise = np.triu(rng.normal(size=distances.shape), 1)
    return distances * np.exp(0.1 * (noise + noise.T))


def noisy(rng: np.random.Generator, n: int) -> Matrix:
    return with_noise(rng, between(rng.uniform(size=(n, 2))))


def along_graph(rng: np.random.Generator, n: int) -> Matrix:
    between_points = between(rng.uniform(size=(n, 2)))
    edges = scipy.sparse.csr_matrix(np.where(between_points < np.sqrt(5.4 / n), between_points, 0))
    paths = scipy.sparse.csgraph.shortest_path(edges, directed=False)
    paths[np.isinf(paths)] = np.nan
    return paths


KINDS = {
    "plane, noise of 10 %": noisy,
    "10 clusters in the plane, noise": lambda rng, n: with_noise(rng, clusters(rng, n, 10, 2, 10)),
    "along a graph in the plane": along_graph,
    "cube of 3 dimensions": lambda rng, n: between(rng.uniform(size=(n, 3))),
    "cube of 5 dimensions": lambda rng, n: between(rng.uniform(size=(n, 5))),
    "10 clusters of 10 dimensions": lambda rng, n: clusters(rng, n, 10, 10, 3),
    "25 clusters of 20 dimensions": lambda rng, n: clusters(rng, n, 25, 20, 2),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=350)
    parser.add_argument("--dim", type=int, default=2, choices=(2, 3))
    parser.add_argument("--seeds", type=int, nargs=2, default=(31, 38), metavar=("FIRST", "LAST"))
    parser.add_argument("--starts", type=int, nargs="+", default=[1, 8], help="compared with the default")
    options = parser.parse_args()
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    print(f"{options.points} points in {options.dim} dimensions: mean stress (largest), CPU time")
    for name, make in KINDS.items():
        rows = [{}, *({"starts": starts} for starts in options.starts)]
        stress = np.empty((len(rows), len(seeds)))
        seconds = np.zeros(len(rows))
        for s, seed in enumerate(seeds):
            distances = make(np.random.default_rng([seed, options.points]), options.points)
            rounding = 1e-9 * np.nansum(np.triu(distances) ** 2)
            for k, row in enumerate(rows):
                begin = time.process_time()
                stress[k, s] = max(asterism.mds(distances, dim=options.dim, **row).stress, rounding)
                seconds[k] += (time.process_time() - begin) / len(seeds)
        relative = stress / stress.min(axis=0)
        cells = [
            f"{row.get('starts', 'default')}: {r.mean():.4f} ({r.max():.3f}) {t:.2f} s"
            for row, r, t in zip(rows, relative, seconds)
        ]
        print(f"{name:30s} " + "   ".join(cells), flush=True)


if __name__ == "__main__":
    main()
