"""asterism-pose: the paths of key-points in files of detections."""

from __future__ import annotations

import argparse
import csv
import os
import pathlib
import sys
from typing import NoReturn, Sequence

import numpy as np

from . import inputs, pose

__all__ = ["main"]

EPILOG = """\
files: DeepLabCut's tables (.csv, .h5), SLEAP's analysis files (.h5, .hdf5), plain tables (.csv: frame, NAME_x, NAME_y, NAME_likelihood).
Two views, with calibration:   asterism-pose left.csv right.csv --cameras calibration.toml --output points.csv
One view, two networks:        asterism-pose first.h5 second.h5 --output points.h5
The exit code is 0, or 1 with one line that says what is wrong."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser("asterism-pose", description=__doc__, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("views", nargs="+", metavar="FILE", help="detections, one file for each camera, or for each detector of one image")
    parser.add_argument("--output", "-o", required=True, metavar="FILE", help="points: .csv in DeepLabCut's form, .h5 in SLEAP's")
    parser.add_argument("--cameras", metavar="TOML", help="aniposelib's calibration: the files are in its order, or named as its cameras are")
    parser.add_argument("--skeleton", metavar="CSV", help="two columns with the names of a limb's joints, a line each")
    parser.add_argument("--times", metavar="FILE", help="times of the frames, a number a line; else the numbers of the frames")
    parser.add_argument("--pairs", metavar="A:B,..", help="left and right that may be swapped; 'names' takes them from the joints' names")
    parser.add_argument("--confidence", action="store_true", help="count likelihoods as the probability that a detection is not an outlier")
    parser.add_argument("--details", metavar="CSV", help="a table with the standard deviations and outliers of every point")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program with these arguments (those of the command line, if None), and returns its exit code."""
    options = _parser().parse_args(arguments)
    try:
        print(_run(options), flush=True)
        return 0
    except KeyboardInterrupt:
        print("asterism-pose: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        message = f"{error.filename or 'standard output'}: {error.strerror or error}"
    except (ValueError, TypeError, ImportError) as error:
        message = str(error)
    print(f"asterism-pose: {message}".replace("\n", " "), file=sys.stderr)
    return 1


def _run(options: argparse.Namespace) -> str:
    """The summary that is printed at the end."""
    _check_outputs(options)
    views = [pose.read_detections(path) for path in options.views]
    first = views[0]
    numbers = [_numbers(path, view.frames) for path, view in zip(options.views, views)][0]
    for path, view in zip(options.views, views):
        if view.points.shape[2] != 2:
            raise ValueError(f"{path}: has points in space, not in an image")
        if view.joints != first.joints:
            raise ValueError(f"{path}: has other joints than {options.views[0]}")
        if len(view.points) != len(first.points):
            raise ValueError(f"{path}: has {inputs.counted(len(view.points), 'frame')}, {options.views[0]} has {len(first.points)}")
    cameras = None if options.cameras is None else _cameras(options.cameras, options.views)
    skeleton = None if options.skeleton is None else _skeleton(options.skeleton, first.joints)
    times = numbers if options.times is None else _times(options.times)
    if options.times is not None and len(times) != len(first.points):
        raise ValueError(f"{options.times}: has {inputs.counted(len(times), 'time')} for {inputs.counted(len(first.points), 'frame')}")
    confidence = np.array([view.confidence for view in views]) if options.confidence else None
    pairs = _pairs(options.pairs, first.joints)
    is_seen = np.array([np.isfinite(view.points[..., 0]) for view in views])
    if (never := np.flatnonzero(~is_seen.any((0, 1)))).size:
        raise ValueError(f"{', '.join(options.views)}: joint {first.joints[never[0]]} is never seen; leave its columns out")
    found = pose.fuse(np.array([view.points for view in views]), confidence, cameras, skeleton, times, pairs)
    pose.write_points(options.output, found.points, first.joints, first.frames)
    if options.details is not None:
        _write_details(options.details, found, first)
    off = np.linalg.norm(np.array([view.points for view in views]) - found.reprojections, axis=-1)[is_seen & ~found.outliers]
    says = (
        f"{options.output}: {inputs.counted(len(first.points), 'frame')}, {inputs.counted(len(first.joints), 'joint')}, "
        f"{found.outliers.sum() / max(is_seen.sum(), 1):.1%} of the detections are outliers"
    )
    if off.size:
        says += f", the others are {np.median(off):.2g} px off (median)"
    return says if not pairs else f"{says}, {found.swapped.any((0, 2)).mean():.1%} of the frames have a swapped pair"


def _check_outputs(options: argparse.Namespace) -> None:
    """ValueError for an output that is one of the inputs or the other output, or whose name promises another format."""
    read = [path for path in (*options.views, options.cameras, options.skeleton, options.times) if path is not None]
    for option, path in (("--output", options.output), ("--details", options.details)):
        if path is not None and any(_are_same(path, other) for other in read):
            raise ValueError(f"{option} {path} would change the input")
        folder = os.path.dirname(path or "") or "."
        if path is not None and not os.path.isdir(folder):
            raise ValueError(f"{option} {path}: no folder {folder}")
        if path is not None and (os.path.isdir(path) or path == "-"):
            raise ValueError(f"{option} {path}: expected the name of a file")
    if options.details is not None and _are_same(options.details, options.output):
        raise ValueError(f"--details {options.details} is the file of --output")
    if pathlib.Path(options.output).suffix.lower() not in ("", ".csv", ".h5", ".hdf5"):
        raise ValueError(f"--output {options.output}: expected a name that ends with .csv, .h5 or .hdf5")


def _numbers(path: str, frames: list[str]) -> list[float] | None:
    """The numbers of the frames, of which some may be left out; None for names. ValueError if they do not rise: such rows are no recording."""
    try:
        numbers = [float(frame) for frame in frames]
    except ValueError:  # of images
        return None
    for before, after in zip(numbers, numbers[1:]):
        if not before < after:
            raise ValueError(f"{path}: expected rising frames, found {after:g} after {before:g}")
    return numbers


def _are_same(path: str, other: str) -> bool:
    """Whether both are names of one file, which need not be there yet."""
    return os.path.realpath(path) == os.path.realpath(other) or os.path.exists(path) and os.path.exists(other) and os.path.samefile(path, other)


def _cameras(path: str, files: list[str]) -> list[pose.Camera]:
    """In the order of the files: by name where every file's name is that of a camera."""
    cameras = pose.read_cameras(path)
    named = {camera.name: camera for camera in cameras}
    stems = [pathlib.Path(file).stem for file in files]
    if all(stem in named for stem in stems):
        return [named[stem] for stem in stems]
    if len(cameras) != len(files):
        raise ValueError(f"{path}: has {inputs.counted(len(cameras), 'camera')} for {inputs.counted(len(files), 'file')}, and the files are not named as they are ({', '.join(camera.name + '.csv' for camera in cameras)})")
    return cameras


def _skeleton(path: str, joints: list[str]) -> list[tuple[int, int]]:
    """A first line without joints' names is a heading."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        try:
            lines = [(number, [cell.strip() for cell in row]) for number, row in enumerate(csv.reader(file), 1) if row]
        except (UnicodeDecodeError, csv.Error):
            raise ValueError(f"{path}: no table of text") from None
    limbs = []
    for number, row in lines:
        if number == 1 and not set(row) & set(joints):
            continue
        unknown = [name for name in row[:2] if name not in joints]
        if len(row) < 2 or unknown:
            raise ValueError(f"{path}:{number}: " + (f"no joint is named {unknown[0]}" if unknown else "expected the names of two joints"))
        limbs.append((joints.index(row[0]), joints.index(row[1])))
    if not limbs:
        raise ValueError(f"{path}: no limbs")
    return limbs


def _times(path: str) -> list[float]:
    with open(path, encoding="utf-8-sig") as file:
        try:
            lines = [(number, line.strip()) for number, line in enumerate(file, 1) if line.strip()]
        except UnicodeDecodeError:
            raise ValueError(f"{path}: not a text file; expected a number a line, as numpy.savetxt writes them") from None
    times = []
    for number, line in lines:
        try:
            times.append(float(line))
        except ValueError:
            raise ValueError(f"{path}:{number}: not a number: {line[:40]!r}") from None
    return times


def _pairs(text: str | None, joints: list[str]) -> list[tuple[int, int]]:
    if text is None:
        return []
    if text == "names":
        pairs = pose.left_right_pairs(joints)
        if not pairs:
            raise ValueError("--pairs names: no two joints' names differ in left and right alone")
        return pairs
    pairs = []
    for pair in text.split(","):
        names = pair.split(":")
        unknown = [name for name in names if name not in joints]
        if len(names) != 2 or unknown:
            raise ValueError(f"--pairs: {pair!r}: " + (f"no joint is named {unknown[0]}" if unknown else "expected LEFT:RIGHT"))
        pairs.append((joints.index(names[0]), joints.index(names[1])))
    return pairs


def _write_details(path: str | os.PathLike[str], found: pose.FusedPose, view: pose.Detections) -> None:
    """One line for each frame and joint."""
    axes = "xyz"[: found.points.shape[2]]
    deviation = np.sqrt(np.diagonal(found.covariance, axis1=2, axis2=3))
    with inputs.whole_file(path) as name, open(name, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["frame", "joint", *axes, *(f"deviation_{axis}" for axis in axes), "outliers"])
        for t, frame in enumerate(view.frames):
            for j, joint in enumerate(view.joints):
                numbers = [repr(float(value)) for value in (*found.points[t, j], *deviation[t, j])]
                table.writerow([frame, joint, *numbers, int(found.outliers[:, t, j].sum())])


if __name__ == "__main__":
    sys.exit(main())
