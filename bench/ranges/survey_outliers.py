#!/usr/bin/env python3
"""asterism.survey with a cutoff, on ranges some of which are too long, beside least squares of the right ones, which is told which these are.

survey_outliers.py [--seeds A B]: devices in a hall of 10 m, ranges with 5 cm of noise, 10 % of the pairs missing, 0 to 30 % of the ranges up to 8 m too
long; each pair is measured once (even seeds) or twice. Surveys that the right ranges do not determine are left out.
"""

import argparse
import time

import asterism
import numpy as np


def error(found, truth):
    """Root mean square, after the best rigid motion."""
    centred = truth - truth.mean(0)
    u, _, v = np.linalg.svd(found.x.T @ centred)
    return float(np.sqrt(((found.x @ u @ v - centred) ** 2).sum(-1).mean()))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 6))
    options = parser.parse_args()
    for dim in (2, 3):
        for count in (8, 12, 25):
            for bias in (0.0, 0.3):
                for wrong in (0, 0.1, 0.2, 0.3):
                    rows, failed = [], 0
                    for seed in range(*options.seeds):
                        rng = np.random.default_rng((seed, count, dim, int(100 * wrong), bias > 0))
                        x, c = rng.uniform(0, 10, (count, dim)), bias * rng.normal(size=count)
                        right = np.linalg.norm(x[:, None] - x[None], axis=-1) + c[:, None] + c + 0.05 * rng.normal(size=(count, count))
                        is_wrong, more = rng.random(right.shape) < wrong, rng.uniform(0.5, 8, right.shape)
                        ranges = np.maximum(np.where(is_wrong, right + more, right), 0)
                        ranges[rng.random(right.shape) < 0.1] = np.nan
                        if seed % 2 == 0:
                            ranges, is_wrong = np.triu(ranges, 1) + np.triu(ranges, 1).T, np.triu(is_wrong, 1) | np.triu(is_wrong, 1).T
                        try:
                            told = asterism.survey(np.where(is_wrong, np.nan, ranges), 0.05, bias=bias, dim=dim)
                        except ValueError:
                            continue
                        start = time.process_time()
                        try:
                            found = asterism.survey(ranges, 0.05, bias=bias, dim=dim, cutoff=4)
                        except ValueError:
                            failed += 1
                            continue
                        seconds = time.process_time() - start
                        try:
                            plain = error(asterism.survey(ranges, 0.05, bias=bias, dim=dim), x)
                        except ValueError:
                            plain = np.nan
                        least = error(told, x)
                        rows.append((error(found, x) / least, plain / least, 1e3 * seconds))
                    if rows:
                        ratio, plain, milliseconds = np.array(rows).T
                        print(f"{dim}-D, {count} devices, {'biases' if bias else 'no biases'}, {wrong:.0%} wrong: error / told {np.median(ratio):.2f}, at most 1.2 in {np.mean(ratio <= 1.2) * len(rows):.0f} of {len(rows) + failed} ({failed} raise); without a cutoff {np.nanmedian(plain):.1f}; {np.median(milliseconds):.0f} ms", flush=True)


if __name__ == "__main__":
    main()
