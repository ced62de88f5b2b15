#!/usr/bin/env python3
"""Draws every figure of the solver laboratory from its stored results, and writes a page that shows them.

    figures.py RESULTS_FOLDER --out docs/results/laboratory

reads what `asterism-bench convergence`, `scaling`, `hard`, `minima` and `pareto` left in the folder; those
that are not there are left out. Each figure goes into --out as SVG and PNG, the page beside that folder
(docs/results/laboratory.md). The same results give the same files, byte for byte. Needs python3-matplotlib.
"""

import argparse
import json
import math
import pathlib
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

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

# ------------------------------------------------------------------------------------------------- reading


class BadInput(Exception):
    """What is wrong with the results, in one line."""


@dataclass
class Results:
    """An experiment as stored: its cells, numbers as arrays, and the runs that measured them."""

    name: str
    cells: list[Cell] = field(default_factory=list)
    runs: list[dict] = field(default_factory=list)

    def groups(self, kind: str) -> list[str]:
        """Groups of a kind, "lit/4" and so on, by the number of nodes."""
        found = {cell["group"] for cell in self.cells if cell["group"].startswith(kind + "/")}
        return sorted(found, key=nodes_of)

    def kinds(self) -> list[str]:
        return list(dict.fromkeys(cell["group"].split("/")[0] for cell in self.cells))

    def solvers(self, group: str) -> list[str]:
        """Names in the order of the legend."""
        found = {cell["solver"] for cell in self.cells if cell["group"] == group}
        return sorted(
            found, key=lambda name: (list(STYLES).index(name) if name in STYLES else len(STYLES), name)
        )

    def of(self, group: str, solver: str, **fields: Any) -> list[Cell]:
        return [
            cell
            for cell in self.cells
            if cell["group"] == group
            and cell["solver"] == solver
            and all(cell[name] == value for name, value in fields.items())
        ]


def nodes_of(group: str) -> int:
    return int(group.split("/")[1])


def numbers(values: Any, *shape: int) -> np.ndarray:
    """An array of so many numbers; null, what is not finite, becomes infinite."""
    as_array = np.array(values, dtype=object)
    if as_array.shape != shape:
        raise ValueError
    return np.where(as_array == None, math.inf, as_array).astype(float)  # noqa: E711, element by element


def parse(experiment: str, cell: Cell) -> Cell:
    """The cell with its numbers as arrays; KeyError, TypeError or ValueError where it is none."""
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
        for name in ("loose_iterations", "iterations", "seconds"):
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
        for name in ("minima", "lowest", "ends"):
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
    """A file keeps what earlier settings measured, for instance of fewer systems: each system once, from the
    largest cell that has it."""
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


# The solvers that are drawn in colour, where --solvers does not name others. Colours differ in luminance, and
# dashes and markers in shape, for gray paper and every eye.
STYLES = {
    "ida": Style("IDA", "#111111", "-", "o"),
    "ncg": Style("nonlinear CG", "#c8252c", (0, (5, 2)), "s"),
    "ncg-forward": Style("CG (numeric)", "#f2994a", (0, (5, 1.5, 1, 1.5)), "^"),
    "newton": Style("Newton", "#0a4f94", "-", "D"),
    "newton-cg": Style("Newton-CG", "#58b5e8", (0, (4, 1.5)), "X"),
    "lbfgs": Style("L-BFGS", "#1f9a82", "-", "v"),
    "auto": Style("Auto", "#6f3f98", (0, (1, 1.2)), "P"),
    "schwarz": Style("Schwarz", "#7d5a12", "-", "h"),
    "ida-relaxed": Style("IDA, relaxed", "#7a7a7a", (0, (3, 1.5)), "<"),
    "liblbfgs": Style("liblbfgs", "#a99a00", (0, (6, 1.5, 1, 1.5)), "*"),
    "ceres-dense": Style("Ceres LM", "#d684b5", (0, (2, 1.2)), "p"),
}
EXTRA_STYLES = (  # for others that --solvers names
    Style("", "#3f7d20", (0, (7, 2)), ">"),
    Style("", "#8c2d5a", (0, (1, 1.5)), "d"),
    Style("", "#4a6fe3", (0, (3, 1, 1, 1)), "H"),
    Style("", "#b86b00", (0, (5, 1)), "8"),
)
GRAY = "#c4c4c4"
BEFORE, AFTER, NODE = "#58a6e0", "#b3151f", "#2f9e44"  # of a drawn system
WIDTH = 7.6  # inches: the width of a page
LEGEND_COLUMNS = 4
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
    "svg.hashsalt": "asterism",
    "savefig.dpi": 160,
}


class Palette:
    """Which solvers are drawn in colour, and how."""

    def __init__(self, chosen: list[str] | None):
        self.chosen = chosen
        unnamed = [name for name in chosen or [] if name not in STYLES]
        self.extra = dict(zip(unnamed, EXTRA_STYLES * (1 + len(unnamed) // len(EXTRA_STYLES))))

    def in_colour(self, name: str) -> bool:
        return name in (STYLES if self.chosen is None else self.chosen)

    def __call__(self, name: str) -> dict[str, Any]:
        """Arguments of Axes.plot."""
        if not self.in_colour(name):
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
    return label_of(name) if name in STYLES else name


@dataclass
class Drawing:
    """A figure, and what the page says of it."""

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
    """A page-wide figure of so many axes of a height [inch] under a title and a legend, with `right` beside
    each for labels and `gap` for the next one's axis."""
    rows = -(-count // columns)
    left, bottom, line = 0.72, 0.55, 0.17
    title = textwrap.fill(title, 84)
    text = 0.1 + line * (1 + title.count("\n"))
    legend = 0.1 + line * -(-len(handles) // LEGEND_COLUMNS) if handles else 0.0
    head = text + legend + 0.3
    step = (WIDTH - left + gap - 0.1) / columns
    tall = head + rows * (height + bottom + 0.25) - 0.2
    figure = plt.figure(figsize=(WIDTH, tall))
    figure.text(
        0.1 / WIDTH, 1 - 0.09 / tall, title, fontsize=10, fontweight="bold", va="top", linespacing=1.25
    )
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


def legend_of(names: Iterable[str], palette: Palette) -> list[plt.Line2D]:
    """A line for each in colour, and one for all others."""
    names = list(names)
    lines = [
        plt.Line2D([], [], label=label_of(name), **palette(name)) for name in names if palette.in_colour(name)
    ]
    others = len(names) - len(lines)
    return lines + (
        [plt.Line2D([], [], color=GRAY, linewidth=0.8, label=f"{others} others")] if others else []
    )


def label_ends(axes: Axes, ends: list[tuple[float, float, str, str]]) -> None:
    """Names of lines (x, y, text, colour) at their ends; those at the right edge beside it, moved apart where
    they would overlap. All in fractions of the axes, which do not depend on the resolution."""
    box = axes.get_window_extent()
    apart = 10.5 / 72 * axes.figure.dpi / box.height
    points = [
        (*axes.transAxes.inverted().transform(axes.transData.transform((x, y))), *rest)
        for x, y, *rest in ends
    ]
    edge = sorted((point for point in points if point[0] > 0.9), key=lambda point: point[1])
    heights = [point[1] for point in edge]
    for _ in range(500):  # neighbours that overlap give way, half each
        for k in range(len(heights) - 1):
            overlap = apart - (heights[k + 1] - heights[k])
            if overlap > 0:
                heights[k] -= overlap / 2
                heights[k + 1] += overlap / 2
    for (x, y, text, color), height in zip(edge, heights):
        line = {
            "arrowstyle": "-",
            "color": color,
            "linewidth": 0.6,
            "shrinkA": 0,
            "shrinkB": 3,
            "relpos": (0, 0.5),
        }
        at = {"xycoords": "axes fraction", "textcoords": "axes fraction", "annotation_clip": False}
        axes.annotate(
            text, (x, y), (1.06, height), color=color, fontsize=8, va="center", arrowprops=line, **at
        )
    for x, y, text, color in (point for point in points if point[0] <= 0.9):
        axes.text(
            x + 0.03,
            y,
            text,
            color=color,
            fontsize=8,
            va="center",
            transform=axes.transAxes,
            path_effects=HALO,
            zorder=6,
        )


def spread(values: np.ndarray, p: float) -> float:
    """The laboratory's percentile: a value that occurs."""
    return float(np.sort(values)[min(int(p * len(values)), len(values) - 1)])


def power(value: float) -> str:
    """1e-06 as a reader of axes expects it, for a tick."""
    exponent = math.log10(value)
    return (
        f"$10^{{{round(exponent)}}}$"
        if abs(exponent - round(exponent)) < 1e-9 and value != 1
        else f"{value:g}"
    )


def short(value: float) -> str:
    """1e-6, 0.1, 30."""
    exponent = round(math.log10(value))
    return (
        f"1e{exponent}"
        if abs(exponent) > 1 and f"{value:.6e}" == f"1.000000e{exponent:+03d}"
        else f"{value:g}"
    )


def percent(share: float) -> str:
    """With a space that does not break."""
    return (
        f"{100 * share:.1g}\N{NO-BREAK SPACE}%"
        if 0 < share < 0.01
        else f"{100 * share:.0f}\N{NO-BREAK SPACE}%"
    )


def time(seconds: float) -> str:
    for unit, scale in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)):
        if seconds < 999.5 * scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds:.3g} s"


def kind_title(kind: str) -> str:
    """What the systems of a kind are, to begin a title."""
    known = {
        "lit": "Random systems (lit)",
        "orig": "Random systems, anchors at the nodes (orig)",
        "disp": "Random systems, stiffness by start (disp)",
        "track": "Systems as a tracker makes (track)",
        "sparse": "Sparse systems",
        "real": "Systems recorded from a tracker (real)",
    }
    return known.get(kind, f"Systems of kind {kind}")


def table(header: list[str], rows: list[list[str]]) -> str:
    if not rows:
        return ""
    lines = ["| " + " | ".join(row) + " |" for row in [header, *rows]]
    lines.insert(1, "|---|" + "---:|" * (len(header) - 1))
    return "\n".join(lines) + "\n"


# --------------------------------------------------------------------------------------------- convergence


@dataclass
class Curve:
    """Sums over the systems of a group: convergence of one solver."""

    looks: np.ndarray  # iterations
    remaining: np.ndarray  # mean of E / E_0 at each
    gaps: list[Counter]  # systems by the bin of their gap
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
        """Percentile of the relative gap at each look; bins are a twentieth of a decade, from 1e-16."""
        result = []
        for bins in self.gaps:
            below = 0
            for at in sorted(bins):
                below += bins[at]
                if below >= p * self.systems:
                    break
            result.append(0.0 if at == 0 else 10 ** (math.log10(LEAST_GAP) + (at - 0.5) / 20))
        return np.array(result)

    def iterations_to(self, gap: float) -> str:
        reached = np.flatnonzero(self.gap(0.5) <= gap)
        return f"{self.looks[reached[0]]:.0f}" if len(reached) else "-"


def draw_convergence(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind in results.kinds():
        groups = results.groups(kind)
        curves = {g: {s: Curve.of(results.of(g, s)) for s in results.solvers(g)} for g in groups}
        names = list(dict.fromkeys(s for g in groups for s in curves[g]))
        title = convergence_title(kind, groups, curves)
        figure, axes = panels(2 * len(groups), 2, 1.75, title, legend_of(names, palette))
        for row, group in enumerate(groups):
            left, right = axes[2 * row : 2 * row + 2]
            last = 10.0
            for name, curve in curves[group].items():
                style = palette(name)
                early = curve.looks <= 20
                left.plot(curve.looks[early], curve.remaining[early], **style)
                median = curve.gap(0.5)
                end = int(np.argmax(median == 0)) if (median == 0).any() else len(median) - 1
                shown = slice(1, end + 1)
                last = max(last, curve.looks[end])
                right.plot(curve.looks[shown], np.maximum(median[shown], LEAST_GAP), markevery=2, **style)
                if name in ("ida", "ncg") and palette.in_colour(name):
                    low, high = (np.maximum(curve.gap(p)[1:], LEAST_GAP) for p in (0.05, 0.95))
                    right.fill_between(
                        curve.looks[1:], low, high, color=style["color"], alpha=0.13, linewidth=0
                    )
            left.set(yscale="log", xlim=(0, 20), xlabel="iterations", ylabel="mean of $E / E_0$")
            left.set_xticks(range(0, 21, 5))
            left.set_title(f"{nodes_of(group)} nodes: energy that remains")
            plain_ticks(left)
            right.set(xscale="log", yscale="log", xlim=(1, 1.1 * last), ylim=(LEAST_GAP, 100))
            right.set(xlabel="iterations", ylabel="relative gap")
            right.set_title(f"{nodes_of(group)} nodes: gap, median")
            right.set_yticks([10.0**e for e in range(-16, 1, 4)])
        drawings.append(
            Drawing(
                f"convergence-{kind}",
                figure,
                title,
                "Left: mean of the energy that remains, E / E_0, after each of the first iterations."
                " Right: median of"
                " the gap, (E - E_end) / E_end, above the energy that the solver itself ends at;"
                " bands: 5 to 95 % of"
                " the systems, for IDA and nonlinear CG.",
            )
        )
    return drawings


def plain_ticks(axes: Axes) -> None:
    """Decimal labels on a log axis that spans few decades, so that it has some."""
    low, high = axes.get_ylim()
    ticks = [m * 10.0**e for e in range(-6, 7) for m in (1, 2, 5) if low <= m * 10.0**e <= high]
    if len(ticks) > 7:
        ticks = [tick for tick in ticks if abs(math.log10(tick) % 1) < 1e-9]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def convergence_title(kind: str, groups: list[str], curves: dict[str, dict[str, Curve]]) -> str:
    parts = []
    for group in groups:
        if {"ida", "ncg"} <= curves[group].keys():
            ida, ncg = curves[group]["ida"], curves[group]["ncg"]
            ahead = np.flatnonzero(ncg.remaining < ida.remaining * (1 - 1e-6))
            when = f"{ida.looks[ahead[0]]:.0f}" if len(ahead) else "none"
            parts.append(f"{when} with {nodes_of(group)}{'' if parts else ' nodes'}")
    if not parts:
        return f"{kind_title(kind)}: energy against iterations"
    return f"{kind_title(kind)}: nonlinear CG's mean energy falls below IDA's at iteration {', '.join(parts)}"


def tabulate_convergence(results: Results) -> str:
    rows = []
    for kind in results.kinds():
        for group in results.groups(kind):
            for name in results.solvers(group):
                curve = Curve.of(results.of(group, name))
                at = {int(k): value for k, value in zip(curve.looks, curve.remaining)}
                rows.append(
                    [f"{group} `{name}`"]
                    + [f"{at[k]:.4f}" if k in at else "-" for k in (1, 3, 5, 10)]
                    + [curve.iterations_to(gap) for gap in (1e-2, 1e-6, 1e-10)]
                    + [str(curve.systems)]
                )
    note = (
        "Mean E / E_0 after 1, 3, 5, 10 iterations; iterations until the median gap is below 1e-2, 1e-6,"
        " 1e-10.\n\n"
    )
    return note + table(["", "1", "3", "5", "10", "1e-2", "1e-6", "1e-10", "systems"], rows)


# ------------------------------------------------------------------------------------------------- scaling


@dataclass
class Effort:
    """What it takes a solver to arrive: of the systems of a group that it arrives at."""

    loose: np.ndarray  # iterations until one gains less than 1 %
    iterations: np.ndarray  # to the gap
    seconds: np.ndarray
    failed: int

    @staticmethod
    def of(cells: list[Cell]) -> "Effort":
        loose, iterations, seconds = (
            np.concatenate([cell[name] for cell in cells])
            for name in ("loose_iterations", "iterations", "seconds")
        )
        arrived = iterations >= 0
        return Effort(loose[loose >= 0], iterations[arrived], seconds[arrived], int((~arrived).sum()))


def draw_scaling(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    gap = results.cells[0]["gap"]
    for kind in results.kinds():
        groups = results.groups(kind)
        efforts = {(g, s): Effort.of(results.of(g, s)) for g in groups for s in results.solvers(g)}
        names = list(dict.fromkeys(s for g in groups for s in results.solvers(g)))
        names.sort(key=lambda name: (list(STYLES).index(name) if name in STYLES else len(STYLES), name))
        quantities = {
            "loose": ("until one gains less than 1 %", "iterations, mean and s.d."),
            "iterations": (f"to a relative gap of {short(gap)}", "iterations, mean and s.d."),
            "seconds": (f"to a relative gap of {short(gap)}", "CPU time [s], median and 5 to 95 %"),
        }
        if sum(any(len(e.loose) for (g, _), e in efforts.items() if g == group) for group in groups) < min(
            2, len(groups)
        ):
            del quantities["loose"]  # not measured beyond 1000 nodes
        title = scaling_title(kind, groups, efforts)
        handles = legend_of(names, palette)
        if len(quantities) == 3:  # the legend takes the fourth place
            figure, axes = panels(4, 2, 2.3, title)
            axes[3].axis("off")
            axes[3].legend(handles=handles, loc="center left", handlelength=3.4, labelspacing=0.8)
        else:
            figure, axes = panels(2, 2, 2.3, title, handles)
        sizes = [nodes_of(group) for group in groups]
        margin = 1.25 if len(sizes) > 1 else 2
        width = math.log10(max(sizes) / min(sizes) * margin**2)  # decades
        for at, (quantity, (what, unit)) in zip(axes, quantities.items()):
            at.set(xscale="log", yscale="log", xlabel="nodes", ylabel=unit)
            for order, name in enumerate(names):
                dodge = 0.008 * (order - len(names) / 2) * width
                draw_effort(at, quantity, name, groups, efforts, palette, dodge)
            at.set_title(what)
            at.set_xlim(min(sizes) / margin, max(sizes) * margin)
            ticks = sizes
            while len(ticks) > 7:
                ticks = ticks[::2]
            at.set_xticks(ticks, [f"{n:g}" if n < 10000 else power(n) for n in ticks])
            at.minorticks_off()
            if quantity != "seconds":
                at.set_ylim(bottom=1)
                plain_ticks(at)
        drawings.append(
            Drawing(
                f"scaling-{kind}",
                figure,
                title,
                "Each solver's iterations and CPU time, setup included, against the number of nodes,"
                " to a relative gap"
                f" of {short(gap)} above the energy that it itself ends at"
                + (
                    ", and its iterations until one lowers the energy by less than a hundredth"
                    if "loose" in quantities
                    else ""
                )
                + ". Bands (IDA and nonlinear CG) and bars (the others): the standard deviation of the"
                " iterations, 5 to"
                " 95 % of the times. Of the systems that it arrives at.",
            )
        )
    return drawings


def draw_effort(
    axes: Axes,
    quantity: str,
    name: str,
    groups: list[str],
    efforts: dict[tuple[str, str], Effort],
    palette: Palette,
    dodge: float,
) -> None:
    """A solver's line; its bars are `dodge` decades beside those of the others."""
    points = []
    for group in groups:
        effort = efforts.get((group, name))
        values = getattr(effort, quantity) if effort else []
        if len(values) == 0:
            continue
        if quantity == "seconds":
            points.append((nodes_of(group), spread(values, 0.5), spread(values, 0.05), spread(values, 0.95)))
        else:
            mean, deviation = values.mean(), values.std()
            points.append((nodes_of(group), mean, max(mean - deviation, 0.3), mean + deviation))
    if not points:
        return
    x, middle, low, high = np.array(points).T
    style = palette(name)
    axes.plot(x, middle, **style)
    if not palette.in_colour(name):
        return
    if name in ("ida", "ncg") and len(x) > 1:
        axes.fill_between(x, low, high, color=style["color"], alpha=0.13, linewidth=0)
    else:
        axes.vlines(x * 10**dodge, low, high, color=style["color"], linewidth=0.7, alpha=0.8, zorder=1.8)


def scaling_title(kind: str, groups: list[str], efforts: dict[tuple[str, str], Effort]) -> str:
    first, last = groups[0], groups[-1]
    n, m = nodes_of(first), nodes_of(last)
    span = f"{n} nodes" if first == last else f"{n} and {m} nodes"
    parts = []
    for name in ("ida", "ncg") if any((first, "ida") == key for key in efforts) else ():
        arrived = [
            efforts[g, name]
            for g in (first, last)
            if (g, name) in efforts and len(efforts[g, name].iterations)
        ]
        if len(arrived) == 2:
            counts = [f"{effort.iterations.mean():.0f}" for effort in arrived]
            parts.append(f"{label_of(name)} {' and '.join(counts if n != m else counts[:1])}")
    if parts:
        return f"{kind_title(kind)}: mean iterations at {span}, " + ", ".join(parts)
    here = {s: spread(e.seconds, 0.5) for (g, s), e in efforts.items() if g == last and len(e.seconds)}
    if not here:
        return f"{kind_title(kind)}: no solver arrives at {m} nodes"
    best = min(here, key=here.get)
    return f"{kind_title(kind)}: at {m} nodes {label_of(best)} is the fastest, {time(here[best])}"


def tabulate_scaling(results: Results) -> str:
    parts = []
    for kind in results.kinds():
        groups = results.groups(kind)
        names = list(dict.fromkeys(s for g in groups for s in results.solvers(g)))
        rows = []
        for name in names:
            row = [f"`{name}`"]
            for group in groups:
                cells = results.of(group, name)
                if not cells:
                    row.append("")
                    continue
                effort = Effort.of(cells)
                failed = f" ({effort.failed} failed)" if effort.failed else ""
                if len(effort.iterations) == 0:
                    row.append(f"none of {effort.failed}")
                else:
                    it = effort.iterations
                    row.append(
                        f"{it.mean():.0f} ± {it.std():.0f}, {time(spread(effort.seconds, 0.5))}{failed}"
                    )
            rows.append(row)
        parts.append(table([kind] + [str(nodes_of(group)) for group in groups], rows))
    gap = results.cells[0]["gap"]
    return (
        f"Iterations to a gap of {short(gap)}, mean ± standard deviation, and median CPU time;"
        f" columns: nodes.\n\n" + "\n".join(parts)
    )


# ---------------------------------------------------------------------------------------------------- hard

FAR = 0.01  # relative excess over the lowest energy found that counts as a failure


@dataclass
class Level:
    """A case at a level: each solver's excess over the lowest energy that any found of the same system."""

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


LEVEL_NAMES = {
    "near-coincident": "rest length of the pair",
    "weak-anchors": "factor on the anchors' stiffness",
    "stiff-pair": "factor on a link's stiffness",
    "saddle": "factor on the anchors' stiffness",
}


def draw_hard(results: Results, palette: Palette) -> list[Drawing]:
    cases = hard_cases(results)
    names = list(
        dict.fromkeys(name for levels in cases.values() for level in levels for name in level.excess)
    )
    names.sort(key=lambda name: (list(STYLES).index(name) if name in STYLES else len(STYLES), name))
    title = hard_title(cases)
    figure, axes = panels(2 * len(cases), 2, 1.45, title, legend_of(names, palette))
    for row, (case, levels) in enumerate(cases.items()):
        left, right = axes[2 * row : 2 * row + 2]
        for name in reversed(names):  # the first in front
            mine = [(k, level) for k, level in enumerate(levels) if name in level.excess]
            x = [k for k, _ in mine]
            medians = [spread(level.excess[name], 0.5) for _, level in mine]
            left.plot(x, np.clip(medians, LEAST_GAP, 1e8), clip_on=False, **palette(name))
            right.plot(x, [100 * level.failures(name) for _, level in mine], clip_on=False, **palette(name))
        for at in (left, right):
            at.set_xticks(range(len(levels)), [power(level.level) for level in levels])
            at.set_xlim(-0.15, len(levels) - 0.85)
            at.set_xlabel(LEVEL_NAMES.get(case, "level"))
        top = max(np.median(e) for level in levels for e in level.excess.values())
        left.set(yscale="log", ylim=(LEAST_GAP, max(10.0, min(10 * top, 1e8))), ylabel="relative excess")
        left.set_yticks([10.0**e for e in range(-16, 9, 4) if 10.0**e <= left.get_ylim()[1]])
        left.set_title(f"{case}: median excess over the lowest")
        right.set(ylim=(0, 100), ylabel="systems [%]")
        right.set_title(f"{case}: > {FAR:.0%} above the lowest".replace("%", " %"))
    drawings = [
        Drawing(
            "hard",
            figure,
            title,
            "Excess of the energy where a solver ends over the lowest that any solver found of the"
            " same system"
            " (on the lowest line: 1e-16 or none), and the share of systems where it is above 1 %."
            " Harder to the"
            " right; stopped at stationarity 1e-8 or after 10,000 iterations.",
        )
    ]
    drawn = draw_near_coincident(results)
    return drawings + ([drawn] if drawn else [])


def hard_title(cases: dict[str, list[Level]]) -> str:
    levels = cases.get("near-coincident", [])
    worst = {
        name: max(level.failures(name) for level in levels)
        for name in ("ida", "ncg", "ncg-forward")
        if levels and all(name in level.excess for level in levels)
    }
    if not worst:
        return "Hard cases: excess over the lowest energy found"
    shares = ", ".join(f"{label_of(name)} {percent(share)}" for name, share in worst.items())
    return f"Nodes that nearly coincide, systems that end far above the lowest energy at the worst level: {shares}"


def draw_near_coincident(results: Results) -> Drawing | None:
    """The paper's Figure 8 for the level at which IDA and CG with numeric gradients differ most."""
    wanted = ("ida", "ncg", "ncg-forward")
    by_level: dict[float, dict[str, Cell]] = {}
    for cell in results.cells:
        if cell["case"] == "near-coincident" and cell["solver"] in wanted:
            by_level.setdefault(cell["level"], {})[cell["solver"]] = cell
    complete = {level: cells for level, cells in by_level.items() if len(cells) == len(wanted)}
    if not complete:
        return None
    level = max(
        complete, key=lambda k: complete[k]["ncg-forward"]["energies"][0] / complete[k]["ida"]["energies"][0]
    )
    cells = complete[level]
    energies = {name: float(cells[name]["energies"][0]) for name in wanted}
    ratio = energies["ncg-forward"] / energies["ida"]
    title = (
        f"Two nodes that want to be {short(level)} apart: CG with numeric gradients ends at"
        f" {ratio:.3g} times IDA's"
        " energy"
    )
    handles = [
        plt.Line2D(
            [],
            [],
            color=BEFORE,
            linestyle="--",
            linewidth=1,
            marker="o",
            markerfacecolor="white",
            label="before",
        ),
        plt.Line2D(
            [], [], color=AFTER, marker="o", markerfacecolor=NODE, markeredgecolor="black", label="after"
        ),
        plt.Line2D(
            [],
            [],
            color="black",
            linestyle=":",
            marker="x",
            markeredgewidth=1.6,
            label="anchors, springs to them",
        ),
    ]
    figure, axes = panels(3, 3, 1.92, title, handles, gap=0.5)
    everything = np.concatenate(
        [cells[name][what] for name in wanted for what in ("start", "end", "anchors")]
    )
    low, high = everything.min(axis=0), everything.max(axis=0)
    centre, reach = (low + high) / 2, 0.56 * (high - low).max()
    for at, name in zip(axes, wanted):
        cell = cells[name]
        count = len(cell["end"])
        for points, colour, line, width in (("start", BEFORE, "--", 1.0), ("end", AFTER, "-", 1.5)):
            for i in range(count):
                for j in range(i):
                    x, y = cell[points][[i, j]].T
                    at.plot(x, y, color=colour, linestyle=line, linewidth=width, zorder=2)
        for node, anchor in zip(cell["end"], cell["anchors"]):
            at.plot(*np.array([node, anchor]).T, color="black", linestyle=":", linewidth=1, zorder=3)
        at.plot(*cell["start"].T, "o", color="white", markeredgecolor=BEFORE, markersize=4.5, zorder=3)
        at.plot(*cell["end"].T, "o", color=NODE, markeredgecolor="black", markersize=6, zorder=4)
        at.plot(*cell["anchors"].T, "x", color="black", markersize=6.5, markeredgewidth=1.6, zorder=5)
        at.set(xlim=(centre[0] - reach, centre[0] + reach), ylim=(centre[1] - reach, centre[1] + reach))
        at.set(aspect="equal", xlabel="x")
        at.set_title(f"{label_of(name)}: E = {energies[name]:.5g}")
        at.text(
            0.03, 0.03, f"{cell['iterations'][0]:,} iterations", transform=at.transAxes, path_effects=HALO
        )
    axes[0].set_ylabel("y")
    return Drawing(
        "hard-near-coincident",
        figure,
        title,
        f"As the paper's Figure 8: the first of the near-coincident systems, rest length"
        f" {short(level)} between the first two"
        " nodes, before and after optimisation, with the energy that remains.",
    )


def tabulate_hard(results: Results) -> str:
    cases = hard_cases(results)
    names = list(
        dict.fromkeys(name for levels in cases.values() for level in levels for name in level.excess)
    )
    names.sort()
    rows = [
        [f"`{name}`"]
        + [
            " ".join(f"{100 * level.failures(name):.0f}" if name in level.excess else "-" for level in levels)
            for levels in cases.values()
        ]
        for name in names
    ]
    header = [f"{case}: {' '.join(short(level.level) for level in levels)}" for case, levels in cases.items()]
    count = max(cell["systems"] for cell in results.cells)
    return (
        f"Systems, of {count}, that end more than 1 % above the lowest energy found [%], level by level.\n\n"
        + table(["", *header], rows)
    )


# -------------------------------------------------------------------------------------------------- minima


def minima_of(results: Results, group: str, name: str, weakness: float) -> dict[str, np.ndarray] | None:
    cells = results.of(group, name, weakness=weakness)
    if not cells:
        return None
    return {what: np.concatenate([cell[what] for cell in cells]) for what in ("minima", "lowest", "ends")}


def missed(found: dict[str, np.ndarray]) -> float:
    """Share of systems where the solver ends above the lowest minimum of the random starts."""
    return float((found["ends"] > found["lowest"] * (1 + 1e-4)).mean())


def several(found: dict[str, np.ndarray]) -> float:
    return float((found["minima"] > 1).mean())


def draw_minima(results: Results, palette: Palette) -> list[Drawing]:
    drawings = []
    for kind in results.kinds():
        groups = results.groups(kind)
        weaknesses = sorted(
            {cell["weakness"] for cell in results.cells if cell["group"] in groups}, reverse=True
        )
        found = {
            (g, s, w): data
            for g in groups
            for s in results.solvers(g)
            for w in weaknesses
            if (data := minima_of(results, g, s, w)) is not None
        }
        names = list(dict.fromkeys(s for g in groups for s in results.solvers(g)))
        worst = max(found, key=lambda key: several(found[key]))
        title = (
            f"{kind_title(kind)}: up to {percent(several(found[worst]))} have several minima"
            f" ({nodes_of(worst[0])} nodes, anchors × {short(worst[2])})"
        )
        start = [missed(found[g, "ida", w]) for g in groups for w in weaknesses if (g, "ida", w) in found]
        if start:
            title += f"; IDA misses the lowest in {' to '.join(dict.fromkeys(map(percent, (min(start), max(start)))))}"
        columns = min(4, 1 + len(groups))
        figure, axes = panels(1 + len(groups), columns, 1.9, title, legend_of(names, palette), gap=0.38)
        ends = []
        for k, group in enumerate(groups):
            # The same whoever solves: of the first solver that has it.
            share = [
                next((several(found[group, s, w]) for s in names if (group, s, w) in found), math.nan)
                for w in weaknesses
            ]
            gray = str(0.65 * k / max(1, len(groups) - 1))
            axes[0].plot(
                range(len(share)),
                [100 * v for v in share],
                color=gray,
                marker="osD^v<>"[k % 7],
                clip_on=False,
            )
            ends.append((share, gray, k))
        axes[0].set_title("two minima or more")
        axes[0].set_ylabel("systems [%]")
        axes[0].legend(
            handles=[
                plt.Line2D([], [], color=gray, marker="osD^v<>"[k % 7], label=f"{nodes_of(groups[k])} nodes")
                for _, gray, k in ends
            ],
            loc="best",
            handlelength=1.5,
        )
        top = 5.0
        for at, group in zip(axes[1:], groups):
            for name in reversed(results.solvers(group)):
                shares = [
                    100 * missed(found[group, name, w]) if (group, name, w) in found else math.nan
                    for w in weaknesses
                ]
                at.plot(range(len(shares)), shares, clip_on=False, **palette(name))
                top = max(top, np.nanmax(shares))
            at.set_title(f"missed, {nodes_of(group)} nodes")
        for at in axes:
            at.set_xticks(range(len(weaknesses)), [power(w) for w in weaknesses])
            at.set_xlim(-0.1, len(weaknesses) - 0.9)
            at.set_xlabel("anchors ×")
            at.set_ylim(0, 100 if at is axes[0] else 1.08 * top)
        drawings.append(
            Drawing(
                f"minima-{kind}",
                figure,
                title,
                "Left: systems for which random starts find two minima or more. The others: systems"
                " where a solver, from"
                " the problem's own start, ends more than 1e-4 above the lowest of them. To the"
                " right, weaker anchors.",
            )
        )
    return drawings


def tabulate_minima(results: Results) -> str:
    weaknesses = sorted({cell["weakness"] for cell in results.cells}, reverse=True)
    names = list(
        dict.fromkeys(s for kind in results.kinds() for g in results.groups(kind) for s in results.solvers(g))
    )
    rows = []
    for kind in results.kinds():
        for group in results.groups(kind):
            for weakness in weaknesses:
                found = {name: minima_of(results, group, name, weakness) for name in names}
                first = next((data for data in found.values() if data), None)
                if first is None:
                    continue
                rows.append(
                    [
                        f"{group}, anchors × {short(weakness)}",
                        str(len(first["minima"])),
                        percent(several(first)),
                    ]
                    + [percent(missed(data)) if data else "" for data in found.values()]
                )
    starts = max(cell.get("starts", 0) for cell in results.cells)
    return (
        f"Systems; share with two minima or more ({starts} starts); share where each solver misses"
        f" the lowest.\n\n" + table(["", "systems", "several", *(f"`{name}`" for name in names)], rows)
    )


# -------------------------------------------------------------------------------------------------- pareto

FINEST = 1e-11  # gaps below are one: a double's rounding is not far


def trade_off(cells: list[Cell]) -> np.ndarray:
    """Rows (gap, seconds), gap falling: 90th percentile of the gap and median of the time at each tolerance,
    without those that another one beats in both."""
    cells = [cell for cell in cells if cell["tolerances"] == cells[0]["tolerances"]]
    gaps = np.concatenate([cell["gaps"] for cell in cells], axis=1)
    seconds = np.concatenate([cell["seconds"] for cell in cells], axis=1)
    points = sorted((spread(t, 0.5), max(spread(g, 0.9), FINEST)) for g, t in zip(gaps, seconds))
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
    for kind in results.kinds():
        groups = results.groups(kind)
        curves = {g: {s: trade_off(results.of(g, s)) for s in results.solvers(g)} for g in groups}
        title = pareto_title(kind, groups, curves)
        columns = min(2, len(groups))
        figure, axes = panels(len(groups), columns, 2.9, title, right=0.95, gap=0.7)
        for at, group in zip(axes, groups):
            drawn = {name: curve for name, curve in curves[group].items() if len(curve)}
            times = np.concatenate([curve[:, 1] for curve in drawn.values()])
            at.set(xscale="log", yscale="log", xlim=(2, FINEST), ylim=(times.min() / 1.5, times.max() * 1.5))
            at.set(xlabel="relative gap, 90 % of systems", ylabel="CPU time, median [s]")
            at.set_xticks([1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
            at.set_title(f"{nodes_of(group)} nodes")
            ends = []
            for name, curve in drawn.items():
                style = palette(name)
                at.plot(curve[:, 0], curve[:, 1], **style)
                if palette.in_colour(name):
                    ends.append((curve[-1, 0], curve[-1, 1], label_of(name), style["color"]))
            label_ends(at, ends)
        drawings.append(
            Drawing(
                f"pareto-{kind}",
                figure,
                title,
                "Median CPU time of a solve, setup included, against the relative gap to the energy"
                " that the solver itself"
                f" ends at which nine in ten systems stay below; gaps below {short(FINEST)} are drawn"
                f" there. Lower is faster,"
                " further right more accurate. Gray: the other solvers of the table.",
            )
        )
    return drawings


def pareto_title(kind: str, groups: list[str], curves: dict[str, dict[str, np.ndarray]]) -> str:
    parts = []
    for group in groups:
        times = {name: time_to(curve, 1e-6) for name, curve in curves[group].items()}
        best = min(times, key=times.get, default=None)
        if best and math.isfinite(times[best]):
            parts.append(f"{nodes_of(group)} nodes {label_of(best)}, {time(times[best])}")
    if not parts:
        return f"{kind_title(kind)}: time against accuracy"
    return f"{kind_title(kind)}: the fastest to a gap of 1e-6, " + "; ".join(parts)


def tabulate_pareto(results: Results) -> str:
    parts = [
        "Median CPU time until nine systems in ten are within a relative gap of 1e-2 / 1e-6; columns:"
        " nodes.\n"
    ]
    for kind in results.kinds():
        groups = results.groups(kind)
        names = sorted({s for g in groups for s in results.solvers(g)})
        rows = []
        for name in names:
            row = [f"`{name}`"]
            for group in groups:
                cells = results.of(group, name)
                if not cells:
                    row.append("")
                    continue
                curve = trade_off(cells)
                times = [time_to(curve, gap) for gap in (1e-2, 1e-6)]
                row.append(" / ".join(time(t) if math.isfinite(t) else "-" for t in times))
            rows.append(row)
        parts.append(table([kind] + [str(nodes_of(group)) for group in groups], rows))
    return "\n".join(parts)


# ---------------------------------------------------------------------------------------------------- page


@dataclass(frozen=True)
class Experiment:
    title: str
    draw: Callable[[Results, Palette], list[Drawing]]
    tabulate: Callable[[Results], str]


EXPERIMENTS = {
    "convergence": Experiment(
        "Energy against iterations (the paper's Figure 7)", draw_convergence, tabulate_convergence
    ),
    "scaling": Experiment("Effort against the number of nodes (Figure 9)", draw_scaling, tabulate_scaling),
    "hard": Experiment("Hard cases (Figure 8)", draw_hard, tabulate_hard),
    "minima": Experiment("Several minima", draw_minima, tabulate_minima),
    "pareto": Experiment("Accuracy against time", draw_pareto, tabulate_pareto),
}


def shown_command(command: str) -> str:
    """Without what depends on where it ran: folders."""
    words = command.split()
    result = []
    for k, word in enumerate(words):
        if word == "--results" or (k > 0 and words[k - 1] == "--results") or word.startswith("--results="):
            continue
        option, separator, value = word.rpartition("=")
        result.append(option + separator + value.rsplit("/", 1)[-1] if "/" in value else word)
    return " ".join(result)


def provenance(results: Results) -> str:
    """Commands, dates and machines of what was measured."""
    text = "".join(
        f"    {command}\n" for command in dict.fromkeys(shown_command(run["command"]) for run in results.runs)
    )
    by_machine: dict[str, list[dict]] = {}
    for run in results.runs:
        fixed = {name: value for name, value in run["machine"].items() if name != "clock_spread"}
        by_machine.setdefault(json.dumps(fixed, sort_keys=True), []).append(run)
    clocks = [cell["clock"] for cell in results.cells if isinstance(cell.get("clock"), (int, float))]
    for runs in by_machine.values():
        machine = runs[0]["machine"]
        dates = " to ".join(
            dict.fromkeys(
                (min(run["started"] for run in runs)[:10], max(run["started"] for run in runs)[:10])
            )
        )
        build = " ".join(str(machine.get("build", "unknown build")).split())
        packages = ", ".join(map(str, machine.get("packages", [])))
        spread_of_clock = max(run["machine"].get("clock_spread", math.nan) for run in runs)
        sentence = (
            f"{dates}; {machine.get('cpu', 'unknown CPU')}, {machine.get('cores', '?')} cores;"
            f" {machine.get('compiler', 'unknown compiler')}, {build}; {packages}. Quartiles of a fixed computation's"
            f" time: {percent(spread_of_clock)} apart"
        )
        if clocks:
            sentence += (
                f"; beside the cells it took {min(clocks):.2f} to {max(clocks):.2f} of that at the start"
            )
        text += "\n" + paragraph(sentence + ".")
    return text


def paragraph(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False) + "\n"


def page(found: list[tuple[Results, list[Drawing]]], folder: str) -> str:
    names = dict.fromkeys(cell["solver"] for results, _ in found for cell in results.cells)
    text = [
        "# The solver laboratory: results\n",
        paragraph(
            "What the experiments are, and how to run them: [laboratory.md](../laboratory.md). Solvers are named as"
            " `asterism-bench solvers` lists them, which says more of each; in the figures "
            + ", ".join(f"`{name}` is {label_of(name)}" for name in STYLES if name in names)
            + ". Figures and page were made of stored results by"
        ),
        "    bench/figures.py RESULTS_FOLDER --out docs/results/laboratory\n",
    ]
    for results, drawings in found:
        experiment = EXPERIMENTS[results.name]
        text += [f"## {experiment.title}\n", provenance(results)]
        for drawing, following in zip(drawings, [*drawings[1:], None]):
            image = f"{folder}/{drawing.name}"
            text.append(f"[![{drawing.title}]({image}.png)]({image}.svg)\n")
            if following is None or following.caption != drawing.caption:  # once for all alike
                text.append(paragraph(drawing.caption))
        text.append(experiment.tabulate(results))
    return "\n".join(text)


def save(drawing: Drawing, folder: pathlib.Path) -> None:
    # Without dates and versions: the same results, the same files.
    drawing.figure.savefig(folder / f"{drawing.name}.svg", metadata={"Date": None, "Creator": None})
    drawing.figure.savefig(folder / f"{drawing.name}.png", metadata={"Software": None})
    plt.close(drawing.figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("results", type=pathlib.Path, help="folder of asterism-bench's --results")
    parser.add_argument(
        "--out", type=pathlib.Path, required=True, help="folder of the figures; the page is OUT.md"
    )
    parser.add_argument(
        "--solvers", help="those drawn in colour, separated by commas (default: the better known)"
    )
    options = parser.parse_args()

    palette = Palette(options.solvers.split(",") if options.solvers else None)
    found = []
    with plt.rc_context(SETTINGS):
        for results in read(options.results):
            found.append((results, EXPERIMENTS[results.name].draw(results, palette)))
        out = options.out.resolve()
        try:
            out.mkdir(parents=True, exist_ok=True)
            for _, drawings in found:
                for drawing in drawings:
                    save(drawing, out)
            text = page(found, out.name)
            out.with_name(out.name + ".md").write_text(text, encoding="utf-8")
        except OSError as error:
            raise BadInput(f"{error.filename}: {error.strerror}") from error


if __name__ == "__main__":
    try:
        main()
    except BadInput as problem:
        sys.exit(f"figures.py: {problem}")
