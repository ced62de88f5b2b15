#!/usr/bin/env python3
"""asterism.MDS against scikit-learn's: seconds to its stress, of transform, and what a second core gains.

    estimator.py [--points N ...]

All in one run. scikit-learn runs by its defaults (4 starts of up to 300 iterations), Asterism by its own; both on one core, but for the last
lines. Needs the Python module of Asterism and scikit-learn (python3-sklearn).
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
import warnings
from collections.abc import Callable
from typing import Any

import asterism
import numpy as np
from sklearn.manifold import MDS


def seconds(run: Callable[[], Any], times: int = 1) -> tuple[float, Any]:
    """The least wall-clock time of several runs, and the last one's result."""
    least = np.inf
    for _ in range(times):
        begin = time.perf_counter()
        result = run()
        least = min(least, time.perf_counter() - begin)
    return least, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[500, 2000])
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # about defaults that later versions change
    rng = np.random.default_rng(1)
    for n in options.points:
        points = rng.normal(size=(n, 5))
        theirs, peer = seconds(lambda: MDS(2, random_state=1).fit(points))
        ours, made = seconds(lambda: asterism.MDS(2).fit(points))
        print(f"fit, {n} points: {ours:.2f} s; scikit-learn {theirs:.2f} s, {theirs / ours:.1f} times; stress {made.stress_ / peer.stress_:.4f} of its", flush=True)
        for eps in (3e-2, 1e-2, 3e-3, 1e-3):
            ours, rough = seconds(lambda: asterism.MDS(2, n_init=1, eps=eps).fit(points))
            if rough.stress_ <= peer.stress_:
                break
        print(
            f"  to its stress, n_init=1, eps={eps}: {ours:.2f} s, {theirs / ours:.1f} times; stress {rough.stress_ / peer.stress_:.4f} of its",
            flush=True,
        )
    new = rng.normal(size=(100_000, 5))
    for jobs in (1, 2):
        time_taken, _ = seconds(lambda: made.set_params(n_jobs=jobs).transform(new), 3)
        print(f"transform, 100,000 points among {len(made.embedding_)}, {jobs} jobs: {time_taken:.2f} s", flush=True)
    points = rng.normal(size=(300, 5))
    one, two = (seconds(lambda: asterism.MDS(2, n_init=32, n_jobs=jobs).fit(points), 3)[0] for jobs in (1, 2))
    print(f"32 starts, 300 points: {one:.2f} s, two jobs {two:.2f} s, {one / two:.2f} times")


if __name__ == "__main__":
    main()
