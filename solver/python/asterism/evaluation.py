"""Results of asterism-eval as dictionaries; docs/evaluation.md explains the figures."""

from __future__ import annotations

import csv
import os
import pathlib
from typing import Any, Callable, Iterator

#: A row's cells by column, and where it is in its file ("FILE:LINE").
_Row = tuple[dict[str, str], str]


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
