#!/usr/bin/env python3
"""asterism-track with and without --smooth on annotated sequences, as results for asterism-eval report, and the jitter of the boxes.

    bench/evaluation/smoothing.py PROGRAM DATA OUT --folds FOLDS [--of 3,4] [--trackers dpt,dpt_plus] [--starts 3]

PROGRAM is asterism-track, DATA a folder of sequences in the VOT toolkit's layout, OUT the folder of a campaign that asterism-eval run has made
on the same sequences with --protocol otb: the boxes become its trackers NAME-track and NAME-smooth, with start boxes as asterism-eval --starts
moves them. Files that are there are kept. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; only the folds of --of count.

Jitter is the mean length of the second difference of the box's centre, in mean sides of the box, in the frames in which the unsmoothed box
overlaps the object by more than one half there and in both neighbouring frames. Printed are the means over the sequences, the annotation's in
the same frames, and the ratio of smoothed to unsmoothed with the 95 % interval of a bootstrap over the sequences. Needs NumPy.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

from cross_validation import BadInput, sequences_of


def start_offsets(starts):
    """As start_offsets of bench/evaluation/protocols.cpp, with a seed and a jitter of 1."""
    raw = np.random.RandomState(1)._bit_generator.random_raw(2 * starts)
    return [(0.0, 0.0), *(raw.astype(float).reshape(-1, 2) / 2**31 - 1)][:starts]


def regions(sequence):
    """The annotated regions, and their boxes (N, 4): of a polygon the bounding box."""
    path = sequence / "groundtruth.txt"
    lines, boxes = [], []
    for number, line in enumerate(path.read_text(errors="replace").split(), 1):
        try:
            lines.append(np.array([float(v) for v in line.split(",")]))
        except ValueError:
            raise BadInput(f"{path}:{number}: not numbers separated by commas: {line[:60]}") from None
        if len(lines[-1]) < 4 or len(lines[-1]) % 2:
            raise BadInput(f"{path}:{number}: neither a box nor a polygon: {line[:60]}")
    if not lines:
        raise BadInput(f"{path}: no annotation in the file")
    for v in lines:
        low, high = v.reshape(-1, 2).min(0), v.reshape(-1, 2).max(0)
        boxes.append(v if len(v) == 4 else [*low, *(high - low)])
    return lines, np.array(boxes)


def track(program, sequence, name, region, offset, smooth):
    start = region + (np.append(offset, [0, 0]) if len(region) == 4 else np.tile(offset, len(region) // 2))
    with tempfile.TemporaryDirectory() as folder:
        csv = pathlib.Path(folder) / "boxes.csv"
        command = [program, sequence, "--tracker", name, "--out", csv, "--box=" + ",".join(repr(float(v)) for v in start)]
        done = subprocess.run([*command, *(["--smooth"] if smooth else [])], stderr=subprocess.PIPE, text=True)
        if done.returncode != 0:
            raise BadInput(done.stderr.strip())
        return np.loadtxt(csv, delimiter=",", skiprows=1, usecols=(1, 2, 3, 4), ndmin=2)


def read_or_track(file, *of):
    """The boxes of a run (N, 4), which `file` keeps in the toolkit's format."""
    if not file.exists():
        boxes = track(*of)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("1\n" + "".join(",".join(f"{v:.4f}" for v in box) + "\n" for box in boxes[1:]))
    try:
        return np.loadtxt(file, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise BadInput(f"{file}: damaged, remove it to make it again: {error}") from error


def overlaps(a, b):
    sides = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    common = np.maximum(sides, 0).prod(1)
    return common / (a[:, 2:].prod(1) + b[:, 2:].prod(1) - common)


def changes(boxes):
    """Of velocity, in the frames but the first and the last."""
    centre, side = boxes[:, :2] + boxes[:, 2:] / 2, np.sqrt(boxes[:, 2:].prod(1))
    return np.linalg.norm(np.diff(centre, 2, axis=0), axis=1) / side[1:-1]


def jitters(truth, tracked, smoothed):
    """Of annotation, tracker and smoothed boxes; NaN if the tracker is nowhere on the object. All start in the second frame."""
    on = overlaps(tracked, truth) > 0.5
    on = on[:-2] & on[1:-1] & on[2:] & np.isfinite(changes(truth))
    return [changes(boxes)[on].mean() if on.any() else np.nan for boxes in (truth, tracked, smoothed)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("program", "data", "out"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--folds", type=pathlib.Path, required=True)
    parser.add_argument("--of", help="folds that count, separated by commas; default: all")
    parser.add_argument("--trackers", default="dpt,dpt_plus")
    parser.add_argument("--starts", type=int, default=3)
    options = parser.parse_args()
    sequences = sequences_of(options.folds, options.of)
    print("| tracker | annotation | tracker's jitter | smoothed | ratio |\n|---|---|---|---|---|")
    for name in options.trackers.split(","):
        rows = []
        for sequence in sequences:
            lines, truth = regions(options.data / sequence)
            runs = []
            for start, offset in enumerate(start_offsets(options.starts), 1):
                boxes = []
                for kind in ("track", "smooth"):
                    file = options.out / f"results/{name}-{kind}/unsupervised/{sequence}/{sequence}_{start:03d}.txt"
                    boxes.append(read_or_track(file, options.program, options.data / sequence, name, lines[0], offset, kind == "smooth"))
                runs.append(jitters(truth[1:], *boxes))
            rows.append(np.nanmean(runs, axis=0) if np.isfinite(runs).any() else np.full(3, np.nan))
        rows = np.array(rows)[np.isfinite(rows).all(1)]
        draws = rows[np.random.default_rng(1).integers(len(rows), size=(10000, len(rows)))].mean(1)
        low, high = np.percentile(draws[:, 2] / draws[:, 1], [2.5, 97.5])
        mean = rows.mean(0)
        print(f"| `{name}` | {mean[0]:.4f} | {mean[1]:.4f} | {mean[2]:.4f} | {mean[2] / mean[1]:.2f} ({low:.2f} to {high:.2f}) |")


if __name__ == "__main__":
    try:
        main()
    except (BadInput, OSError) as error:
        sys.exit(f"smoothing.py: {error}")
