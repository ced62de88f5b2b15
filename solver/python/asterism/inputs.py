"""Numbers, names, symmetric matrices and sparse ones, as every function of the package takes them, the default of threads, and the repr of results."""

from __future__ import annotations

import contextlib
import dataclasses
import operator
import os
import shutil
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ._asterism import _numbers as numbers
from .names import shown

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.intp]

__all__ = ["array", "brief", "by_node", "check_each", "choice", "count", "counted", "entries", "is_sparse", "items", "joint_pairs", "number", "numbers", "pairs_of", "positive", "processors", "shown", "square", "whole_file"]

# numbers(values, name, shape=None, missing=None), which the compiled functions use as well, gives float64 in C order. Masked entries
# become `missing`; where there is none, and for anything else than an array of real numbers, TypeError. ValueError for another shape.


def array(values: Any, name: str, shape: tuple[int, ...], missing: float | None = None) -> _Floats:
    """The numbers as an array of its own."""
    return np.array(numbers(values, name, shape, missing))


def count(value: Any, name: str, least: int = 1) -> int:
    """An integer of at least that."""
    try:
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, found {shown(value)}") from None
    if found < least:
        raise ValueError(f"{name}: expected >= {least}, found {found}")
    if found >= 2**31:
        raise ValueError(f"{name}: expected < 2^31, found {found}")
    return found


def items(values: Any, name: str, expected: str) -> list[Any]:
    """The items of what can be iterated over."""
    try:
        if not isinstance(values, (str, bytes)):
            return list(values)
    except TypeError:
        pass
    raise TypeError(f"{name}: expected {expected}, found {type(values).__name__}")


def choice(value: Any, name: str, among: tuple[Any, ...], note: str = "") -> Any:
    """One of `among`: names, True, False or small integers; a NumPy scalar as Python's own. note: what else the error says."""
    plain = value.item() if isinstance(value, np.generic) else value
    if not isinstance(plain, (bool, int, float, str)) or plain not in among:
        *others, last = map(repr, among)
        raise ValueError(f"{name}: expected {', '.join(others)} or {last}{note}, found {shown(value)}")
    return among[among.index(plain)]


def counted(number: int, what: str) -> str:
    """ "1 node", "2 nodes"."""
    return f"{number} {what}" + "s" * (number != 1)


def number(value: Any, name: str) -> float:
    """A finite number."""
    found = float(numbers(value, name, ()))
    if not np.isfinite(found):
        raise ValueError(f"{name}: expected a finite number, found {found}")
    return found


def positive(value: Any, name: str) -> float:
    """A finite number > 0."""
    found = number(value, name)
    if not found > 0:
        raise ValueError(f"{name}: expected a finite number > 0, found {found}")
    return found


def check_each(values: _Floats, name: str, is_good: Any, expected: str) -> None:
    """ValueError with the first value that is not good, and with its place."""
    if np.all(is_good):
        return
    place = tuple(int(k) for k in np.argwhere(~np.asarray(is_good))[0])
    if not place:
        raise ValueError(f"{name}: expected {expected}, found {values}")
    raise ValueError(f"{name}: expected {expected}, found {values[place]} at [{', '.join(map(str, place))}]")


def brief(result: Any) -> str:
    """The repr of a result, a dataclass, in one line: its numbers and texts, and the shapes of what has more than three numbers."""
    facts = []
    for field in dataclasses.fields(result):
        value = getattr(result, field.name)
        if not field.repr or isinstance(value, str) and not value:
            continue
        if isinstance(value, np.ndarray):
            text = str(tuple(value.shape)) if value.ndim != 1 or len(value) > 3 else np.array2string(value, precision=6, separator=", ")
        elif isinstance(value, float):
            text = f"{value:.6g}"
        else:
            text = f"{len(value)} of them" if isinstance(value, (list, dict)) else str(value)
        facts.append(f"{field.name} {text}")
    place = "asterism.pose" if type(result).__module__.startswith("asterism.pose") else "asterism"
    return f"<{place}.{type(result).__name__}: {', '.join(facts)}>"


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[str]:
    """The name to write to, of a file that becomes `path` when all is written: where writing fails, the old one is still there, or none."""
    target = os.path.realpath(path)
    is_file = os.path.isfile(target) or not os.path.exists(target)  # no device, nor a folder, which nothing opens
    name = f"{target}.{os.getpid()}.part" if is_file else target
    try:
        yield name
        if is_file and os.path.exists(target):
            shutil.copymode(target, name)
        if is_file:
            os.replace(name, target)
    except BaseException as error:
        if is_file:
            with contextlib.suppress(OSError):
                os.remove(name)
        if isinstance(error, OSError):
            error.filename = os.fspath(path)
        raise


def is_sparse(matrix: Any) -> bool:
    """Whether it is a matrix of scipy.sparse."""
    return hasattr(matrix, "tocoo")


def joint_pairs(pairs: Any, name: str, joints: int) -> _Indices:
    """Pairs of two joints (P, 2). ValueError for anything else."""
    try:
        listed = list(pairs)
        found = np.array(listed)
    except (TypeError, ValueError):
        listed, found = [pairs], np.zeros(1)
    if found.size == 0 and found.ndim == 1:
        return np.zeros((0, 2), np.intp)
    expected = f"{name}: expected pairs of the numbers of two joints, 0 to {joints - 1}"
    if found.shape[1:] != (2,) or found.dtype.kind not in "iu":
        raise ValueError(f"{expected}, found {shown(listed[0])}")
    is_good = ((found >= 0) & (found < joints)).all(1) & (found[:, 0] != found[:, 1])
    if not is_good.all():
        raise ValueError(f"{expected}, found {tuple(found[~is_good][0].tolist())}")
    return found.astype(np.intp)


def square(matrix: Any, name: str, hints: dict[int, str] | None = None) -> int:
    """The N of a matrix (N, N). hints: what else to say for another array of so many dimensions."""
    try:
        shape = matrix.shape if hasattr(matrix, "shape") else np.shape(matrix)
    except ValueError:
        raise ValueError(f"{name}: expected shape (N, N), found rows of different lengths") from None
    if len(shape) != 2 or shape[0] != shape[1]:
        raise ValueError(f"{name}: expected shape (N, N), found {tuple(shape) or type(matrix).__name__}{(hints or {}).get(len(shape), '')}")
    return int(shape[0])


def by_node(values: Any, name: str, nodes: list[Any]) -> Any:
    """Values in the order of the nodes, if they are a dict from node to value, in which nodes without a value are NaN; else as they are.

    None for an empty dict. ValueError for a node that is not one of them.
    """
    if not isinstance(values, Mapping):
        return values
    known = set(nodes)
    for node in values:
        if node not in known:
            raise ValueError(f"{name}: {shown(node)} is not a node of the graph")
    if not values:
        return None
    missing = np.full(np.shape(next(iter(values.values()))), np.nan)
    return [values.get(node, missing) for node in nodes]


def entries(matrix: Any, name: str) -> tuple[_Indices, _Indices, _Floats]:
    """Rows, columns and values of the stored entries of a sparse matrix, each once: SciPy sums those that are given twice."""
    coo = matrix.tocoo()
    if coo.data.dtype.kind == "f":  # SciPy cannot sum all of NumPy's types
        coo = coo.astype(np.float64)
    csr = coo.tocsr()
    csr.sum_duplicates()
    coo = csr.tocoo()
    return coo.row.astype(np.intp), coo.col.astype(np.intp), array(coo.data, name, (coo.nnz,))


def pairs_of(matrix: Any, name: str, missing: float) -> tuple[_Indices, _Floats]:
    """The pairs i < j of a symmetric matrix (N, N), (K, 2), and their values; of a sparse one the stored entries of either triangle.

    ValueError if it is not symmetric. Two entries that differ by the rounding of their type count as equal, and give their mean.
    """
    n = square(matrix, name)
    if not is_sparse(matrix):
        values = numbers(matrix, name, (n, n), missing)
        i, j = np.triu_indices(n, 1)
        above, below = values[i, j], values[j, i]
        _check_symmetric(name, i, j, above, below, np.asanyarray(matrix).dtype)
        with np.errstate(invalid="ignore"):
            return np.column_stack([i, j]), np.where(above == below, above, above + (below - above) / 2)
    row, column, values = entries(matrix, name)
    off = row != column
    row, column, values = row[off], column[off], values[off]
    keys = np.minimum(row, column).astype(np.int64) * n + np.maximum(row, column)
    unique, first, place, count = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    i, j = np.divmod(unique, max(n, 1))
    _check_symmetric(name, row, column, values, values[first][place], matrix.dtype)
    return np.column_stack([i, j]).astype(np.intp), np.bincount(place, values, len(unique)) / count


def _check_symmetric(name: str, i: _Indices, j: _Indices, here: _Floats, there: _Floats, dtype: np.dtype[Any]) -> None:
    """here: the entries [i, j]; there: the entries [j, i]."""
    if np.array_equal(here, there):
        return
    size = np.maximum(np.abs(here), np.abs(there))
    with np.errstate(invalid="ignore"):
        rounding = 1e-9 * size
        if dtype.kind == "f":
            rounding = np.maximum(rounding, 8 * np.spacing(size.astype(dtype)).astype(np.float64))
        bad = np.flatnonzero(~((np.abs(here - there) <= rounding) | (np.isnan(here) & np.isnan(there)) | (here == there)))
    if len(bad):
        k = bad[0]
        raise ValueError(
            f"{name}: expected a symmetric matrix, but [{i[k]}, {j[k]}] is {here[k]} and [{j[k]}, {i[k]}] is {there[k]}"
        )
