#!/usr/bin/env python3
"""asterism.MDS against scikit-learn's: CPU seconds to its stress, seconds of transform, and what a second core gains.

    estimator.py [--points [N ...]] [--dim D] [--choose FIRST LAST] [--score FIRST LAST] [--kinds K] [--rule N_INIT EPS]

All in one run. scikit-learn runs by its defaults (4 starts of up to 300 iterations). The rules for n_init and eps are compared on the seeds of
--choose. Of those whose stress is, on average over the seeds, at most that of scikit-learn for each kind of distances (to 1e-4), the one with
the largest median gain is scored on other seeds, those of --score. --rule gives the rule instead. Needs the Python module of Asterism,
scikit-learn (python3-sklearn) and SciPy.
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
Kinds = dict[str, Callable[[np.random.Generator, int], Matrix]]
Rule = tuple[int | None, float]
RULES: list[Rule] = list(itertools.product((1, None, 4, 8), (1e-2, 1e-3)))


def seconds(run: Callable[[], Any], clock: Callable[[], float], times: int = 1) -> tuple[float, Any]:
    """The least time of several runs, and the last one's result."""
    least = np.inf
    for _ in range(times):
        begin = clock()
        result = run()
        least = min(least, clock() - begin)
    return least, result


def text_of(rule: Rule) -> str:
    return f"n_init={rule[0]}, eps={rule[1]:g}"


def kinds_for(dim: int) -> Kinds:
    """Kinds of distances that have stress in this many dimensions."""
    features = 2 * dim + 1
    return {f"{features} normal dimensions": lambda rng, n: between(rng.normal(size=(n, features))), **ALL_KNOWN}


def gains(n: int, dim: int, kinds: Kinds, seeds: range, rules: list[Rule]) -> dict[Rule, np.ndarray]:
    """For each rule, (kinds, seeds, 3): how many times less CPU time it takes than scikit-learn, its share of the stress, and how many times
    less CPU time it takes to scikit-learn's stress: the time of the least of 1, 2, 4, ... iterations that end with no more."""
    results = {rule: np.empty((len(kinds), len(seeds), 3)) for rule in rules}
    for k, (name, make) in enumerate(kinds.items()):
        for s, seed in enumerate(seeds):
            distances = make(np.random.default_rng([seed, n]), n)
            theirs, peer = seconds(lambda: MDS(dim, dissimilarity="precomputed", random_state=seed).fit(distances), time.process_time)
            for rule in rules:
                options = {"dissimilarity": "precomputed", "n_init": rule[0], "eps": rule[1], "random_state": seed}
                ours, made = seconds(lambda: asterism.MDS(dim, **options).fit(distances), time.process_time)
                share, most, until = made.stress_ / peer.stress_, 1, ours
                while share <= 1 and most < made.n_iter_:
                    taken, early = seconds(lambda: asterism.MDS(dim, max_iter=most, **options).fit(distances), time.process_time)
                    if early.stress_ <= peer.stress_:
                        until = min(ours, taken)
                        break
                    most *= 2
                results[rule][k, s] = theirs / ours, share, theirs / until if share <= 1 else np.nan
        for rule in rules:
            gain, stress, until = results[rule][k].T
            print(
                f"  {name:32s} {text_of(rule):24s} {np.median(gain):5.1f} times (scikit-learn's last: {theirs:.2f} s), "
                f"{np.median(until):5.1f} to its stress; stress {stress.mean():.4f} of its ({stress.max():.4f} at most)",
                flush=True,
            )
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="*", default=[500], help="none: no comparison, only transform and starts")
    parser.add_argument("--dim", type=int, default=2, help="of the placement")
    parser.add_argument("--choose", type=int, nargs=2, default=(1, 3), metavar=("FIRST", "LAST"))
    parser.add_argument("--score", type=int, nargs=2, default=(4, 5), metavar=("FIRST", "LAST"))
    parser.add_argument("--kinds", type=int, help="only the first so many")
    parser.add_argument("--rule", nargs=2, metavar=("N_INIT", "EPS"), help="no choice; N_INIT 0 is the default")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # about defaults that later versions change
    kinds = dict(itertools.islice(kinds_for(options.dim).items(), options.kinds))
    for n in options.points:
        if options.rule:
            rule = (int(options.rule[0]) or None, float(options.rule[1]))
        else:
            print(f"{n} points, {len(RULES)} rules, seeds {options.choose[0]} to {options.choose[1]}", flush=True)
            found = gains(n, options.dim, kinds, range(options.choose[0], options.choose[1] + 1), RULES)
            fit = [rule for rule in RULES if (found[rule][..., 1].mean(axis=1) <= 1 + 1e-4).all()]
            if not fit:
                print("  no rule ends with as little stress as scikit-learn")
                continue
            rule = max(fit, key=lambda rule: np.median(found[rule][..., 0]))
            print(f"  {len(fit)} rules end with as little stress: {'; '.join(map(text_of, fit))}")
        print(f"{n} points, {text_of(rule)}, seeds {options.score[0]} to {options.score[1]}", flush=True)
        gain, stress, until = np.moveaxis(gains(n, options.dim, kinds, range(options.score[0], options.score[1] + 1), [rule])[rule], -1, 0)
        print(
            f"  all: {np.median(gain):.1f} times less CPU time in the median, {gain.min():.1f} to {gain.max():.1f}; "
            f"to its stress {np.nanmedian(until):.1f} times ({np.isnan(until).sum()} of {until.size} runs end with more); "
            f"stress {stress.mean():.4f} of its on average, {stress.max():.4f} at most",
            flush=True,
        )
    rng = np.random.default_rng(1)
    features = max(5, 2 * options.dim)
    made, new = asterism.MDS(options.dim).fit(rng.normal(size=(2000, features))), rng.normal(size=(100_000, features))
    for jobs in (1, 2):
        made.set_params(n_jobs=jobs)
        taken, cpu = (seconds(lambda: made.transform(new), clock, 3)[0] for clock in (time.perf_counter, time.process_time))
        print(f"transform, 100,000 points among {len(made.embedding_)}, {jobs} jobs: {taken:.2f} s, CPU time {cpu:.2f} s", flush=True)
    points = rng.normal(size=(300, 5))
    one, two = (seconds(lambda: asterism.MDS(2, n_init=32, n_jobs=jobs).fit(points), time.perf_counter, 5)[0] for jobs in (1, 2))
    print(f"32 starts, 300 points: {one:.3f} s, two jobs {two:.3f} s, {one / two:.2f} times")


if __name__ == "__main__":
    main()
