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
each kind.

If RETURNS are files report.json of asterism-eval, the same is computed for EAO, A and F of the supervised protocol, of each start alone:
one report with several starts, and others, on the same sequences, with images that are compressed again (--jpeg). The expected deviation
comes from runs through all sequences in which each sequence has another one of the first report's starts, drawn at random. Needs NumPy.
"""

import argparse
import json
import math
import pathlib
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


def read_report(path):
    """The sequences and the interval of a report of asterism-eval, and {tracker: its entry} of those with supervised runs."""
    try:
        report = json.loads(pathlib.Path(path).read_text(encoding="utf-8"))
        return (report["sequences"], report["eao_interval"]), {each["name"]: each for each in report["trackers"] if "vot" in each}
    except (KeyError, TypeError):
        raise BadInput(f"{path}: not a report of asterism-eval") from None


def supervised_tables(paths, worst):
    data, found = zip(*map(read_report, paths))
    if any(each != data[0] for each in data):
        raise BadInput("the reports are of other sequences, or of another interval of lengths")
    yield "| tracker | measure | mean | deviation, measured | expected | two runs differ by |"
    yield "|---|---|---|---|---|---|"
    sequences = []
    for name, first in found[0].items():
        runs = [trackers[name] for trackers in found if name in trackers]
        starts, mixed = len(first["vot"]["starts"]), first["vot"]["mixed_starts"]
        if starts < 2:
            raise BadInput(f"{paths[0]}: {name} has one start only")
        for measure in ("EAO", "A", "F"):
            of = np.array([start[measure] for run in runs for start in run["vot"]["starts"]], float)
            # Draws from N values deviate less than the values do: an N-th of the variance is that of their mean.
            expected = np.array([start[measure] for start in mixed], float).std() * math.sqrt(starts / (starts - 1))
            yield (
                f"| {name} | {measure} ({len(of)} runs) | {of.mean():.3f} | {of.std(ddof=1):.4f} | {expected:.4f} | "
                f"{1.96 * math.sqrt(2) * expected:.3f} |"
            )
        failures = {sequence: np.concatenate([run["sequences"][sequence]["start_F"] for run in runs]) for sequence in data[0][0]}
        most = sorted(failures, key=lambda sequence: -failures[sequence].std())[:worst]
        sequences.append(f"{name}: " + ", ".join(f"{each} {' '.join(f'{f:.0f}' for f in failures[each])}" for each in most))
    yield "\nFailures of the runs on the sequences on which they differ most:\n"
    yield from sequences


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("returns", nargs="+")
    parser.add_argument("--folds", help="only the sequences of this file count")
    parser.add_argument("--of", help="and of these only the ones of these folds")
    parser.add_argument("--worst", type=int, default=3, help="so many of the largest deviations are named")
    options = parser.parse_args()
    if options.of and not options.folds:
        raise BadInput("--of needs --folds")
    if all(path.endswith(".json") for path in options.returns):
        print("\n".join(supervised_tables(options.returns, options.worst)))
        return
    found = read(options.returns, set(sequences_of(options.folds, options.of)) if options.folds else None)
    if not found:
        raise BadInput("the files have no frame of these kinds and sequences")
    print("\n".join(tables(found, options.worst)))


if __name__ == "__main__":
    try:
        main()
    except (BadInput, OSError, json.JSONDecodeError) as error:
        sys.exit(f"perturbations.py: {error}")
