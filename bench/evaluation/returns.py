#!/usr/bin/env python3
"""Tables of what asterism-returns wrote: whether trackers find an object that comes back.

    bench/evaluation/returns.py RETURNS... --folds FOLDS [--of 3,4] [--baseline dpt_plus]

RETURNS are files of asterism-returns, joined. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; only the folds of --of count.
For each kind of video and tracker: the share of the frames after the return in which the overlap is more than one half, the average
overlap (AO) in these frames and in those before (of "pass", in all frames), both as means over the sequences; the difference from
--baseline with the 95 % interval of a paired bootstrap over the sequences (10,000 draws, fixed seed); and the milliseconds of a frame,
while the object is there and while it is absent. Needs NumPy.
"""

import argparse
import csv
import math
import sys
from collections import defaultdict

import numpy as np

from cross_validation import BadInput, sequences_of

COLUMNS = {"tracker", "kind", "sequence", "state", "overlap", "milliseconds"}
MADE = "all made"


def number_of(text):
    """NaN for a text that is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def read_rows(paths, columns):
    """The rows of files of asterism-returns, which have at least these columns; `overlap` is a number, NaN where the frame does not count,
    and so is `milliseconds`, if it is one of the columns."""
    for path in paths:
        try:
            with open(path, newline="", encoding="utf-8") as file:
                rows = csv.DictReader(file)
                if missing := columns - set(rows.fieldnames or ()):
                    raise BadInput(f"{path}: the columns {', '.join(sorted(missing))} are missing")
                for row in rows:
                    where = f"{path}:{rows.line_num}"
                    if None in row or None in row.values():
                        raise BadInput(f"{where}: expected {len(rows.fieldnames)} values")
                    text, row["overlap"] = row["overlap"], number_of(row["overlap"])
                    if text and not 0 <= row["overlap"] <= 1:
                        raise BadInput(f"{where}: the overlap {text} is not in [0, 1]")
                    if "milliseconds" in columns:
                        text, row["milliseconds"] = row["milliseconds"], number_of(row["milliseconds"])
                        if not 0 <= row["milliseconds"] < math.inf:
                            raise BadInput(f"{where}: the milliseconds {text} are not a number >= 0")
                    yield row
        except (UnicodeDecodeError, csv.Error) as error:
            raise BadInput(f"{path}: not a CSV file: {error}") from error


def read(paths, sequences):
    """{(kind, tracker): {sequence: {state: [(overlap or NaN, milliseconds)]}}}"""
    found = defaultdict(lambda: defaultdict(lambda: defaultdict(list)))
    for row in read_rows(paths, COLUMNS):
        if row["sequence"] in sequences:
            found[row["kind"], row["tracker"]][row["sequence"]][row["state"]].append((row["overlap"], row["milliseconds"]))
    return found


def overlaps(frames):
    values = np.array([overlap for overlap, _ in frames])
    return values[~np.isnan(values)]


def scores(of_sequence, kind):
    """(share, AO) after the return, and AO before; NaN without frames that count."""
    before, after = overlaps(of_sequence["before"]), overlaps(of_sequence["after"])
    counted = before if kind == "pass" else after
    if len(counted) == 0:
        return np.full(3, np.nan)
    return np.array([(counted > 0.5).mean(), counted.mean(), before.mean() if len(before) else np.nan])


def interval(differences):
    draws = np.random.default_rng(1).integers(len(differences), size=(10000, len(differences)))
    return np.percentile(differences[draws].mean(axis=1), [2.5, 97.5])


def difference(values, base):
    low, high = interval(values - base)
    return f"{(values - base).mean():+.3f} ({low:+.3f} to {high:+.3f})"


def table(found, baseline):
    kinds = list(dict.fromkeys(kind for kind, _ in found))
    trackers = list(dict.fromkeys(tracker for _, tracker in found))
    of = {key: {name: scores(frames, key[0]) for name, frames in found[key].items()} for key in found}
    made = [kind for kind in kinds if kind != "pass"]
    for tracker in trackers:  # the mean over the kinds that were made
        if len(made) > 1 and all((kind, tracker) in of for kind in made):
            names = set.intersection(*(set(of[kind, tracker]) for kind in made))
            of[MADE, tracker] = {name: np.mean([of[kind, tracker][name] for kind in made], axis=0) for name in sorted(names)}
    yield "| kind | tracker | sequences | overlap > 0.5 | AO | AO before | difference of the share | of AO | ms | ms, absent |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for kind in [*kinds, *([MADE] if len(made) > 1 else [])]:
        for tracker in trackers:
            if (kind, tracker) not in of:
                continue
            mine, base = of[kind, tracker], of.get((kind, baseline), {})
            names = [name for name in mine if not np.isnan(mine[name][:2]).any() and (not base or name in base)]
            values = np.array([mine[name] for name in names])
            cells = [f"{v:.3f}" for v in np.nanmean(values, axis=0)]
            if tracker == baseline or not base:
                cells += ["", ""]
            else:
                reference = np.array([base[name] for name in names])
                cells += [difference(values[:, i], reference[:, i]) for i in (0, 1)]
            for states in (("before", "after"), ("absent",)):
                times = [ms for frames in found.get((kind, tracker), {}).values() for state in states for _, ms in frames[state]]
                cells.append(f"{np.mean(times):.1f}" if times else "")
            yield f"| {kind} | {tracker} | {len(names)} | " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("returns", nargs="+")
    parser.add_argument("--folds", required=True)
    parser.add_argument("--of", default="3,4", help="the folds that count")
    parser.add_argument("--baseline", default="dpt_plus")
    options = parser.parse_args()
    found = read(options.returns, set(sequences_of(options.folds, options.of)))
    if not found:
        raise BadInput("no sequence of these folds is in the files")
    print("\n".join(table(found, options.baseline)))


if __name__ == "__main__":
    try:
        main()
    except (BadInput, OSError) as error:
        sys.exit(f"returns.py: {error}")
