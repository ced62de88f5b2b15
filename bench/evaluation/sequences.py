#!/usr/bin/env python3
"""sequences.py DATA [--folds 35|50 OUT]: whether a folder has the sequences that the library was developed on.

bench/evaluation/sequences.tsv names them: the fold of cross-validation, the name, the number of frames, the set (the results on 35
sequences use the first and the second), the benchmark and what was done to the images, and SHA-256 checksums of boxes and images. The
images themselves are research data of those benchmarks and not part of the project.

A line for each sequence that differs: `missing`, `N frames`, `other boxes` or `other images`. Images that were compressed or scaled in
another way are `other images`: results on them are near those of the pages, but not the same. The exit code is 1 if any differs.

--folds writes the fold and the name of each of the 35 or 50 sequences to OUT, as cross_validation.py takes them.
"""
import argparse
import hashlib
import math
import sys
from pathlib import Path

LIST = Path(__file__).with_name("sequences.tsv")
COLUMNS = ["fold", "sequence", "frames", "set", "source", "images as", "boxes sha256", "images sha256"]


def images_of(sequence):
    return sorted(path for path in (sequence / "color").iterdir() if path.suffix.lower() in (".jpg", ".png"))


def boxes_checksum(sequence):
    """Of the numbers to two decimals, so that the way in which they are written does not matter."""
    digest = hashlib.sha256()
    for line in (sequence / "groundtruth.txt").read_text(encoding="utf-8").split("\n"):
        if line.strip():
            numbers = [float(number) for number in line.replace("\t", ",").split(",")]
            digest.update((",".join("nan" if math.isnan(number) else f"{round(number, 2) + 0.0:.2f}" for number in numbers) + "\n").encode())
    return digest.hexdigest()


def images_checksum(images):
    digest = hashlib.sha256()
    for path in images:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def known_sequences():
    lines = LIST.read_text(encoding="utf-8").rstrip("\n").split("\n")
    if lines[0] != "# " + "\t".join(COLUMNS):
        sys.exit(f"{LIST}:1: expected the columns {', '.join(COLUMNS)}")
    return [dict(zip(COLUMNS, line.split("\t"))) for line in lines[1:]]


def difference(known, sequence):
    """What differs, or empty."""
    if not (sequence / "color").is_dir() or not (sequence / "groundtruth.txt").is_file():
        return "missing"
    images = images_of(sequence)
    if len(images) != int(known["frames"]):
        return f"{len(images)} frames, expected {known['frames']}"
    try:
        boxes = boxes_checksum(sequence)
    except ValueError as error:
        return f"other boxes: {error}"
    if boxes != known["boxes sha256"]:
        return "other boxes"
    return "" if images_checksum(images) == known["images sha256"] else "other images"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", help="the folder of the sequences, in the layout of the VOT toolkit")
    parser.add_argument("--folds", nargs=2, metavar=("COUNT", "OUT"), help="write the folds of 35 or 50 sequences, and end")
    arguments = parser.parse_args()
    known = known_sequences()
    if arguments.folds:
        count, out = arguments.folds
        rows = [row for row in known if count == "50" or row["set"] != "3"]
        if str(len(rows)) != count:
            parser.error("--folds: expected 35 or 50")
        Path(out).write_text("".join(f"{row['fold']}\t{row['sequence']}\n" for row in rows), encoding="utf-8")
        return 0
    if arguments.data is None:
        parser.error("which folder?")
    if not arguments.data.is_dir():
        sys.exit(f"sequences.py: {arguments.data}: no such folder")
    found = [(row["sequence"], difference(row, arguments.data / row["sequence"])) for row in known]
    for name, problem in found:
        if problem:
            print(f"{name}: {problem}")
    same = sum(not problem for _, problem in found)
    print(f"{same} of {len(found)} sequences are those of {LIST.name}")
    return same != len(found)


if __name__ == "__main__":
    sys.exit(main())
