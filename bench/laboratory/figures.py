#!/usr/bin/env python3
"""Draws every figure of the solver laboratory from its stored results, and writes a page of figures and tables.

    figures.py RESULTS_FOLDER --out docs/results/laboratory

reads what `asterism-bench convergence`, `scaling`, `hard`, `minima`, `proof` and `pareto` stored in the folder;
an experiment without results is left out. Each figure goes into --out as PNG, and the page beside that
folder (docs/results/laboratory-tables.md). The same results give the same files, byte for byte. Needs
python3-matplotlib.
"""

import argparse
import itertools
import json
import math
import pathlib
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

try:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np
    from matplotlib import patheffects
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as error:
    sys.exit(f"figures.py: needs matplotlib (Debian package python3-matplotlib): {error}")

Cell = dict[str, Any]
T = TypeVar("T")
EFFORTS = ("loose_iterations", "iterations", "seconds")  # of scaling, one number per system
MINIMA = ("minima", "lowest", "ends")  # of minima
PROOF = ("energies", "bounds", "certified", "solve_seconds")  # of proof

# ------------------------------------------------------------------------------------------------- reading


class BadInput(Exception):
    """What is wrong with the results, in one line."""


@dataclass
class Results:
    """An experiment as stored: its cells, numbers as arrays, and the runs that measured them."""

    name: str
    cells: list[Cell] = field(default_factory=list)
    runs: list[dict] = field(default_factory=list)


def nodes_of(group: str) -> int:
    return int(group.split("/")[1])


def in_order(names: Iterable[str]) -> list[str]:
    """The distinct solvers, in the order of the legend."""
    known = list(STYLES)
    return sorted(set(names), key=lambda name: (known.index(name) if name in known else len(known), name))


def by_kind(
    results: Results, reduce: Callable[[list[Cell]], T]
) -> Iterator[tuple[str, dict[str, dict[str, T]]]]:
    """For each kind of systems, {group: {solver: its reduced cells}}; a group, "lit/4" for instance, is a number
    of nodes."""
    cells: dict[str, dict[str, list[Cell]]] = {}
    for cell in results.cells:
        cells.setdefault(cell["group"], {}).setdefault(cell["solver"], []).append(cell)
    found = {group.split("/")[0] for group in cells}
    for kind in [kind for kind in KINDS if kind in found] + sorted(found - KINDS.keys()):
        groups = sorted((group for group in cells if group.split("/")[0] == kind), key=nodes_of)
        data = {group: common(cells[group]) for group in groups}
        yield kind, {g: {name: reduce(data[g][name]) for name in in_order(data[g])} for g in groups}


def common(cells: dict[str, list[Cell]]) -> dict[str, list[Cell]]:
    """Each solver's cells of the systems that all solvers have, so that results of an interrupted run are
    comparable; all cells if there are no such systems."""

    def systems(cell: Cell) -> str:
        return cell["key"].rpartition("/")[0]

    shared = set.intersection(*({systems(cell) for cell in mine} for mine in cells.values()))
    return {name: [cell for cell in mine if systems(cell) in shared] or mine for name, mine in cells.items()}


def solvers_in(data: dict[str, dict[str, Any]]) -> list[str]:
    return in_order(name for solvers in data.values() for name in solvers)


def joined(cells: list[Cell], name: str) -> np.ndarray:
    return np.concatenate([cell[name] for cell in cells])


def numbers(values: Any, *shape: int) -> np.ndarray:
    """An array of this shape; null, which stands for a value that is not finite, becomes infinity."""
    as_array = np.array(values, dtype=object)
    if as_array.shape != shape:
        raise ValueError
    return np.where(as_array == None, math.inf, as_array).astype(float)  # noqa: E711, element by element


def parse(experiment: str, cell: Cell) -> Cell:
    """The cell with its numbers as arrays; KeyError, TypeError or ValueError if it is not a valid cell."""
    n = cell["systems"]
    if not isinstance(n, int) or n < 1 or not isinstance(cell["solver"] + cell["group"], str):
        raise ValueError
    if experiment != "hard" and not re.fullmatch(r"[a-z]+/\d+", cell["group"]):
        raise ValueError
    result = dict(cell)
    if experiment == "convergence":
        looks = len(cell["looks"])
        result["looks"] = numbers(cell["looks"], looks)
        result["remaining"] = numbers(cell["remaining"], looks)
        result["gaps"] = [Counter({int(b): int(count) for b, count in look.items()}) for look in cell["gaps"]]
        if any(sum(look.values()) != n for look in result["gaps"]) or len(result["gaps"]) != looks:
            raise ValueError
    elif experiment == "scaling":
        for name in EFFORTS:
            result[name] = numbers(cell[name], n)
        result["gap"] = float(cell["gap"])
    elif experiment == "hard":
        result["energies"] = numbers(cell["energies"], n)
        result["level"] = float(cell["level"])
        if len(cell["statuses"]) != n or len(cell["iterations"]) != n or not isinstance(cell["case"], str):
            raise ValueError
        points = len(cell["end"])
        for name in ("anchors", "start", "end"):
            result[name] = numbers(cell[name], points, 2)
    elif experiment == "minima":
        for name in MINIMA:
            result[name] = numbers(cell[name], n)
        result["weakness"] = float(cell["weakness"])
    elif experiment == "proof":
        for name in PROOF:
            result[name] = numbers(cell[name], n)
        result["weakness"] = float(cell["weakness"])
    else:
        looks = len(cell["tolerances"])
        for name in ("gaps", "seconds"):
            result[name] = numbers(cell[name], looks, len(cell[name][0]))
    return result


def read_file(path: pathlib.Path) -> Results:
    results = Results(path.stem)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8'}") from error
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        try:
            entry = json.loads(line)
        except ValueError as error:
            if number == len(lines):  # what an interrupted run was writing, or nothing
                break
            raise BadInput(f"{path}, line {number}: not JSON") from error
        try:
            if "machine" in entry:
                if entry["run"] != len(results.runs) or not isinstance(entry["machine"], dict):
                    raise ValueError
                if not isinstance(entry["command"] + entry["started"], str):
                    raise ValueError
                results.runs.append({name: entry[name] for name in ("machine", "command", "started")})
            else:
                if not 0 <= entry["run"] < len(results.runs) or not isinstance(entry["key"], str):
                    raise ValueError
                results.cells.append(parse(results.name, entry))
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            raise BadInput(f"{path}, line {number}: neither a run nor a cell of {results.name}") from error
    results.cells = without_repeats(results.cells)
    used = sorted({cell["run"] for cell in results.cells})
    results.runs = [results.runs[run] for run in used]
    return results


def without_repeats(cells: list[Cell]) -> list[Cell]:
    """The cells with each system once, from the largest cell that has it: a file keeps the results of earlier
    settings, for instance with fewer systems."""
    taken: dict[tuple, list[range]] = {}
    kept = []
    for cell in sorted(cells, key=lambda cell: -cell["systems"]):
        match = re.search(r"/(\d+)\+(\d+)/[^/]*$", cell["key"])
        first = int(match[1]) if match else 0
        mine = range(first, first + cell["systems"])
        others = taken.setdefault((cell["group"], cell["solver"], cell.get("weakness")), [])
        if not any(mine.start < other.stop and other.start < mine.stop for other in others):
            others.append(mine)
            kept.append(cell)
    return sorted(kept, key=cells.index) if len(kept) < len(cells) else cells


def read(folder: pathlib.Path) -> list[Results]:
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder")
    found = [
        read_file(folder / f"{name}.jsonl") for name in EXPERIMENTS if (folder / f"{name}.jsonl").exists()
    ]
    found = [results for results in found if results.cells]
    if not found:
        raise BadInput(f"{folder}: no results of asterism-bench")
    return found


# ------------------------------------------------------------------------------------------------- drawing


@dataclass(frozen=True)
class Style:
    label: str
    color: str
    line: Any
    marker: str


# The solvers that are drawn in color unless --solvers names others. Colors differ in luminance, and dashes and
# markers in shape, so that lines can be told apart on gray paper and by color-blind readers.
STYLES = {
    "ida": Style("IDA", "#111111", "-", "o"),
    "ncg": Style("nonlinear CG", "#c8252c", (0, (5, 2)), "s"),
    "ncg-forward": Style("CG (numeric)", "#f2994a", (0, (5, 1.5, 1, 1.5)), "^"),
    "newton": Style("Newton", "#0a4f94", "-", "D"),
    "newton-cg": Style("Newton-CG", "#58b5e8", (0, (4, 1.5)), "X"),
    "lbfgs": Style("L-BFGS", "#1f9a82", "-", "v"),
    "auto": Style("Auto", "#6f3f98", (0, (1, 1.2)), "P"),
    "schwarz": Style("Schwarz", "#7d5a12", "-", "h"),
    "ida-relaxed": Style("relaxed IDA", "#7a7a7a", (0, (3, 1.5)), "<"),
    "liblbfgs": Style("liblbfgs", "#a99a00", (0, (6, 1.5, 1, 1.5)), "*"),
    "ceres-dense": Style("Ceres LM", "#d684b5", (0, (2, 1.2)), "p"),
    "multi-start": Style("several starts", "#8c2d5a", (0, (1, 1.5)), "d"),
    "staircase": Style("staircase", "#3f7d20", (0, (7, 2)), ">"),
    "branch-and-bound": Style("branch and bound", "#4a6fe3", (0, (3, 1, 1, 1)), "H"),
}
EXTRA_STYLES = (  # for others that --solvers names
    Style("", "#00788a", (0, (7, 2)), "4"),
    Style("", "#5a4fcf", (0, (1, 1.5)), "1"),
    Style("", "#8a6d6d", (0, (3, 1, 1, 1)), "2"),
    Style("", "#b86b00", (0, (5, 1)), "8"),
)
KINDS = {
    "lit": "Random systems (lit)",
    "orig": "Random systems, anchors from nodes before displacement (orig)",
    "disp": "Random systems, stiffness from lengths after displacement (disp)",
    "track": "Systems as a tracker makes (track)",
    "real": "Systems recorded from a tracker (real)",
    "sparse": "Sparse systems",
}
GRAY = "#c4c4c4"
BEFORE, AFTER, NODE = "#58a6e0", "#b3151f", "#2f9e44"  # of a drawn system
WIDTH = 7.6  # inches: the width of a page
LEGEND_COLUMNS = 4
BANDS = ("ida", "ncg")  # the paper's two, whose spread is a band; more than two bands would hide each other
HALO = [patheffects.withStroke(linewidth=2.2, foreground="white")]
LEAST_GAP = 1e-16  # lowest bin of the stored histograms

SETTINGS = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "lines.markersize": 4,
    "savefig.dpi": 160,
}


class Palette:
    """Which solvers are drawn in color, and how."""

    def __init__(self, chosen: list[str] | None):
        self.chosen = chosen
        unnamed = [name for name in chosen or [] if name not in STYLES]
        self.extra = dict(zip(unnamed, EXTRA_STYLES * (1 + len(unnamed) // len(EXTRA_STYLES))))

    def in_color(self, name: str) -> bool:
        return name in (STYLES if self.chosen is None else self.chosen)

    def __call__(self, name: str) -> dict[str, Any]:
        """Arguments of Axes.plot."""
        if not self.in_color(name):
            return {"color": GRAY, "linewidth": 0.8, "zorder": 1.5}
        style = STYLES.get(name) or self.extra[name]
        front = 4 if name == "ida" else 3 if name == "ncg" else 2
        return {
            "color": style.color,
            "linestyle": style.line,
            "marker": style.marker,
            "zorder": front,
            "markeredgecolor": "white",
            "markeredgewidth": 0.4,
        }


def label_of(name: str) -> str:
    return STYLES[name].label if name in STYLES else name


@dataclass
class Drawing:
    """A figure, and its text on the page."""

    name: str
    figure: Figure
    title: str  # what is seen
    caption: str  # how to read it


def panels(
    count: int,
    columns: int,
    height: float,
    title: str,
    handles: list[plt.Line2D] | None = None,
    right: float = 0.15,
    gap: float = 0.75,
) -> tuple[Figure, list[Axes]]:
    """A page-wide figure of `count` axes of a height [inch] under a title and a legend, with `right` beside each
    for labels and `gap` for the next one's axis."""
    rows = -(-count // columns)
    left, bottom, line = 0.72, 0.55, 0.17
    title = textwrap.fill(title, 84)
    text = 0.1 + line * (1 + title.count("\n"))
    legend = 0.1 + line * -(-len(handles) // LEGEND_COLUMNS) if handles else 0.0
    head = text + legend + 0.3
    step = (WIDTH - left + gap - 0.1) / columns
    tall = head + rows * (height + bottom + 0.25) - 0.2
    figure = plt.figure(figsize=(WIDTH, tall))
    bold = {"fontsize": 10, "fontweight": "bold", "linespacing": 1.25}
    figure.text(0.1 / WIDTH, 1 - 0.09 / tall, title, va="top", **bold)
    if handles:
        figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(0.1 / WIDTH, 1 - (text + 0.08) / tall),
            ncol=LEGEND_COLUMNS,
            handlelength=3.2,
            columnspacing=1.6,
            borderaxespad=0,
            borderpad=0,
        )
    axes = []
    for index in range(count):
        row, column = divmod(index, columns)
        low = tall - head - row * (height + bottom + 0.25) - height
        box = (left + column * step, low, step - gap - right + 0.1, height)
        axes.append(figure.add_axes([value / size for value, size in zip(box, (WIDTH, tall, WIDTH, tall))]))
    return figure, axes


def legend_of(names: list[str], palette: Palette) -> list[plt.Line2D]:
    """A line for each solver in color, and one for all others."""
    colored = [name for name in names if palette.in_color(name)]
    lines = [plt.Line2D([], [], label=label_of(name), **palette(name)) for name in colored]
    if len(colored) < len(names):
        count = len(names) - len(colored)
        others = "1 other" if count == 1 else f"{count} others"
        lines.append(plt.Line2D([], [], color=GRAY, linewidth=0.8, label=others))
    return lines


def label_ends(axes: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Writes the names of lines (x, y, text, color) at their ends; those at the right edge beside it, moved
    apart if they would overlap. Positions are fractions of the axes, which do not depend on the resolution."""
    apart = 10.5 / 72 * axes.figure.dpi / axes.get_window_extent().height
    beside = 1 + 0.15 * axes.figure.dpi / axes.get_window_extent().width  # [inch]
    to_fraction = axes.transData + axes.transAxes.inverted()
    points = [(*to_fraction.transform((x, y)), text, color) for x, y, text, color in ends]
    edge = sorted((point for point in points if point[0] > 0.9), key=lambda point: point[1])
    heights = [point[1] for point in edge]
    for _ in range(500):  # neighbours that overlap move by half of it each
        for k in range(len(heights) - 1):
            overlap = apart - (heights[k + 1] - heights[k])
            if overlap > 0:
                heights[k] -= overlap / 2
                heights[k + 1] += overlap / 2
    fractions = {"xycoords": "axes fraction", "textcoords": "axes fraction", "annotation_clip": False}
    font = {"fontsize": 8, "va": "center"}
    for (x, y, text, color), height in zip(edge, heights):
        line = {"arrowstyle": "-", "color": color, "linewidth": 0.6, "relpos": (0, 0.5)}
        line |= {"shrinkA": 0, "shrinkB": 3}
        axes.annotate(text, (x, y), (beside, height), color=color, arrowprops=line, **font, **fractions)
    for x, y, text, color in points:
        if x <= 0.9:
            place = {"transform": axes.transAxes, "zorder": 6, "path_effects": HALO}
            axes.text(x + 0.03, y, text, color=color, **font, **place)


def band(axes: Axes, x: np.ndarray, low: np.ndarray, high: np.ndarray, color: str) -> None:
    axes.fill_between(x, low, high, color=color, alpha=0.13, linewidth=0)


def plain_ticks(axes: Axes) -> None:
    """Decimal labels on a log axis, which may span a decade or less."""
    low, high = axes.get_ylim()
    for digits in ((1, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 5), (1,)):
        ticks = [
            digit * 10.0**e for e in range(-6, 7) for digit in digits if low <= digit * 10.0**e <= high
        ]
        if len(ticks) <= 7:
            break
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


# --------------------------------------------------------------------------------------- numbers and words


def percentile(values: np.ndarray, p: float) -> float:
    """As in measure.cpp: one of the values."""
    return float(np.sort(values)[int(p * (len(values) - 1))])


def exponent_of(value: float) -> int | None:
    """3 for 1000; None if the value is not a power of ten."""
    exponent = round(math.log10(value))
    return exponent if math.isclose(value, 10.0**exponent, rel_tol=1e-9) else None


def tick(value: float) -> str:
    exponent = exponent_of(value)
    return f"{value:g}" if exponent in (None, 0) else f"$10^{{{exponent}}}$"


def short(value: float) -> str:
    """1e-6, 0.1, 30."""
    exponent = exponent_of(value)
    return f"{value:g}" if exponent is None or abs(exponent) < 2 else f"1e{exponent}"


def percent(share: float) -> str:
    """With a no-break space before the sign."""
    digits = f"{100 * share:.1g}" if 0 < share < 0.01 else f"{100 * share:.0f}"
    return digits + "\N{NO-BREAK SPACE}%"


def time(seconds: float) -> str:
    for unit, scale in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)):
        if seconds < 999.5 * scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds:.3g} s"


def what(kind: str) -> str:
    """The name of a kind of systems, as the beginning of a title."""
    return KINDS.get(kind, f"Systems of kind {kind}")


def paragraph(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False) + "\n"


def table(header: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in [header, *rows]]
    lines.insert(1, "|---|" + "---:|" * (len(header) - 1))
    return "\n".join(lines) + "\n"


def table_of_groups(kind: str, data: dict[str, dict[str, T]], text: Callable[[T], str]) -> str:
    """Solvers by numbers of nodes."""
    rows = [
        [f"`{name}`"] + [text(solvers[name]) if name in solvers else "" for solvers in data.values()]
        for name in solvers_in(data)
    ]
    return table([kind, *(str(nodes_of(group)) for group in data)], rows)


# --------------------------------------------------------------------------------------------- convergence

CONVERGENCE_CAPTION = """Left: the mean share of the starting energy that remains, E / E_0, after each of the
first iterations. Right: the median relative gap, (E - E_end) / E_end, to the energy at which the solver itself
ends. Bands, for IDA and nonlinear CG only: 5 to 95 % of the systems."""


@dataclass
class Curve:
    """A solver's remaining energy and gap after given iterations, over the systems of a group."""

    looks: np.ndarray  # iterations
    remaining: np.ndarray  # mean of E / E_0 at each
    gaps: list[Counter]  # number of systems by the bin of their gap
    systems: int

    @staticmethod
    def of(cells: list[Cell]) -> "Curve":
        looks = cells[0]["looks"]
        cells = [cell for cell in cells if np.array_equal(cell["looks"], looks)]
        systems = sum(cell["systems"] for cell in cells)
        remaining = sum(cell["remaining"] for cell in cells) / systems
        gaps = [sum((cell["gaps"][k] for cell in cells), Counter()) for k in range(len(looks))]
        return Curve(looks, remaining, gaps, systems)

    def gap(self, p: float) -> np.ndarray:
        """Percentile of the relative gap at each look, from bins of a twentieth of a decade."""
        result = []
        for bins in self.gaps:
            below = 0
            for at in sorted(bins):
                below += bins[at]
                if below >= p * self.systems:
                    break
            result.append(0.0 if at == 0 else LEAST_GAP * 10 ** ((at - 0.5) / 20))
        return np.array(result)

    def iterations_to(self, gap: float) -> str:
        reached = np.flatnonzero(self.gap(0.5) <= gap)
        return f"{self.looks[reached[0]]:.0f}" if len(reached) else "-"


def draw_convergence(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind, data in by_kind(results, Curve.of):
        title = convergence_title(kind, data)
        figure, axes = panels(2 * len(data), 2, 1.75, title, legend_of(solvers_in(data), palette))
        for left, right, group in zip(axes[::2], axes[1::2], data):
            last = 10.0
            for name, curve in data[group].items():
                style = palette(name)
                early = curve.looks <= 20
                left.plot(curve.looks[early], curve.remaining[early], **style)
                median = curve.gap(0.5)
                end = int(np.argmax(median == 0)) if (median == 0).any() else len(median) - 1
                last = max(last, curve.looks[end])
                shown = slice(1, end + 1)
                right.plot(curve.looks[shown], np.maximum(median[shown], LEAST_GAP), markevery=2, **style)
                if name in BANDS and palette.in_color(name):
                    low, high = (np.maximum(curve.gap(p)[1:], LEAST_GAP) for p in (0.05, 0.95))
                    band(right, curve.looks[1:], low, high, style["color"])
            left.set(yscale="log", xlim=(0, 20), xlabel="iterations", ylabel="mean of $E / E_0$")
            left.set_xticks(range(0, 21, 5))
            left.set_title(f"{nodes_of(group)} nodes: energy that remains")
            plain_ticks(left)
            right.set(xscale="log", yscale="log", xlim=(1, 1.1 * last), ylim=(LEAST_GAP, 100))
            right.set(xlabel="iterations", ylabel="relative gap")
            right.set_yticks([10.0**e for e in range(-16, 1, 4)])
            right.set_title(f"{nodes_of(group)} nodes: gap, median")
        drawings.append(Drawing(f"convergence-{kind}", figure, title, CONVERGENCE_CAPTION))
    return drawings


def convergence_title(kind: str, data: dict[str, dict[str, Curve]]) -> str:
    parts = []
    for group, curves in data.items():
        if {"ida", "ncg"} <= curves.keys():
            ida, ncg = curves["ida"], curves["ncg"]
            below = np.flatnonzero(ncg.remaining < ida.remaining * (1 - 1e-6))
            when = f"{ida.looks[below[0]]:.0f}" if len(below) else "none"
            parts.append(f"{when} with {nodes_of(group)}{'' if parts else ' nodes'}")
    if not parts:
        return f"{what(kind)}: energy against iterations"
    return f"{what(kind)}: nonlinear CG's mean energy falls below IDA's at iteration {', '.join(parts)}"


def tabulate_convergence(results: Results) -> str:
    rows = []
    for _, data in by_kind(results, Curve.of):
        for group, curves in data.items():
            for name, curve in curves.items():
                at = {int(k): f"{value:.4f}" for k, value in zip(curve.looks, curve.remaining)}
                row = [f"{group} `{name}`", *(at.get(k, "-") for k in (1, 3, 5, 10))]
                row += [curve.iterations_to(gap) for gap in (1e-2, 1e-6, 1e-10)]
                rows.append([*row, str(curve.systems)])
    note = """Columns: mean E / E_0 after 1, 3, 5 and 10 iterations; iterations until the median gap is below
1e-2, 1e-6 and 1e-10; number of systems. Rows: kind of system, number of nodes, solver."""
    return paragraph(note) + "\n" + table(["", "1", "3", "5", "10", "1e-2", "1e-6", "1e-10", "systems"], rows)


# ------------------------------------------------------------------------------------------------- scaling

SCALING_CAPTION = """Iterations and CPU time (setup included) until the energy is within a relative gap of {gap}
of the energy at which the solver itself ends{loose}. Bands (IDA and nonlinear CG) and bars (the others) show the
standard deviation of the iterations and 5 to 95 % of the times. Systems in which a solver does not reach the gap
are left out."""
LOOSE_CAPTION = ", and iterations until one lowers the energy by less than 1 %"


@dataclass
class Effort:
    """A solver's effort to reach the gap, in those systems of a group in which it does."""

    loose: np.ndarray  # iterations until one gains less than 1 %
    iterations: np.ndarray  # to the gap
    seconds: np.ndarray
    failed: int

    @staticmethod
    def of(cells: list[Cell]) -> "Effort":
        loose, iterations, seconds = (joined(cells, name) for name in EFFORTS)
        arrived = iterations >= 0
        return Effort(loose[loose >= 0], iterations[arrived], seconds[arrived], int((~arrived).sum()))

    def middle_and_bar(self, quantity: str) -> tuple[float, float, float]:
        values = getattr(self, quantity)
        if quantity == "seconds":
            return percentile(values, 0.5), percentile(values, 0.05), percentile(values, 0.95)
        mean, deviation = values.mean(), values.std()
        return mean, max(mean - deviation, 0.3), mean + deviation  # above 0, for the logarithm


def draw_scaling(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    gap = short(results.cells[0]["gap"])
    quantities = {
        "loose": ("until one gains less than 1 %", "iterations, mean and s.d."),
        "iterations": (f"to a relative gap of {gap}", "iterations, mean and s.d."),
        "seconds": (f"to a relative gap of {gap}", "CPU time [s], median and 5 to 95 %"),
    }
    for kind, data in by_kind(results, Effort.of):
        names, title = solvers_in(data), scaling_title(kind, data)
        # Loose stops are not measured beyond 1000 nodes.
        with_loose = sum(any(len(effort.loose) for effort in efforts.values()) for efforts in data.values())
        drawn = [q for q in quantities if q != "loose" or with_loose >= min(2, len(data))]
        handles = legend_of(names, palette)
        if len(drawn) == 3:  # the legend takes the fourth place
            figure, axes = panels(4, 2, 2.3, title)
            axes[3].axis("off")
            axes[3].legend(handles=handles, loc="center left", handlelength=3.4, labelspacing=0.8)
        else:
            figure, axes = panels(2, 2, 2.3, title, handles)
        sizes = [nodes_of(group) for group in data]
        margin = 1.25 if len(sizes) > 1 else 2
        width = math.log10(max(sizes) / min(sizes) * margin**2)  # decades
        labelled = sizes[:: -(-len(sizes) // 7)]
        for at, quantity in zip(axes, drawn):
            heading, unit = quantities[quantity]
            at.set(xscale="log", yscale="log", xlabel="nodes", ylabel=unit)
            at.set(xlim=(min(sizes) / margin, max(sizes) * margin))
            at.set_title(heading)
            for order, name in enumerate(names):  # bars beside each other
                draw_effort(at, quantity, name, data, palette, 0.008 * (order - len(names) / 2) * width)
            at.set_xticks(labelled, [tick(n) if n >= 10000 else str(n) for n in labelled])
            at.minorticks_off()
            if quantity != "seconds":
                at.set_ylim(bottom=1)
                plain_ticks(at)
        caption = SCALING_CAPTION.format(gap=gap, loose=LOOSE_CAPTION if "loose" in drawn else "")
        drawings.append(Drawing(f"scaling-{kind}", figure, title, caption))
    return drawings


def draw_effort(
    axes: Axes, quantity: str, name: str, data: dict[str, dict[str, Effort]], palette: Palette, dodge: float
) -> None:
    """Draws a solver's line; its bars are `dodge` decades to the right."""
    points = [
        (nodes_of(group), *efforts[name].middle_and_bar(quantity))
        for group, efforts in data.items()
        if name in efforts and len(getattr(efforts[name], quantity))
    ]
    if not points:
        return
    x, middle, low, high = np.array(points).T
    style = palette(name)
    axes.plot(x, middle, **style)
    if name in BANDS and palette.in_color(name) and len(x) > 1:
        band(axes, x, low, high, style["color"])
    elif palette.in_color(name):
        axes.vlines(x * 10**dodge, low, high, color=style["color"], linewidth=0.7, alpha=0.8, zorder=1.8)


def scaling_title(kind: str, data: dict[str, dict[str, Effort]]) -> str:
    groups = list(data)
    ends = groups if len(groups) == 1 else [groups[0], groups[-1]]
    nodes = " and ".join(str(nodes_of(group)) for group in ends)
    parts = []
    for name in ("ida", "ncg"):
        arrived = [data[group][name].iterations for group in ends if name in data[group]]
        if len(arrived) == len(ends) and all(map(len, arrived)):
            parts.append(f"{label_of(name)} {' and '.join(f'{counts.mean():.0f}' for counts in arrived)}")
    if len(parts) == 2:
        return f"{what(kind)}: mean iterations at {nodes} nodes, {', '.join(parts)}"
    times = {name: percentile(e.seconds, 0.5) for name, e in data[ends[-1]].items() if len(e.seconds)}
    if not times:
        return f"{what(kind)}: no solver arrives at {nodes_of(ends[-1])} nodes"
    best = min(times, key=times.get)
    return f"{what(kind)}: {label_of(best)} is the fastest at {nodes_of(ends[-1])} nodes, {time(times[best])}"


def tabulate_scaling(results: Results) -> str:
    def text(effort: Effort) -> str:
        if len(effort.iterations) == 0:
            return f"none of {effort.failed}"
        failed = f" ({effort.failed} failed)" if effort.failed else ""
        mean, deviation = effort.iterations.mean(), effort.iterations.std()
        return f"{mean:.0f} ± {deviation:.0f}, {time(percentile(effort.seconds, 0.5))}{failed}"

    gap = short(results.cells[0]["gap"])
    note = f"""Cells: iterations to a gap of {gap}, mean ± standard deviation, and median CPU time. Columns: number
of nodes."""
    tables = [table_of_groups(kind, data, text) for kind, data in by_kind(results, Effort.of)]
    return "\n".join([paragraph(note), *tables])


# ---------------------------------------------------------------------------------------------------- hard

FAR = 0.01  # relative excess over the lowest energy found that counts as a failure
COMPARED = ("ida", "ncg", "ncg-forward")  # by the paper's Figure 8
LEVEL_NAMES = {
    "near-coincident": "rest length of the pair",
    "weak-anchors": "factor on the anchors' stiffness",
    "stiff-pair": "factor on a link's stiffness",
    "saddle": "factor on the anchors' stiffness",
}
HARD_CAPTION = """The relative excess of a solver's final energy over the lowest energy that any solver found
for the same system (the lowest line means 1e-16 or less), and the share of systems in which it is above 1 %.
Systems become harder to the right. Solvers stop at stationarity 1e-8 or after 10,000 iterations. If anchors have
less than 1e-8 of the links' stiffness, the tolerance is met before the anchors have any effect."""
NEAR_COINCIDENT_CAPTION = """The first of the near-coincident systems, drawn as in the paper's Figure 8: the rest
length between the first two nodes is {level}. Shown are the system before and after optimisation, and the energy
that remains."""


@dataclass
class Level:
    """A case at a level: each solver's excess over the lowest energy that any solver found for the same system."""

    level: float
    excess: dict[str, np.ndarray]

    def failures(self, name: str) -> float:
        return float((self.excess[name] > FAR).mean())


def hard_cases(results: Results) -> dict[str, list[Level]]:
    """Levels of each case, from the least to the hardest."""
    cases: dict[str, list[Level]] = {}
    for group in dict.fromkeys(cell["group"] for cell in results.cells):
        cells = [cell for cell in results.cells if cell["group"] == group]
        best = np.full(max(cell["systems"] for cell in cells), math.inf)
        for cell in cells:
            n = cell["systems"]
            best[:n] = np.minimum(best[:n], cell["energies"])
        best = np.clip(best, 1e-300, 1e300)
        excess = {cell["solver"]: cell["energies"] / best[: cell["systems"]] - 1 for cell in cells}
        cases.setdefault(cells[0]["case"], []).append(Level(cells[0]["level"], excess))
    for levels in cases.values():
        levels.sort(key=lambda level: abs(math.log10(level.level)))
    return cases


def draw_hard(results: Results, palette: Palette) -> list[Drawing]:
    cases = hard_cases(results)
    names = in_order(cell["solver"] for cell in results.cells)
    title = hard_title(cases)
    figure, axes = panels(2 * len(cases), 2, 1.45, title, legend_of(names, palette))
    for left, right, (case, levels) in zip(axes[::2], axes[1::2], cases.items()):
        for name in reversed(names):  # the first in front
            x = [k for k, level in enumerate(levels) if name in level.excess]
            medians = [percentile(levels[k].excess[name], 0.5) for k in x]
            left.plot(x, np.clip(medians, LEAST_GAP, 1e8), clip_on=False, **palette(name))
            right.plot(x, [100 * levels[k].failures(name) for k in x], clip_on=False, **palette(name))
        for at in (left, right):
            at.set_xticks(range(len(levels)), [tick(level.level) for level in levels])
            at.set(xlim=(-0.15, len(levels) - 0.85), xlabel=LEVEL_NAMES.get(case, "level"))
        highest = max(percentile(excess, 0.5) for level in levels for excess in level.excess.values())
        top = min(max(10.0, 10 * highest), 1e8)
        left.set(yscale="log", ylim=(LEAST_GAP, top), ylabel="relative excess")
        left.set_yticks([10.0**e for e in range(-16, 9, 4) if 10.0**e <= top])
        left.set_title(f"{case}: median excess over the lowest")
        right.set(ylim=(0, 100), ylabel="systems [%]")
        right.set_title(f"{case}: > {percent(FAR)} above the lowest")
    drawings = [Drawing("hard", figure, title, HARD_CAPTION)]
    by_level: dict[float, dict[str, Cell]] = {}
    for cell in results.cells:
        if cell["case"] == "near-coincident" and cell["solver"] in COMPARED:
            by_level.setdefault(cell["level"], {})[cell["solver"]] = cell
    complete = [cells for cells in by_level.values() if len(cells) == len(COMPARED)]
    if complete:
        drawings.append(draw_near_coincident(max(complete, key=numeric_over_ida)))
    return drawings


def hard_title(cases: dict[str, list[Level]]) -> str:
    levels = cases.get("near-coincident", [])
    parts = [
        f"{label_of(name)} {percent(max(level.failures(name) for level in levels))}"
        for name in COMPARED
        if levels and all(name in level.excess for level in levels)
    ]
    if not parts:
        return "Hard cases: excess over the lowest energy found"
    return (
        f"Nodes that nearly coincide, systems that end far above the lowest energy: up to {', '.join(parts)}"
    )


def numeric_over_ida(cells: dict[str, Cell]) -> float:
    """Final energy of CG with numeric gradients over that of IDA, for the system that is drawn."""
    return float(cells["ncg-forward"]["energies"][0] / max(cells["ida"]["energies"][0], 1e-300))


def draw_near_coincident(cells: dict[str, Cell]) -> Drawing:
    """The paper's Figure 8."""
    level = short(cells["ida"]["level"])
    ratio = f"{numeric_over_ida(cells):.3g}"
    title = f"Two nodes to be {level} apart: {label_of('ncg-forward')} ends at {ratio} times IDA's energy"
    lines = {
        "before": {"color": BEFORE, "linestyle": "--", "linewidth": 1},
        "after": {"color": AFTER, "linestyle": "-", "linewidth": 1.5},
        "anchors, springs to them": {"color": "black", "linestyle": ":", "linewidth": 1},
    }
    dots = {
        "before": {"marker": "o", "markerfacecolor": "white", "markeredgecolor": BEFORE, "markersize": 4.5},
        "after": {"marker": "o", "markerfacecolor": NODE, "markeredgecolor": "black", "markersize": 6},
        "anchors, springs to them": {"marker": "x", "markeredgecolor": "black", "markeredgewidth": 1.6},
    }
    handles = [plt.Line2D([], [], label=label, **lines[label], **dots[label]) for label in lines]
    figure, axes = panels(3, 3, 1.92, title, handles, gap=0.5)
    everything = np.concatenate([cell[w] for cell in cells.values() for w in ("start", "end", "anchors")])
    low, high = everything.min(axis=0), everything.max(axis=0)
    reach = 0.56 * (high - low).max()
    (left, right), (bottom, top) = ((c - reach, c + reach) for c in (low + high) / 2)
    for at, name in zip(axes, COMPARED):
        cell = cells[name]
        for label, points in {"before": cell["start"], "after": cell["end"]}.items():
            for i, j in itertools.combinations(range(len(points)), 2):
                at.plot(*points[[i, j]].T, zorder=2, **lines[label])
            at.plot(*points.T, linestyle="", zorder=4, **dots[label])
        label = "anchors, springs to them"
        for ends in zip(cell["end"], cell["anchors"]):
            at.plot(*np.array(ends).T, zorder=3, **lines[label])
        at.plot(*cell["anchors"].T, linestyle="", zorder=5, **dots[label])
        at.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x")
        at.set_title(f"{label_of(name)}: E = {cell['energies'][0]:.5g}")
        iterations = f"{cell['iterations'][0]:,} iterations"
        at.text(0.03, 0.03, iterations, transform=at.transAxes, path_effects=HALO)
    axes[0].set_ylabel("y")
    return Drawing("hard-near-coincident", figure, title, NEAR_COINCIDENT_CAPTION.format(level=level))


def tabulate_hard(results: Results) -> str:
    cases = hard_cases(results)

    def text(levels: list[Level], name: str) -> str:
        shares = (f"{100 * lv.failures(name):.0f}" if name in lv.excess else "-" for lv in levels)
        return " ".join(shares)

    header = [f"{case}: {' '.join(short(level.level) for level in levels)}" for case, levels in cases.items()]
    names = in_order(cell["solver"] for cell in results.cells)
    rows = [[f"`{name}`", *(text(levels, name) for levels in cases.values())] for name in names]
    count = max(cell["systems"] for cell in results.cells)
    note = f"""Cells: share of {count} systems [%] that end more than 1 % above the lowest energy found, one number
for each level of difficulty, in the order of the heading."""
    return paragraph(note) + "\n" + table(["", *header], rows)


# -------------------------------------------------------------------------------------------------- minima

MINIMA_CAPTION = """Left: the share of systems for which random starts find two minima or more. The other panels:
the share of systems in which a solver, from the system's own start, ends more than 1e-4 above the lowest of these
minima, in another minimum or before it reaches one. Anchors become weaker to the right."""


@dataclass
class Ends:
    """A solver's final energies compared with the minima that random starts lead to."""

    systems: int
    several: float  # share of systems with two minima or more; the same whoever solves
    missed: float  # share of systems where the solver ends above the lowest

    @staticmethod
    def of(cells: list[Cell]) -> "Ends":
        minima, lowest, ends = (joined(cells, name) for name in MINIMA)
        return Ends(len(ends), float((minima > 1).mean()), float((ends > lowest * (1 + 1e-4)).mean()))

    @staticmethod
    def by_weakness(cells: list[Cell]) -> dict[float, "Ends"]:
        found: dict[float, list[Cell]] = {}
        for cell in sorted(cells, key=lambda cell: -cell["weakness"]):
            found.setdefault(cell["weakness"], []).append(cell)
        return {weakness: Ends.of(cells) for weakness, cells in found.items()}


def draw_minima(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind, data in by_kind(results, Ends.by_weakness):
        title = minima_title(kind, data)
        columns = min(4, 1 + len(data))
        handles = legend_of(solvers_in(data), palette)
        figure, (first, *others) = panels(1 + len(data), columns, 1.9, title, handles, gap=0.38)
        weaknesses = sorted({w for ends in data.values() for e in ends.values() for w in e}, reverse=True)
        x = range(len(weaknesses))
        top = 5.0
        for k, (at, (group, ends)) in enumerate(zip(others, data.items())):
            for name in reversed(in_order(ends)):
                shares = [100 * ends[name][w].missed if w in ends[name] else math.nan for w in weaknesses]
                at.plot(x, shares, clip_on=False, **palette(name))
                top = max(top, np.nanmax(shares))
            at.set_title(f"missed, {nodes_of(group)} nodes")
            several = {w: 100 * e.several for by_weakness in ends.values() for w, e in by_weakness.items()}
            style = {"color": str(0.65 * k / max(1, len(data) - 1)), "marker": "osD^v<>"[k % 7]}
            shares = [several.get(w, math.nan) for w in weaknesses]
            first.plot(x, shares, clip_on=False, label=f"{nodes_of(group)} nodes", **style)
        first.set(ylabel="systems [%]")
        first.set_title("two minima or more")
        first.legend(loc="lower right", handlelength=1.5)
        for at in (first, *others):
            at.set_xticks(x, [tick(w) for w in weaknesses])
            at.set(xlim=(-0.1, len(weaknesses) - 0.9), ylim=(0, 100 if at is first else 1.08 * top))
            at.set(xlabel="anchors' stiffness ×")
        drawings.append(Drawing(f"minima-{kind}", figure, title, MINIMA_CAPTION))
    return drawings


def minima_title(kind: str, data: dict[str, dict[str, dict[float, Ends]]]) -> str:
    several, group, weakness = max(
        (e.several, group, weakness)
        for group, ends in data.items()
        for by_weakness in ends.values()
        for weakness, e in by_weakness.items()
    )
    where = f"{nodes_of(group)} nodes, anchors × {short(weakness)}"
    title = f"{what(kind)}: up to {percent(several)} have several minima ({where})"
    missed = [e.missed for ends in data.values() for e in ends.get("ida", {}).values()]
    if missed:
        shares = dict.fromkeys((percent(min(missed)), percent(max(missed))))
        title += f"; IDA misses the lowest in {' to '.join(shares)}"
    return title


def tabulate_minima(results: Results) -> str:
    names = in_order(cell["solver"] for cell in results.cells)
    rows = []
    for _, data in by_kind(results, Ends.by_weakness):
        for group, ends in data.items():
            for weakness in sorted({w for by_weakness in ends.values() for w in by_weakness}, reverse=True):
                here = {name: ends[name][weakness] for name in names if weakness in ends.get(name, {})}
                most = max(here.values(), key=lambda e: e.systems)
                row = [f"{group}, anchors × {short(weakness)}", str(most.systems), percent(most.several)]
                rows.append(row + [percent(here[name].missed) if name in here else "" for name in names])
    starts = max(cell.get("starts", 0) for cell in results.cells)
    note = f"""Columns: number of systems; share in which {starts} random starts find two minima or more; share in
which each solver ends above the lowest of them."""
    return paragraph(note) + "\n" + table(["", "systems", "several", *(f"`{name}`" for name in names)], rows)


# --------------------------------------------------------------------------------------------------- proof

CLOSED = 1e-6  # a minimum counts as proven up to this width of the interval, relative to the energy
PROOF_CAPTION = """Left: the share of systems whose energy is proven to be within 1e-6 of the global minimum.
Right: for the other systems, the median width of the interval between the proven lower bound and the energy,
relative to the energy. If a solver computes no bound, the certificate's bound is used."""


@dataclass
class Proofs:
    """How far a solver's energies are proven."""

    systems: int
    certified: float  # share
    closed: float  # share
    width: float  # median of the intervals that are not closed, relative; nan without any
    seconds: float  # median of a solve

    @staticmethod
    def of(cells: list[Cell]) -> "Proofs":
        energies, bounds, certified, seconds = (joined(cells, name) for name in PROOF)
        # At energy zero nothing is left to prove.
        widths = np.where(energies > 0, (energies - bounds) / np.maximum(energies, 1e-300), 0)
        rest = widths[widths > CLOSED]
        width = float(np.median(rest)) if len(rest) else math.nan
        share = float((widths <= CLOSED).mean())
        return Proofs(len(energies), float(certified.mean()), share, width, float(np.median(seconds)))

    @staticmethod
    def by_weakness(cells: list[Cell]) -> dict[float, "Proofs"]:
        return {w: Proofs.of([c for c in cells if c["weakness"] == w]) for w in {c["weakness"] for c in cells}}


def draw_proof(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind, data in by_kind(results, Proofs.by_weakness):
        weaknesses = sorted({w for proofs in data.values() for p in proofs.values() for w in p}, reverse=True)
        title = proof_title(kind, data, weaknesses[0])
        handles = legend_of(solvers_in(data), palette)
        figure, axes = panels(2 * len(weaknesses), 2, 1.7, title, handles)
        sizes = [nodes_of(group) for group in data]
        for left, right, weakness in zip(axes[::2], axes[1::2], weaknesses):
            for name in reversed(solvers_in(data)):
                points = [(g, p[name][weakness]) for g, p in data.items() if weakness in p.get(name, {})]
                nodes = [nodes_of(group) for group, _ in points]
                left.plot(nodes, [100 * p.closed for _, p in points], clip_on=False, **palette(name))
                right.plot(nodes, [p.width for _, p in points], **palette(name))
            left.set(ylim=(0, 100), ylabel="proven [% of systems]")
            right.set(yscale="log", ylabel="width of the rest")
            for at in (left, right):
                at.set(xscale="log", xlabel="nodes", xlim=(0.9 * min(sizes), 1.1 * max(sizes)))
                at.set_title(f"anchors' stiffness × {short(weakness)}")
                at.set_xticks(sizes, [str(size) for size in sizes])
                at.minorticks_off()
        drawings.append(Drawing(f"proof-{kind}", figure, title, PROOF_CAPTION))
    return drawings


def proof_title(kind: str, data: dict[str, dict[str, dict[float, Proofs]]], weakness: float) -> str:
    group, proofs = next(iter(data.items()))
    best = max((p[weakness].closed, name) for name, p in proofs.items() if weakness in p)
    return f"{what(kind)}: {percent(best[0])} proven with {nodes_of(group)} nodes, by {label_of(best[1])}"


def tabulate_proof(results: Results) -> str:
    rows = []
    for _, data in by_kind(results, Proofs.by_weakness):
        for group, proofs in data.items():
            for weakness in sorted({w for p in proofs.values() for w in p}, reverse=True):
                for name in in_order(proofs):
                    if weakness not in proofs[name]:
                        continue
                    p = proofs[name][weakness]
                    width = "" if math.isnan(p.width) else f"{p.width:.2g}"
                    row = [f"{group}, anchors × {short(weakness)}", f"`{name}`", str(p.systems)]
                    rows.append(row + [percent(p.certified), percent(p.closed), width, time(p.seconds)])
    note = """Columns: number of systems; share whose solution is certified; share within 1e-6 of a proven lower
bound; median width of the other intervals, relative to the energy; median CPU time of a solve."""
    header = ["", "", "systems", "certified", "proven", "width of the rest", "time"]
    return paragraph(note) + "\n" + table(header, rows)


# -------------------------------------------------------------------------------------------------- pareto

FINEST = 1e-11  # smaller gaps count as this one, as they are near the rounding of doubles
PARETO_CAPTION = f"""Median CPU time of a solve (setup included) against the 90th percentile of the gap, relative
to the energy at which the solver itself ends. Gaps below {short(FINEST)} are drawn at {short(FINEST)}. Lower is
faster, and further right is more accurate. Gray: the other solvers of the table."""


def trade_off(cells: list[Cell]) -> np.ndarray:
    """Rows (gap, seconds) by falling gap: 90th percentile of the gap and median of the time at each tolerance,
    without rows that another one beats in both."""
    cells = [cell for cell in cells if cell["tolerances"] == cells[0]["tolerances"]]
    gaps, seconds = (np.concatenate([cell[name] for cell in cells], axis=1) for name in ("gaps", "seconds"))
    points = sorted((percentile(t, 0.5), max(percentile(g, 0.9), FINEST)) for g, t in zip(gaps, seconds))
    best: list[tuple[float, float]] = []
    for t, g in points:
        if math.isfinite(g) and (not best or g < best[-1][0]):
            best.append((g, t))
    return np.array(best).reshape(-1, 2)


def time_to(curve: np.ndarray, gap: float) -> float:
    reached = curve[curve[:, 0] <= gap]
    return float(reached[0, 1]) if len(reached) else math.inf


def draw_pareto(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind, data in by_kind(results, trade_off):
        title = pareto_title(kind, data)
        figure, axes = panels(len(data), min(2, len(data)), 2.9, title, right=0.95, gap=0.7)
        for at, (group, curves) in zip(axes, data.items()):
            at.set(xscale="log", yscale="log", xlim=(2, FINEST))
            at.set(xlabel="relative gap, 90 % of systems", ylabel="CPU time, median [s]")
            at.set_xticks([1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
            at.set_title(f"{nodes_of(group)} nodes")
            for name, curve in curves.items():
                at.plot(*curve.T, **palette(name))
            at.get_ylim()  # settles the limits, on which the labels' positions depend
            drawn = [name for name, curve in curves.items() if palette.in_color(name) and len(curve)]
            label_ends(at, [(*curves[name][-1], label_of(name), palette(name)["color"]) for name in drawn])
        drawings.append(Drawing(f"pareto-{kind}", figure, title, PARETO_CAPTION))
    return drawings


def pareto_title(kind: str, data: dict[str, dict[str, np.ndarray]]) -> str:
    parts = []
    for group, curves in data.items():
        best, seconds = min(((s, time_to(curve, 1e-6)) for s, curve in curves.items()), key=lambda p: p[1])
        if math.isfinite(seconds):
            parts.append(f"{nodes_of(group)} nodes {label_of(best)}, {time(seconds)}")
    if not parts:
        return f"{what(kind)}: time against accuracy"
    return f"{what(kind)}: the fastest to a gap of 1e-6, {'; '.join(parts)}"


def tabulate_pareto(results: Results) -> str:
    def text(curve: np.ndarray) -> str:
        times = (time_to(curve, gap) for gap in (1e-2, 1e-6))
        return " / ".join(time(t) if math.isfinite(t) else "-" for t in times)

    note = """Cells: median CPU time until nine systems in ten are within a relative gap of 1e-2 / 1e-6. Columns:
number of nodes."""
    tables = [table_of_groups(kind, data, text) for kind, data in by_kind(results, trade_off)]
    return "\n".join([paragraph(note), *tables])


# ---------------------------------------------------------------------------------------------------- page


@dataclass(frozen=True)
class Experiment:
    title: str
    draw: Callable[[Results, Palette], list[Drawing]]
    tabulate: Callable[[Results], str]


EXPERIMENTS = {
    "convergence": Experiment("Energy against iterations (Figure 7)", draw_convergence, tabulate_convergence),
    "scaling": Experiment("Effort against the number of nodes (Figure 9)", draw_scaling, tabulate_scaling),
    "hard": Experiment("Hard cases (Figure 8)", draw_hard, tabulate_hard),
    "minima": Experiment("Several minima", draw_minima, tabulate_minima),
    "proof": Experiment("Proofs of the global minimum", draw_proof, tabulate_proof),
    "pareto": Experiment("Accuracy against time", draw_pareto, tabulate_pareto),
}


def shown_command(command: str) -> str:
    """The command without folders, which depend on the machine."""
    command = re.sub(r" --results[ =]\S+", "", command)
    return re.sub(r"[^\s=]*/", "", command)


def provenance(results: Results) -> str:
    """Commands, dates and machines of the measurements."""
    commands = dict.fromkeys(shown_command(run["command"]) for run in results.runs)
    text = "\n".join(["```sh", *commands, "```", ""])
    by_machine: dict[str, list[dict]] = {}
    for run in results.runs:
        lasting = {name: value for name, value in run["machine"].items() if name != "clock_spread"}
        by_machine.setdefault(json.dumps(lasting, sort_keys=True), []).append(run)
    clocks = [cell["clock"] for cell in results.cells if isinstance(cell.get("clock"), (int, float))]
    for runs in by_machine.values():
        machine = {"cpu": "unknown CPU", "cores": "?", "compiler": "unknown compiler", **runs[0]["machine"]}
        days = sorted(run["started"][:10] for run in runs)
        build = " ".join(str(machine.get("build", "unknown build")).split())
        packages = ", ".join(map(str, machine.get("packages", [])))
        quartiles = percent(max(run["machine"].get("clock_spread", math.nan) for run in runs))
        sentence = f"""{' to '.join(dict.fromkeys((days[0], days[-1])))}; {machine['cpu']}, {machine['cores']}
cores; {machine['compiler']}, {build}; {packages}. Steadiness of the clock: the quartiles of a fixed
computation's time are {quartiles} apart"""
        if clocks:
            sentence += f"""; during the measurements it took {min(clocks):.2f} to {max(clocks):.2f} times as long as
at the start"""
        text += "\n" + paragraph(sentence + ".")
    return text


def page(found: list[tuple[Results, list[Drawing]]], folder: str) -> str:
    names = in_order(cell["solver"] for results, _ in found for cell in results.cells)
    labels = ", ".join(f"`{name}` is {label_of(name)}" for name in names if name in STYLES)
    introduction = f"""These are all figures and tables of the solver experiments. IDA is the paper's iterative
direct approach, CG the method of conjugate gradients, LM that of Levenberg and Marquardt. Solvers have the names
that `asterism-bench solvers` lists with a description of each; in the figures, {labels}. Kinds
of systems: `lit`, `orig` and `disp` are the paper's random systems by three readings of its text, `track` are such as
a tracker makes, `real` are recorded from a tracker, `sparse` are large with few links for each node. The numbers of
figures in the headings are the paper's. This command writes the page and the figures from stored results:"""
    command = "```sh\npython3 bench/laboratory/figures.py RESULTS_FOLDER --out docs/results/laboratory\n```\n"
    text = ["# The solver laboratory: all tables\n", paragraph(introduction), command]
    for results, drawings in found:
        text.append(f"## {EXPERIMENTS[results.name].title}\n")
        for drawing, following in zip(drawings, [*drawings[1:], None]):
            text.append(f"![{drawing.title}]({folder}/{drawing.name}.png)\n")
            if following is None or following.caption != drawing.caption:  # once for figures that share it
                text.append(paragraph(drawing.caption))
        text += [EXPERIMENTS[results.name].tabulate(results), provenance(results)]
    return "\n".join(text)


def save(drawing: Drawing, folder: pathlib.Path) -> None:
    # Without the version of Matplotlib, so that the same results give the same files.
    drawing.figure.savefig(folder / f"{drawing.name}.png", metadata={"Software": None})
    plt.close(drawing.figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("results", type=pathlib.Path, help="folder of asterism-bench's --results")
    parser.add_argument(
        "--out", type=pathlib.Path, required=True, help="folder of the figures; the page is OUT-tables.md"
    )
    parser.add_argument("--solvers", help="those in color, separated by commas (default: the better known)")
    options = parser.parse_args()

    palette = Palette(options.solvers.split(",") if options.solvers else None)
    out = options.out.resolve()
    found = []
    with plt.rc_context(SETTINGS):
        for results in read(options.results):
            found.append((results, EXPERIMENTS[results.name].draw(results, palette)))
        try:
            out.mkdir(parents=True, exist_ok=True)
            for drawing in (drawing for _, drawings in found for drawing in drawings):
                save(drawing, out)
            out.with_name(out.name + "-tables.md").write_text(page(found, out.name), encoding="utf-8")
        except OSError as error:
            raise BadInput(f"{error.filename}: {error.strerror}") from error


if __name__ == "__main__":
    try:
        main()
    except BadInput as problem:
        sys.exit(f"figures.py: {problem}")
