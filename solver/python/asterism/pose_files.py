"""Files of key-points and of calibrations, for asterism.pose."""

from __future__ import annotations

import csv
import dataclasses
import io
import os
import pathlib
import pickle
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from . import inputs
from .cameras import Camera

_Floats = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Detections:
    """The key-points of one file."""

    #: Of the joints.
    joints: list[str]
    #: (T, J, 2), or (T, J, 3) for points in space; NaN where a joint was not seen.
    points: _Floats
    #: (T, J), in [0, 1]; 1 where the file has none.
    confidence: _Floats
    #: What the first column says, one a frame.
    frames: list[str]

    __repr__ = inputs.brief


def read_cameras(path: str | os.PathLike[str]) -> list[Camera]:
    """The cameras of aniposelib's TOML, in the order of the file. OSError if it cannot be read; ValueError that names the file and the camera."""
    import tomllib

    try:
        tables = tomllib.loads(pathlib.Path(path).read_bytes().decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{os.fspath(path)}: not a TOML file: {error}") from None
    cameras = []
    for key, table in tables.items():
        if not isinstance(table, dict) or key == "metadata":
            continue
        try:
            if table.get("fisheye"):
                raise ValueError("fisheye lenses are not supported")
            missing = [field for field in ("matrix", "rotation", "translation") if field not in table]
            if missing:
                raise ValueError(f"no {missing[0]}")
            cameras.append(
                Camera(table["matrix"], table["rotation"], table["translation"], table.get("distortions", ()), table.get("size"), str(table.get("name", key)))
            )
        except (ValueError, TypeError) as error:
            raise ValueError(f"{os.fspath(path)}: {key}: {error}") from None
    if not cameras:
        raise ValueError(f"{os.fspath(path)}: no cameras")
    return cameras


def read_detections(path: str | os.PathLike[str]) -> Detections:
    """Key-points of one view: a table as DeepLabCut writes it (.csv, or .h5), SLEAP's analysis file (.h5, .hdf5), or a plain table.

    The header lines of the first are scorer, individuals (of one animal), bodyparts and coords, of which the first two may be left out; a plain table
    has one line, NAME_x, NAME_y and perhaps NAME_likelihood or NAME_z. HDF5 needs h5py: ImportError without it. OSError if the file cannot be read,
    ValueError with file and line if it is not such a table.
    """
    if pathlib.Path(path).suffix.lower() in (".h5", ".hdf5"):
        return _read_hdf5(path)
    name = os.fspath(path)
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.reader(file)
        try:
            numbered = [(reader.line_num, row) for row in reader if row]
        except (UnicodeDecodeError, csv.Error):
            raise ValueError(f"{name}: no table of text") from None
    rows = [row for _, row in numbered]
    if not rows:
        raise ValueError(f"{name}: empty")
    head = {row[0].strip().lower(): row[1:] for row in rows[:4]}
    if "coords" in head and "bodyparts" in head:
        first = 1 + next(line for line, row in enumerate(rows) if row[0].strip().lower() == "coords")
        columns = list(zip(head["bodyparts"], head["coords"]))
        animals = set(head.get("individuals", ()))
        if len(animals) > 1:
            raise ValueError(f"{name}: expected one animal, found {len(animals)}")
    else:
        _check_plain(rows[0], name)
        first, columns = 1, [tuple(title.rsplit("_", 1)) if "_" in title else (title, "") for title in rows[0][1:]]
    _places(columns, list(dict.fromkeys(joint for joint, _ in columns)), name)
    values = np.full((len(rows) - first, len(columns)), np.nan)
    for found, (number, row) in zip(values, numbered[first:]):
        if len(row) != len(columns) + 1:
            raise ValueError(f"{name}:{number}: expected {len(columns) + 1} cells, found {len(row)}")
        for k, cell in enumerate(row[1:]):
            try:
                found[k] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise ValueError(f"{name}:{number}: not a number: {cell!r}") from None
            if np.isinf(found[k]):
                raise ValueError(f"{name}:{number}: infinite")
    if not len(values):
        raise ValueError(f"{name}: no frames")
    return _of_columns(columns, values, [row[0] for row in rows[first:]], name)


def _check_plain(titles: list[str], name: str) -> None:
    """ValueError for the header line of a plain table that is none, with what it is instead."""
    expected = "expected a header line, frame,NAME_x,NAME_y,.., or those of DeepLabCut"
    if len(titles) == 1:
        other = next((mark for mark in ";\t" if mark in titles[0]), None)
        raise ValueError(f"{name}: {expected}, found {titles[0][:60]!r}" + (f"; cells are separated by commas, not by {other!r}" if other else ""))
    if titles[0].strip().lower().endswith(("_x", "_y")) or titles[0].strip().lower() in ("x", "y"):
        raise ValueError(f"{name}: {expected}; the first column is {titles[0]!r}, where the frame is expected")
    try:
        float(titles[0])
    except ValueError:
        return
    raise ValueError(f"{name}: {expected}, found {','.join(titles)[:60]!r}")


class _Plain(pickle.Unpickler):
    """Lists, tuples, numbers and strings only: a file must not be able to run code."""

    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"{module}.{name} in a list of columns")


def _h5py(path: str | os.PathLike[str]) -> Any:
    try:
        import h5py
    except ImportError:
        raise ImportError(f"{os.fspath(path)}: HDF5 needs the package h5py (Debian: python3-h5py)") from None
    return h5py


def _read_hdf5(path: str | os.PathLike[str]) -> Detections:
    name, h5py = os.fspath(path), _h5py(path)
    with open(path, "rb"):  # h5py's own errors have several lines
        pass
    try:
        file = h5py.File(path, "r")
    except OSError:
        raise ValueError(f"{name}: no HDF5 file") from None
    with file:
        if "tracks" in file and "node_names" in file:
            return _of_sleap(file, name)
        tables = [group for group in file.values() if isinstance(group, h5py.Group) and "table" in group and "non_index_axes" in group.attrs]
        if len(tables) == 1:
            return _of_deeplabcut(tables[0], name)
    raise ValueError(f"{name}: expected SLEAP's analysis file, with tracks and node_names, or one table of DeepLabCut")


def _of_sleap(file: Any, name: str) -> Detections:
    tracks = np.array(file["tracks"], float)  # (tracks, 2, nodes, frames)
    joints = [n.decode() if isinstance(n, bytes) else str(n) for n in file["node_names"]]
    if tracks.ndim != 4 or tracks.shape[1:3] != (2, len(joints)):
        raise ValueError(f"{name}: expected tracks of shape (animals, 2, {len(joints)}, frames), found {tracks.shape}")
    if len(tracks) != 1:
        raise ValueError(f"{name}: expected one animal, found {len(tracks)}")
    if tracks.shape[3] == 0:
        raise ValueError(f"{name}: no frames")
    confidence = np.ones(tracks.shape[:1] + tracks.shape[2:])
    if "point_scores" in file:
        confidence = np.array(file["point_scores"], float)
        if confidence.shape != tracks.shape[:1] + tracks.shape[2:]:
            raise ValueError(f"{name}: expected point_scores of shape {tracks.shape[:1] + tracks.shape[2:]}, found {confidence.shape}")
    confidence = np.clip(np.where(np.isnan(confidence[0].T), 1.0, confidence[0].T), 0, 1)  # scores are heights of a map, which may be above 1
    return Detections(joints, _missing_as_nan(tracks[0].transpose(2, 1, 0)), confidence, [str(t) for t in range(tracks.shape[3])])


def _of_deeplabcut(group: Any, name: str) -> Detections:
    """pandas stores the names of the columns, (scorer, joint, x | y | likelihood) each, as a pickle of tuples of strings."""
    try:
        ((_, columns),) = _Plain(io.BytesIO(bytes(group.attrs["non_index_axes"]))).load()
        pairs = [(str(column[-2]), str(column[-1])) for column in columns]
        table = group["table"][:]
        frames, values = table["index"], np.array(table["values_block_0"], float)
    except (pickle.UnpicklingError, ValueError, TypeError, IndexError, KeyError, EOFError):
        raise ValueError(f"{name}: not DeepLabCut's table; export it as CSV") from None
    if values.shape != (len(frames), len(pairs)):
        raise ValueError(f"{name}: {len(pairs)} columns are named, the table has shape {values.shape}")
    if len({tuple(column[:-2]) for column in columns}) != 1:
        raise ValueError(f"{name}: expected one animal and one scorer")
    if not len(values):
        raise ValueError(f"{name}: no frames")
    return _of_columns(pairs, values, [str(frame) for frame in frames], name)


def _missing_as_nan(points: _Floats) -> _Floats:
    points[np.isnan(points).any(-1)] = np.nan
    return points


def _of_columns(columns: list[tuple[str, str]], values: _Floats, frames: list[str], name: str) -> Detections:
    """Detections from values (T, columns), where a column is a joint's name and x, y, z or likelihood."""
    joints = list(dict.fromkeys(joint for joint, _ in columns))
    place = _places(columns, joints, name)
    axes = ["x", "y"] + (["z"] if (joints[0], "z") in place else [])
    points = _missing_as_nan(np.stack([values[:, [place[joint, axis] for joint in joints]] for axis in axes], -1))
    confidence = np.ones(points.shape[:2])
    for j, joint in enumerate(joints):
        if (joint, "likelihood") in place:
            confidence[:, j] = values[:, place[joint, "likelihood"]]
    return Detections(joints, points, np.where(np.isnan(confidence), 1.0, confidence), frames)


def _places(columns: list[tuple[str, str]], joints: list[str], name: str) -> dict[tuple[str, str], int]:
    place = {column: k for k, column in enumerate(columns)}
    if len(place) < len(columns) or not columns:
        raise ValueError(f"{name}: expected columns x, y and likelihood for each joint, once each")
    axes = ["x", "y"] + (["z"] if any(kind == "z" for _, kind in columns) else [])
    for joint in joints:
        for axis in axes:
            if (joint, axis) not in place:
                raise ValueError(f"{name}: joint {joint} has no column {axis}")
    return place


def write_points(
    path: str | os.PathLike[str], points: npt.ArrayLike, joints: Sequence[str], frames: Sequence[str] | None = None, confidence: npt.ArrayLike | None = None
) -> None:
    """Points (T, J, 2) or (T, J, 3) as a file that read_detections reads; NaN, where a joint was not seen, becomes an empty cell.

    .h5 and .hdf5: SLEAP's analysis file, of points in the image and without frames' names, with h5py (ImportError without it). .csv, or a name
    without an ending: a table in DeepLabCut's form. confidence: (T, J), as likelihood or point_scores. ValueError for other endings, other shapes and
    names that are not different.
    """
    values = inputs.numbers(points, "points", missing=np.nan)
    if values.ndim != 3 or values.shape[2] not in (2, 3):
        raise ValueError(f"points: expected shape (frames, joints, 2 or 3), found {values.shape}")
    joints = inputs.items(joints, "joints", "a list of names")
    if not all(isinstance(joint, str) for joint in joints) or len(joints) != values.shape[1] or len(set(joints)) != len(joints):
        raise ValueError(f"joints: expected {values.shape[1]} different names")
    titles = [str(t) for t in range(len(values))] if frames is None else inputs.items(frames, "frames", "a list of names")
    if len(titles) != len(values):
        raise ValueError(f"frames: expected {len(values)}, found {len(titles)}")
    belief = None if confidence is None else inputs.numbers(confidence, "confidence", values.shape[:2])
    suffix = pathlib.Path(path).suffix.lower()
    if suffix not in ("", ".csv", ".h5", ".hdf5"):
        raise ValueError(f"{os.fspath(path)}: expected a name that ends with .csv, .h5 or .hdf5")
    if suffix in (".h5", ".hdf5"):
        _write_sleap(path, values, joints, belief)
        return
    axes = ["x", "y", "z"][: values.shape[2]]
    if belief is not None:
        values, axes = np.concatenate([values, belief[..., None]], -1), [*axes, "likelihood"]
    with inputs.whole_file(path) as name, open(name, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["scorer", *("asterism" for _ in joints for _ in axes)])
        table.writerow(["bodyparts", *(joint for joint in joints for _ in axes)])
        table.writerow(["coords", *(axis for _ in joints for axis in axes)])
        for title, row in zip(titles, values.reshape(len(values), -1)):
            table.writerow([title, *("" if np.isnan(value) else repr(float(value)) for value in row)])


def _write_sleap(path: str | os.PathLike[str], values: _Floats, joints: Sequence[str], belief: _Floats | None) -> None:
    if values.shape[2] != 2:
        raise ValueError(f"{os.fspath(path)}: SLEAP's form has points in the image only; a name that ends with .csv takes those in space")
    h5py = _h5py(path)
    with inputs.whole_file(path) as name, h5py.File(name, "w") as file:
        file["tracks"] = values.transpose(2, 1, 0)[None]
        file["node_names"] = [joint.encode() for joint in joints]
        file["track_occupancy"] = np.isfinite(values).any((1, 2))[:, None].astype(np.uint8)
        if belief is not None:
            file["point_scores"] = belief.T[None]
