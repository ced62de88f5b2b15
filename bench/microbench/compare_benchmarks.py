#!/usr/bin/env python3
"""Puts two results of a Google Benchmark side by side: medians, their ratio with its confidence interval, and
whether the two differ by more than chance.

    asterism-solver-bench --benchmark_repetitions=10 --benchmark_out=old.json --benchmark_out_format=json
    (build the other version, the same into new.json)
    compare_benchmarks.py old.json new.json

The test is Mann and Whitney's U: exact for few repetitions without ties, else by the normal approximation. As a
comparison makes many tests at once, significance is decided by Benjamini and Hochberg's procedure: of the
differences marked, the expected share of false ones is below alpha. The interval is the bootstrap's.
A significant difference is one between the two runs, whether or not the code causes it: --least leaves out
differences that are too small to matter.
"""

import argparse
import json
import math
import os
import random
import statistics
import sys
from collections import Counter

LEAST_REPETITIONS = 4  # with fewer, no order of the values would be significant at 0.05
NANOSECONDS = {"ns": 1, "us": 1e3, "ms": 1e6, "s": 1e9}


class BadInput(Exception):
    """What is wrong with a file, in one line."""


def read(path, metric):
    """{benchmark: values of its repetitions}; times in ns."""
    try:
        with open(path, encoding="utf-8") as file:
            runs = json.load(file)["benchmarks"]
        result = {}
        for run in runs:
            if run.get("run_type") != "iteration" or run.get("error_occurred") or metric not in run:
                continue
            unit = NANOSECONDS[run["time_unit"]] if metric in ("cpu_time", "real_time") else 1
            result.setdefault(run["run_name"], []).append(unit * float(run[metric]))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"{path}: not the JSON of a Google Benchmark") from error
    if not result:
        raise BadInput(f"{path}: no benchmark has {metric}")
    if max(len(values) for values in result.values()) < LEAST_REPETITIONS:
        raise BadInput(f"{path}: needs --benchmark_repetitions={LEAST_REPETITIONS} or more")
    return {name: values for name, values in result.items() if len(values) >= LEAST_REPETITIONS}


def u_counts(m, n):
    """counts[u]: the number of orders of m + n different values in which the statistic of the m is u."""
    # Recursion on the largest value: one of the m, which is above all n, or one of the n.
    rows = [[1] for _ in range(n + 1)]  # no value against 0, ..., n
    for _ in range(m):
        row = [[1]]
        for other in range(1, n + 1):
            with_mine, with_other = rows[other], row[other - 1]
            counts = [0] * (len(with_mine) + other)
            for u, count in enumerate(with_mine):
                counts[u + other] += count
            for u, count in enumerate(with_other):
                counts[u] += count
            row.append(counts)
        rows = row
    return rows[n]


def mann_whitney(a, b):
    """The two-sided p of the hypothesis that a and b have the same distribution."""
    m, n = len(a), len(b)
    u = sum((x > y) + 0.5 * (x == y) for x in a for y in b)
    ties = [count for count in Counter(a + b).values() if count > 1]
    if not ties and m * n <= 400:
        counts = u_counts(m, n)
        tail = sum(counts[: int(min(u, m * n - u)) + 1])
        return min(1.0, 2 * tail / math.comb(m + n, m))
    total = m + n
    variance = m * n / 12 * (total + 1 - sum(t**3 - t for t in ties) / (total * (total - 1)))
    if variance <= 0:
        return 1.0
    z = max(0.0, abs(u - m * n / 2) - 0.5) / math.sqrt(variance)
    return math.erfc(z / math.sqrt(2))


def ratio_interval(old, new, confidence, resamples=2000):
    """Bootstrap interval of median(new) / median(old); the same values give the same interval."""
    rng = random.Random(1)
    ratios = sorted(
        statistics.median(rng.choices(new, k=len(new))) / statistics.median(rng.choices(old, k=len(old)))
        for _ in range(resamples)
    )
    outside = (1 - confidence) / 2
    return ratios[int(outside * resamples)], ratios[math.ceil((1 - outside) * resamples) - 1]


def significant(p_values, alpha):
    """For each test, whether it is significant, by Benjamini and Hochberg."""
    ordered = sorted(p_values)
    limit = max((p for k, p in enumerate(ordered, 1) if p <= alpha * k / len(ordered)), default=-1)
    return [p <= limit for p in p_values]


def natural(name):
    """A sort key that orders numbers in a name by their value."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in name.split("/")]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("old", help="JSON of the version to compare with")
    parser.add_argument("new", help="JSON of the version in question")
    parser.add_argument("--metric", default="cpu_time", help="cpu_time (default), real_time or a counter")
    parser.add_argument("--alpha", type=float, default=0.05, help="level of significance (default 0.05)")
    parser.add_argument("--least", type=float, default=0, help="least change to mark, as 0.05 (default 0)")
    options = parser.parse_args()
    if not 0 < options.alpha < 1:
        raise BadInput("--alpha is not between 0 and 1")

    old, new = read(options.old, options.metric), read(options.new, options.metric)
    names = sorted(old.keys() & new.keys(), key=natural)
    if not names:
        raise BadInput(f"{options.old} and {options.new} have no benchmark in common")
    for name in names:
        if not all(value > 0 for value in old[name] + new[name]):
            raise BadInput(f"{options.metric} of {name} is not positive")

    p_values = [mann_whitney(old[name], new[name]) for name in names]
    believed = significant(p_values, options.alpha)
    unit = " [ns]" if options.metric in ("cpu_time", "real_time") else ""
    print(f"{options.metric}{unit}: medians, new / old with its {100 * (1 - options.alpha):g} % interval")
    width = max(len(name) for name in names)
    print(f"{'':{width}} {'old':>10} {'new':>10} {'ratio':>7} {'interval':>15} {'p':>8}")
    marked = 0
    for name, p, is_significant in zip(names, p_values, believed):
        before, after = statistics.median(old[name]), statistics.median(new[name])
        ratio = after / before
        low, high = ratio_interval(old[name], new[name], 1 - options.alpha)
        interval = f"{low:.3f} - {high:.3f}"
        line = f"{name:{width}} {before:10.4g} {after:10.4g} {ratio:7.3f} {interval:>15} {p:8.2g}"
        if is_significant and abs(ratio - 1) >= options.least:
            line += " lower" if ratio < 1 else " higher"
            marked += 1
        print(line)
    print(f"{marked} of {len(names)} differ significantly")
    for path, mine, other in ((options.old, old, new), (options.new, new, old)):
        alone = sorted(mine.keys() - other.keys(), key=natural)
        if alone:
            print(f"in {path} alone: {', '.join(alone)}")


if __name__ == "__main__":
    try:
        main()
        sys.stdout.flush()
    except BadInput as problem:
        sys.exit(f"compare_benchmarks.py: {problem}")
    except OSError as error:  # standard output, as files are BadInput
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the flush at exit would fail as well
        sys.exit(f"compare_benchmarks.py: {error.strerror}")
