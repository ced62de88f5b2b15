"""Spring systems in JSON files; docs/system-json.md is the format."""

from __future__ import annotations

import dataclasses
import json
import os
import pathlib
from typing import Any, Iterable

import numpy as np
import numpy.typing as npt

from . import _asterism


@dataclasses.dataclass
class StoredSystem:
    """A spring system and the other contents of its file."""

    system: _asterism.SpringSystem
    #: Where a solve starts, (N, dim) [px]; part of the problem.
    start: npt.NDArray[np.float64]
    name: str = ""
    #: Where the system comes from, in any form.
    origin: dict[str, Any] = dataclasses.field(default_factory=dict)


def parse_systems(text: str, source: str = "text") -> list[StoredSystem]:
    """The systems in a text: a JSON object, an array of them, or one per line. ValueError "SOURCE:LINE: ..." for any other."""
    return [
        StoredSystem(system, start, name, json.loads(origin))
        for system, start, name, origin in _asterism._parse_systems(text, source)
    ]


def read_systems(path: str | os.PathLike[str]) -> list[StoredSystem]:
    """The systems in a file. OSError if it cannot be read, ValueError as from parse_systems."""
    return parse_systems(pathlib.Path(path).read_text(encoding="utf-8"), os.fspath(path))


def write_systems(path: str | os.PathLike[str], systems: Iterable[StoredSystem]) -> None:
    """Writes systems to a file, one per line; every number is read back exactly.

    ValueError for values that a solver would refuse; then nothing is written.
    """
    lines = [
        _asterism._system_to_json(stored.system, stored.start, stored.name, json.dumps(stored.origin)) + "\n"
        for stored in systems
    ]
    pathlib.Path(path).write_text("".join(lines), encoding="utf-8")
