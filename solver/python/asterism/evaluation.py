"""Runs of asterism-eval and its results as dictionaries; docs/evaluation.md explains the figures."""

from __future__ import annotations

import contextlib
import csv
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Union

from .names import shown

__all__ = ["load"]  # evaluate is asterism.evaluate

#: A row's cells by column, and where it is in its file ("FILE:LINE").
_Row = tuple[dict[str, str], str]
#: A tracker: a class or function that makes one with init(image, box) and update(image), or a name of asterism-eval, maybe with options.
_Tracker = Union[Callable[[], Any], str]
#: Is set where asterism.evaluate loads the file of a class.
_LOADING = "ASTERISM_EVALUATES"


def evaluate(
    trackers: _Tracker | Iterable[_Tracker] | Mapping[str, _Tracker], data: str | os.PathLike[str], *,
    folder: str | os.PathLike[str] | None = None, **options: Any,
) -> dict[str, Any]:
    """Runs trackers on the annotated sequences of the folder `data` and returns the tables of the report, as `load` does.

        class Still:
            def init(self, image, box):
                self.box = box

            def update(self, image):
                return self.box

        if __name__ == "__main__":
            tables = asterism.evaluate([Still, "dpt_plus"], "sequences", protocol="otb")
            print(tables["summary"]["Still"]["AO"])

    trackers: one or several; a class of yours with init(image, box) and update(image), as asterism.trax describes it, or a name that
    `asterism-eval trackers` lists; in a dict, by the name in the tables. A class must be found by import or in the script that is run:
    processes of their own make its trackers.
    folder: keeps results and report, and resumes what is there; without it, both are deleted in the end.
    options: those of `asterism-eval run` (protocol, starts, sequences, workers, ...); a list stands for values with commas, True for
    an option without a value, False or None for none.

    Needs the program asterism-eval on the PATH (FileNotFoundError). ValueError for a class that other processes cannot find,
    RuntimeError with the program's message where it fails. Progress and warnings of the program go to standard error.
    """
    if _LOADING in os.environ:
        raise RuntimeError('evaluate: called while the file of its class is loaded; call it below `if __name__ == "__main__":`')
    if (program := shutil.which("asterism-eval")) is None:
        raise FileNotFoundError("asterism-eval is not on the PATH; it is built with the benchmarks (docs/evaluation.md)")
    arguments: list[str] = []
    for name, tracker in _named(trackers).items():
        arguments += ["--tracker", f"{name}={tracker}"] if isinstance(tracker, str) else ["--external", f"{name}={_command(tracker)}"]
    if not arguments:
        raise ValueError("evaluate: no tracker")
    for option, value in options.items():
        if value is None or value is False:
            continue
        arguments.append("--" + option.replace("_", "-"))
        if value is not True:
            arguments.append(",".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value))
    with contextlib.nullcontext(os.fspath(folder)) if folder is not None else tempfile.TemporaryDirectory() as results:
        _run([program, "run", os.fspath(data), *arguments, "--out", results])
        _run([program, "report", results])
        return load(results)


def _named(trackers: _Tracker | Iterable[_Tracker] | Mapping[str, _Tracker]) -> Mapping[str, _Tracker]:
    if isinstance(trackers, Mapping):
        return trackers
    if not isinstance(trackers, (str, Iterable)) and not callable(trackers):
        raise TypeError(f"evaluate: expected a class, the name of a tracker, or a list of them, found an object of the type {type(trackers).__name__}")
    named: dict[str, _Tracker] = {}
    for tracker in [trackers] if isinstance(trackers, str) or callable(trackers) else trackers:
        name = tracker if isinstance(tracker, str) else getattr(tracker, "__name__", repr(tracker))
        if name in named:
            raise ValueError(f"evaluate: two trackers with the name '{name}': give a dict with their names")
        named[name] = tracker
    return named


def _command(tracker: Callable[[], Any]) -> str:
    """The command that runs a class of this process in another one."""
    for function in ("init", "update"):
        if isinstance(tracker, type) and not callable(getattr(tracker, function, None)):
            raise ValueError(f"evaluate: the class {tracker.__name__} has no function '{function}'")
    if not isinstance(tracker, type) and callable(getattr(tracker, "init", None)):
        raise ValueError(f"evaluate: expected a class, which is made anew for each sequence, found an instance: give {type(tracker).__name__} itself")
    name, module = getattr(tracker, "__qualname__", ""), getattr(tracker, "__module__", "")
    if not name.isidentifier():
        raise ValueError(f"evaluate: {name or shown(tracker)} has no name at the top level of a module, by which other processes find it")
    if module == "__main__":
        main = sys.modules["__main__"]
        module = main.__spec__.name if main.__spec__ is not None else getattr(main, "__file__", "")
        if not module:
            raise ValueError(f"evaluate: {name} was typed into this session, where other processes do not find it: put it into a file")
    return f"exec {shlex.quote(sys.executable)} -m asterism.trax {shlex.quote(f'{module}:{name}')}"


def _run(command: list[str]) -> None:
    """Runs asterism-eval; what it says on standard error is shown at once, and its last line is the message of an error."""
    environment = os.environ | {_LOADING: "1", "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    said = [""]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            sys.stderr.write(line)
            said.append(line.strip() or said[-1])
    if process.returncode:
        raise RuntimeError(said[-1] or f"asterism-eval ended with exit code {process.returncode}")


def load(folder: str | os.PathLike[str]) -> dict[str, Any]:
    """The tables of a report: `folder` is what `asterism-eval report` was run on, or the report's own.

    - "summary": {tracker: {column: value}}, the columns being measures and, of those with an interval, "MEASURE low" and
      "MEASURE high";
    - "sequences": {tracker: {sequence: {"frames", "A", "F", "AO"}}};
    - "attributes": {tracker: {attribute: {"A", "F", "EAO"}}};
    - "differences": a list of {"measure", "a", "b", "value", "low", "high", "significant"};
    - "curves": {tracker: {curve: [(x, y), ...]}}.

    Values are floats, None where the report has none. A table without a file is left out; FileNotFoundError if there is no
    table at all. ValueError "FILE:LINE: ..." for a file that is not a table of its kind.
    """
    folder = pathlib.Path(folder)
    report = folder / "report" if (folder / "report").is_dir() else folder
    found = {table: report / f"{table}.csv" for table in _TABLES if (report / f"{table}.csv").is_file()}
    if not found:
        raise FileNotFoundError(f"{report}: no report here; `asterism-eval report FOLDER` makes it")
    return {table: _TABLES[table](path) for table, path in found.items()}


def _rows(path: pathlib.Path, columns: list[str]) -> Iterator[_Row]:
    """The rows of a table that begins with these columns."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            header: list[str] = next(reader, [])
            if header[: len(columns)] != columns:
                raise ValueError(f"{path}:1: expected the columns {','.join(columns)}, found {','.join(header)}")
            for cells in reader:
                place = f"{path}:{reader.line_num}"
                if len(cells) != len(header):
                    raise ValueError(f"{place}: expected {len(header)} cells, found {len(cells)}")
                yield dict(zip(header, map(_unmarked, cells))), place
        except csv.Error as error:
            raise ValueError(f"{path}:{reader.line_num}: {error}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}:{reader.line_num + 1}: {error}") from None


def _unmarked(cell: str) -> str:
    """A cell without the apostrophe that keeps spreadsheets from reading text as a formula."""
    return cell[1:] if cell.startswith("'") else cell


def _number(cell: str, column: str, place: str) -> float | None:
    if not cell:
        return None
    try:
        return float(cell)
    except ValueError:
        raise ValueError(f"{place}: {column}: expected a number, found '{cell}'") from None


def _put(table: dict[str, Any], key: str, value: Any, place: str) -> None:
    if key in table:
        raise ValueError(f"{place}: a second row of {key}")
    table[key] = value


def _summary(path: pathlib.Path) -> dict[str, dict[str, float | None]]:
    table: dict[str, dict[str, float | None]] = {}
    for row, place in _rows(path, ["tracker"]):
        tracker = row.pop("tracker")
        _put(table, tracker, {column: _number(cell, column, place) for column, cell in row.items()}, place)
    return table


def _by(key: str, columns: list[str]) -> Callable[[pathlib.Path], dict[str, Any]]:
    """A table of {tracker: {key: {column: value}}}."""

    def read(path: pathlib.Path) -> dict[str, Any]:
        table: dict[str, Any] = {}
        for row, place in _rows(path, ["tracker", key, *columns]):
            values = {column: _number(row[column], column, place) for column in columns}
            _put(table.setdefault(row["tracker"], {}), row[key], values, place)
        return table

    return read


def _differences(path: pathlib.Path) -> list[dict[str, Any]]:
    table = []
    for row, place in _rows(path, ["measure", "a", "b", "value", "low", "high", "significant"]):
        if row["significant"] not in ("yes", "no"):
            raise ValueError(f"{place}: significant: expected yes or no, found '{row['significant']}'")
        difference: dict[str, Any] = dict(row)
        difference.update({column: _number(row[column], column, place) for column in ("value", "low", "high")})
        difference["significant"] = row["significant"] == "yes"
        table.append(difference)
    return table


def _curves(path: pathlib.Path) -> dict[str, dict[str, list[tuple[float | None, float | None]]]]:
    table: dict[str, dict[str, list[tuple[float | None, float | None]]]] = {}
    for row, place in _rows(path, ["tracker", "curve", "x", "y"]):
        point = _number(row["x"], "x", place), _number(row["y"], "y", place)
        table.setdefault(row["tracker"], {}).setdefault(row["curve"], []).append(point)
    return table


_TABLES: dict[str, Callable[[pathlib.Path], Any]] = {
    "summary": _summary,
    "sequences": _by("sequence", ["frames", "A", "F", "AO"]),
    "attributes": _by("attribute", ["A", "F", "EAO"]),
    "differences": _differences,
    "curves": _curves,
}
