#!/usr/bin/env python3
"""How much the results of trackers change if the start or the images change slightly: a gain below this is none.

    bench/evaluation/perturbations.py RETURNS... [--folds FOLDS [--of 0,1,2]] [--worst 3]

RETURNS are files of asterism-returns, joined, with the kinds "pass" (the sequence as it is), "left", "right", "up", "down" (the start
box is one pixel away) and "jpeg-95", "jpeg-85" (the images are compressed again); other kinds are left out, and two of these at least
are needed. All trackers are compared on the sequences on which each of them has all kinds; of these, only the sequences of FOLDS, a file
of lines FOLD<tab>SEQUENCE..., count if it is given, and of them only the folds of --of.

For each tracker: the mean AO over sequences and kinds; the standard deviation of a sequence's AO over the kinds, its median and its
largest values; and the standard deviation, over the kinds, of the mean AO of all sequences. Two values of the latter are printed: that
of the means as they are, and the one expected of the deviations of the sequences if these are independent (the square root of the sum
of their variances, divided by their number), which is less uncertain. The last column is 2.8 times this value (1.96 times the square
root of 2): two runs of equal trackers, one start each, differ by more in one of twenty comparisons. A second table has the mean AO of
each kind. Needs NumPy.
"""

import argparse
import math
import sys
from collections import defaultdict

import numpy as np

from cross_validation import BadInput, sequences_of
from returns import read_rows

KINDS = ("pass", "left", "right", "up", "down", "jpeg-95", "jpeg-85")
COLUMNS = {"tracker", "kind", "sequence", "overlap"}


def read(paths, only):
    """{tracker: {sequence: {kind: AO}}} of the frames that count; only: the sequences that do, None for all."""
    frames = defaultdict(lambda: defaultdict(lambda: defaultdict(list)))
    for row in read_rows(paths, COLUMNS):
        if row["kind"] in KINDS and not math.isnan(row["overlap"]) and (only is None or row["sequence"] in only):
            frames[row["tracker"]][row["sequence"]][row["kind"]].append(row["overlap"])
    return {
        tracker: {sequence: {kind: float(np.mean(values)) for kind, values in kinds.items()} for sequence, kinds in sequences.items()}
        for tracker, sequences in frames.items()
    }


def arrays(found):
    """The kinds, the sequences that every tracker has with all of them, and {tracker: AO, sequences x kinds}."""
    present = {kind for sequences in found.values() for kinds in sequences.values() for kind in kinds}
    kinds = [kind for kind in KINDS if kind in present]
    if len(kinds) < 2:
        raise BadInput(f"two kinds at least are needed of {', '.join(KINDS)}")
    names = set.intersection(*({name for name, of in sequences.items() if set(of) == set(kinds)} for sequences in found.values()))
    if not names:
        raise BadInput(f"no sequence has the kinds {', '.join(kinds)} with every tracker")
    names = sorted(names)
    return kinds, names, {tracker: np.array([[of[name][kind] for kind in kinds] for name in names]) for tracker, of in found.items()}


def tables(found, worst):
    kinds, names, of = arrays(found)
    yield f"{len(names)} sequences, {len(kinds)} runs on each: {', '.join(kinds)}"
    yield ""
    yield "| tracker | AO | deviation of a sequence, median | largest | of the mean, measured | expected | two runs differ by |"
    yield "|---|---|---|---|---|---|---|"
    for tracker, ao in of.items():
        deviation = ao.std(axis=1, ddof=1)
        largest = ", ".join(f"{names[i]} {deviation[i]:.3f}" for i in np.argsort(-deviation, kind="stable")[:worst])
        expected = math.sqrt((deviation**2).sum()) / len(names)
        yield (
            f"| {tracker} | {ao.mean():.3f} | {np.median(deviation):.3f} | {largest} | {ao.mean(axis=0).std(ddof=1):.4f} | "
            f"{expected:.4f} | {1.96 * math.sqrt(2) * expected:.3f} |"
        )
    yield ""
    yield "| mean AO | " + " | ".join(kinds) + " |"
    yield "|---" * (len(kinds) + 1) + "|"
    for tracker, ao in of.items():
        yield f"| {tracker} | " + " | ".join(f"{value:.3f}" for value in ao.mean(axis=0)) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("returns", nargs="+")
    parser.add_argument("--folds", help="only the sequences of this file count")
    parser.add_argument("--of", help="and of these only the ones of these folds")
    parser.add_argument("--worst", type=int, default=3, help="so many of the largest deviations are named")
    options = parser.parse_args()
    if options.of and not options.folds:
        raise BadInput("--of needs --folds")
    found = read(options.returns, set(sequences_of(options.folds, options.of)) if options.folds else None)
    if not found:
        raise BadInput("the files have no frame of these kinds and sequences")
    print("\n".join(tables(found, options.worst)))


if __name__ == "__main__":
    try:
        main()
    except (BadInput, OSError) as error:
        sys.exit(f"perturbations.py: {error}")
