"""Systems in JSON files; docs/system-json.md is the format."""

from __future__ import annotations

import codecs
import dataclasses
import json
import os
import pathlib
from typing import Any, Iterable

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs


@dataclasses.dataclass
class StoredSystem:
    """A system and the other contents of its file."""

    #: A SpringSystem is version 1 of the format, a System version 2.
    system: _asterism.SpringSystem | _asterism.System
    #: Where a solve starts, (N, dim) [px]; part of the problem.
    start: npt.NDArray[np.float64]
    name: str = ""
    #: Where the system comes from, in any form.
    origin: dict[str, Any] = dataclasses.field(default_factory=dict)


def parse_systems(text: str, source: str = "text") -> list[StoredSystem]:
    """The systems in a text: a JSON object, an array of them, or one per line. ValueError "SOURCE:LINE: ..." for any other."""
    if not isinstance(text, str):
        raise TypeError(f"text: expected str, found {type(text).__name__}")
    if not isinstance(source, str):
        raise TypeError(f"source: expected str, found {type(source).__name__}")
    return _parsed(text, source)


def read_systems(path: str | os.PathLike[str]) -> list[StoredSystem]:
    """The systems in a file, which is UTF-8. OSError if it cannot be read, ValueError as from parse_systems."""
    return _parsed(pathlib.Path(path).read_bytes(), os.fspath(path))


def _parsed(text: str | bytes, source: str) -> list[StoredSystem]:
    source = source.encode("utf-8", "backslashreplace").decode()  # the names of files may be any bytes
    if isinstance(text, bytes) and text.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise ValueError(f"{source}: expected UTF-8, found UTF-16")
    try:
        found = _asterism._parse_systems(text.encode() if isinstance(text, str) else text, source)
    except UnicodeEncodeError as error:
        raise ValueError(f"{source}: not UTF-8: {error.reason}") from None
    return [StoredSystem(system, start, name, json.loads(origin)) for system, start, name, origin in found]


def _to_json(stored: StoredSystem) -> str:
    if not isinstance(stored, StoredSystem):
        raise TypeError(f"systems: expected StoredSystems, found {type(stored).__name__}")
    if not isinstance(stored.name, str):
        raise TypeError(f"the system cannot be written: its name: expected a string, found {inputs.shown(stored.name)}")
    try:
        name, origin = str.encode(stored.name), json.dumps(stored.origin, allow_nan=False)
    except (TypeError, ValueError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(f"the system cannot be written: its name or origin: {error}") from None
    return _asterism._system_to_json(stored.system, stored.start, name, origin) + "\n"


def write_systems(path: str | os.PathLike[str], systems: Iterable[StoredSystem]) -> None:
    """Writes systems to a file, one per line; every number is read back exactly.

    ValueError for values that a solver would refuse, for a term with a function of your own, and for an origin with NaN, infinity or integers of more than 64 bits;
    TypeError for an origin that JSON cannot hold. Then nothing is written.
    """
    lines = [_to_json(stored) for stored in inputs.items(systems, "systems", "a list of StoredSystems")]
    with inputs.whole_file(path) as name:
        pathlib.Path(name).write_text("".join(lines), encoding="utf-8")
