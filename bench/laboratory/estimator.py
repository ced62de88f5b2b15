#!/usr/bin/env python3
"""asterism.MDS against scikit-learn's: CPU seconds to its stress, seconds of transform, and what a second core gains.

    estimator.py [--points N ...] [--choose FIRST LAST] [--score FIRST LAST] [--kinds K] [--rule N_INIT EPS]

All in one run. scikit-learn runs by its defaults (4 starts of up to 300 iterations). The rules for n_init and eps are compared on the seeds of
--choose; that with the largest least gain of those that end with no more stress than scikit-learn's in every run is then scored on other
seeds, those of --score. --rule gives the rule instead. Needs the Python module of Asterism, scikit-learn (python3-sklearn) and SciPy.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import itertools
import time
import warnings
from collections.abc import Callable
from typing import Any

import asterism
import numpy as np
from mds_starts import KINDS, Matrix, between
from sklearn.manifold import MDS

ALL_KNOWN = {name: make for name, make in KINDS.items() if name != "along a graph in the plane"}  # scikit-learn has no missing pairs
OF_POINTS: dict[str, Callable[[np.random.Generator, int], Matrix]] = {
    "5 normal dimensions": lambda rng, n: between(rng.normal(size=(n, 5))),
    **ALL_KNOWN,
}
RULES = list(itertools.product((1, None, 4, 8), (1e-2, 1e-3)))


def seconds(run: Callable[[], Any], clock: Callable[[], float], times: int = 1) -> tuple[float, Any]:
    """The least time of several runs, and the last one's result."""
    least = np.inf
    for _ in range(times):
        begin = clock()
        result = run()
        least = min(least, clock() - begin)
    return least, result


def gains(n: int, kinds: int, seeds: range, rules: list[tuple[int | None, float]]) -> dict[tuple[int | None, float], np.ndarray]:
    """For each rule, how many times less CPU time it takes than scikit-learn, and its share of the stress, in each run (R, 2)."""
    results: dict[tuple[int | None, float], list[tuple[float, float]]] = {rule: [] for rule in rules}
    for name, make in list(OF_POINTS.items())[:kinds]:
        for seed in seeds:
            distances = make(np.random.default_rng([seed, n]), n)
            theirs, peer = seconds(lambda: MDS(2, dissimilarity="precomputed", random_state=seed).fit(distances), time.process_time)
            line = f"{n} points, {name}, seed {seed}: scikit-learn {theirs:.2f} s;"
            for n_init, eps in rules:
                mds = asterism.MDS(2, dissimilarity="precomputed", n_init=n_init, eps=eps, random_state=seed)
                ours, made = seconds(lambda: mds.fit(distances), time.process_time)
                results[n_init, eps].append((theirs / ours, made.stress_ / peer.stress_))
                line += f"  n_init={n_init}, eps={eps:g}: {theirs / ours:.0f} times, {made.stress_ / peer.stress_:.4f}"
            print(line, flush=True)
    return {rule: np.array(each) for rule, each in results.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[500])
    parser.add_argument("--choose", type=int, nargs=2, default=(1, 3), metavar=("FIRST", "LAST"))
    parser.add_argument("--score", type=int, nargs=2, default=(4, 5), metavar=("FIRST", "LAST"))
    parser.add_argument("--kinds", type=int, default=len(OF_POINTS), help="only the first so many")
    parser.add_argument("--rule", nargs=2, metavar=("N_INIT", "EPS"), help="no choice; N_INIT 0 is the default")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # about defaults that later versions change
    for n in options.points:
        if options.rule:
            rule = (int(options.rule[0]) or None, float(options.rule[1]))
        else:
            found = gains(n, options.kinds, range(options.choose[0], options.choose[1] + 1), RULES)
            for (n_init, eps), each in found.items():
                print(f"  n_init={n_init}, eps={eps:g}: {each[:, 0].min():.1f} times or more, stress {each[:, 1].max():.4f} or less")
            fits = [rule for rule in RULES if (found[rule][:, 1] <= 1).all()]
            rule = max(fits or RULES, key=lambda rule: found[rule][:, 0].min() if fits else -found[rule][:, 1].max())
            print(f"  of {len(RULES)} rules, {len(fits)} never have more stress; chosen: n_init={rule[0]}, eps={rule[1]:g}", flush=True)
        each = gains(n, options.kinds, range(options.score[0], options.score[1] + 1), [rule])[rule]
        print(
            f"{n} points, n_init={rule[0]}, eps={rule[1]:g}: {np.median(each[:, 0]):.1f} times less CPU time than scikit-learn in the median, "
            f"{each[:, 0].min():.1f} at least; stress {each[:, 1].mean():.4f} of its on average, {each[:, 1].max():.4f} at most",
            flush=True,
        )
    rng = np.random.default_rng(1)
    made, new = asterism.MDS(2).fit(rng.normal(size=(2000, 5))), rng.normal(size=(100_000, 5))
    for jobs in (1, 2):
        taken, _ = seconds(lambda: made.set_params(n_jobs=jobs).transform(new), time.perf_counter, 3)
        print(f"transform, 100,000 points among {len(made.embedding_)}, {jobs} jobs: {taken:.2f} s", flush=True)
    points = rng.normal(size=(300, 5))
    one, two = (seconds(lambda: asterism.MDS(2, n_init=32, n_jobs=jobs).fit(points), time.perf_counter, 5)[0] for jobs in (1, 2))
    print(f"32 starts, 300 points: {one:.3f} s, two jobs {two:.3f} s, {one / two:.2f} times")


if __name__ == "__main__":
    main()
