#!/usr/bin/env python3
"""bench/laboratory/figures.py on results made up here, and on those of the executable: figures_test.py [EXECUTABLE].

Exit code 77, skipped, where matplotlib is not installed.
"""

import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
if importlib.util.find_spec("matplotlib") is None:
    print("skipped: matplotlib is not installed (Debian package python3-matplotlib)")
    sys.exit(77)

SCRIPT = pathlib.Path(__file__).parents[2] / "bench" / "laboratory" / "figures.py"
EXECUTABLE = sys.argv[1] if len(sys.argv) > 1 else None
specification = importlib.util.spec_from_file_location("figures", SCRIPT)
figures = importlib.util.module_from_spec(specification)
sys.modules["figures"] = figures  # dataclasses look the module up there
specification.loader.exec_module(figures)

MACHINE = {"cpu": "a CPU", "cores": 2, "compiler": "gcc 1", "build": "Release,  -O3", "packages": ["Eigen 3"]}
SOLVERS = ("ida", "ncg", "ncg-forward", "a-new-one")
PICTURES = ("convergence-lit", "scaling-lit", "hard", "hard-near-coincident", "minima-lit", "proof-lit", "pareto-lit")


def run_record(number=0, command="asterism-bench x --systems 3 --results /some/folder"):
    machine = {**MACHINE, "clock_spread": 0.01}
    return {"run": number, "machine": machine, "command": command, "started": "2026-01-02T03:04:05Z"}


def cells(experiment, systems=3, first=0):
    """A cell of each solver."""
    for k, solver in enumerate(SOLVERS, 1):
        common = {"run": 0, "clock": 1.01, "group": "lit/4", "solver": solver, "systems": systems}
        key = f"lit/4/{first}+{systems}/{solver}"
        if experiment == "convergence":
            yield {
                **common,
                "key": key,
                "looks": [0, 1, 2, 5, 10],
                "remaining": [systems * value for value in (1, 0.5 / k, 0.3 / k, 0.2, 0.1)],
                "gaps": [{"330": systems}, {"300": systems}, {"250": 1, "260": systems - 1}, {"90": systems}]
                + [{"0": systems}],
            }
        elif experiment == "scaling":
            arrived = [7 * k] * (systems - 1)
            yield {
                **common,
                "key": key,
                "nodes": 4,
                "gap": 1e-6,
                "loose_iterations": [5] * systems,
                "iterations": [*arrived, -1],
                "seconds": [1e-6 * k for _ in arrived] + [0],
            }
        elif experiment == "hard":
            square = [[0, 0], [1, 0], [1, 1], [0, 1]]
            yield {
                **common,
                "key": f"near-coincident/0.1/{systems}/{solver}",
                "group": "near-coincident/0.1",
                "case": "near-coincident",
                "level": 0.1,
                "energies": [float(k)] * (systems - 1) + [None],
                "iterations": [10] * systems,
                "statuses": ["converged"] * systems,
                "anchors": square,
                "start": square,
                "end": square,
            }
        elif experiment == "minima":
            for weakness in (1, 0.01):
                yield {
                    **common,
                    "key": f"anchors x {weakness}/{key}",
                    "weakness": weakness,
                    "starts": 60,
                    "minima": [1, 2, 3][:systems],
                    "lowest": [1.0] * systems,
                    "ends": [1.0, 1.0, 2.0][:systems],
                }
        elif experiment == "proof":
            for weakness in (1, 0.01):
                yield {
                    **common,
                    "key": f"anchors x {weakness}/{key}",
                    "weakness": weakness,
                    "energies": [1.0, 2.0, 0.0][:systems],
                    "bounds": [1.0, 1.5, 0.0][:systems],
                    "certified": [True, False, True][:systems],
                    "solve_seconds": [1e-6 * k] * systems,
                    "certify_seconds": [1e-6] * systems,
                }
        else:
            yield {
                **common,
                "key": key,
                "nodes": 4,
                "tolerances": [1, 0.01, 1e-6],
                "gaps": [[0.5] * systems, [1e-3 * k] * systems, [0.0] * systems],
                "seconds": [[1e-6 * k] * systems, [2e-6 * k] * systems, [3e-6 * k] * systems],
            }


class Figures(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)
        self.results = self.folder / "results"
        self.results.mkdir()

    def store(self, experiment, entries, end="\n"):
        lines = [entry if isinstance(entry, str) else json.dumps(entry) for entry in entries]
        (self.results / f"{experiment}.jsonl").write_text("\n".join(lines) + end)

    def store_all(self):
        for experiment in figures.EXPERIMENTS:
            self.store(experiment, [run_record(), *cells(experiment)])

    def draw(self, out="docs/laboratory", results=None):
        command = [sys.executable, SCRIPT, results or self.results, "--out", self.folder / out]
        return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=120)

    def files(self, out="docs/laboratory"):
        folder = self.folder / out
        found = {path.name: path.read_bytes() for path in folder.iterdir()}
        return {**found, "page": folder.with_name(folder.name + "-tables.md").read_bytes()}

    def complaint(self):
        with self.assertRaises(figures.BadInput) as caught:
            figures.read(self.results)
        self.assertNotIn("\n", str(caught.exception))
        return str(caught.exception)

    def test_draws_everything_and_the_same_again(self):
        self.store_all()
        first = self.draw()
        self.assertEqual((first.returncode, first.stderr), (0, ""))
        drawn = self.files()
        for name in PICTURES:
            self.assertTrue(drawn[f"{name}.png"].startswith(b"\x89PNG"), name)
        page = drawn["page"].decode()
        for text in (
            "laboratory/hard.png",
            "2026-01-02",
            "a CPU",
            "gcc 1",
            "```sh\nasterism-bench x --systems 3\n```\n",
            "`a-new-one`",
            "| lit/4, anchors × 1e-2 | `ida` | 3 | 67\N{NO-BREAK SPACE}% | 67\N{NO-BREAK SPACE}% | 0.25 | 1 us |",
        ):
            self.assertIn(text, page)
        self.assertNotIn("/some/folder", page)
        self.assertEqual(self.draw("again/laboratory").returncode, 0)
        self.assertEqual(self.files("again/laboratory"), drawn)

    def test_bad_input_is_one_line(self):
        missing = self.draw(results=self.folder / "missing")
        self.assertNotEqual(missing.returncode, 0)
        self.assertEqual(len(missing.stderr.splitlines()), 1)
        self.assertIn("no such folder", missing.stderr)

    def test_no_results(self):
        self.assertIn("no results", self.complaint())
        self.store("scaling", [run_record()])
        self.assertIn("no results", self.complaint())

    def test_damaged_lines_are_named(self):
        good = list(cells("scaling"))
        short = {**good[0], "iterations": [1]}
        unknown_run = {**good[0], "run": 7}
        for bad in ("{damaged", "[]", "{}", short, unknown_run, {**good[0], "group": "lit"}):
            self.store("scaling", [run_record(), good[1], bad, good[2]])
            self.assertIn("scaling.jsonl, line 3: ", self.complaint())
        self.store("scaling", good)
        self.assertIn("line 1: ", self.complaint())  # a cell without a run

    def test_damage_in_each_experiment(self):
        for experiment in figures.EXPERIMENTS:
            for field in (
                "group",
                "solver",
                "systems",
                "gaps",
                "seconds",
                "energies",
                "end",
                "ends",
                "looks",
            ):
                cell = next(cells(experiment))
                if field not in cell:
                    continue
                for value in (None, 5, "text", []):
                    if (field, value) in (("group", "text"), ("solver", "text"), ("systems", 5)):
                        continue  # valid
                    self.store(experiment, [run_record(), {**cell, field: value}])
                    self.assertIn("line 2: ", self.complaint())
            (self.results / f"{experiment}.jsonl").unlink()

    def test_line_that_an_interrupted_run_left(self):
        good = list(cells("scaling"))
        self.store("scaling", [run_record(), good[0], '{"key": "lit/4/0+3/nc'], end="")
        self.assertEqual(len(figures.read(self.results)[0].cells), 1)

    def test_systems_count_once(self):
        fewer, more = list(cells("scaling", 2)), list(cells("scaling", 3))
        beyond = list(cells("scaling", 3, first=3))
        self.store("scaling", [run_record(), *fewer, *more, *beyond])
        kept = figures.read(self.results)[0].cells
        keys = sorted(cell["key"] for cell in kept if cell["solver"] == "ida")
        self.assertEqual(keys, ["lit/4/0+3/ida", "lit/4/3+3/ida"])

    def test_compares_like_with_like(self):
        first, second = list(cells("scaling", 3)), list(cells("scaling", 3, first=3))
        self.store("scaling", [run_record(), *first, *second[:2]])
        ((_, data),) = figures.by_kind(figures.read(self.results)[0], len)
        self.assertEqual(list(data["lit/4"].items()), [(name, 1) for name in SOLVERS])

    def test_percentiles_of_stored_histograms(self):
        self.store("convergence", [run_record(), *cells("convergence")])
        ((kind, data),) = figures.by_kind(figures.read(self.results)[0], figures.Curve.of)
        curve = data["lit/4"]["ida"]
        self.assertEqual(curve.gap(0.5)[-1], 0)
        self.assertAlmostEqual(curve.gap(0.5)[1], 10 ** (-16 + 299.5 / 20))
        self.assertAlmostEqual(curve.remaining[1], 0.5)

    def test_failures_count_null_energies(self):
        self.store("hard", [run_record(), *cells("hard")])
        (levels,) = figures.hard_cases(figures.read(self.results)[0]).values()
        self.assertAlmostEqual(levels[0].failures("ida"), 1 / 3)  # the one whose energy is null
        self.assertAlmostEqual(levels[0].failures("ncg"), 1)

    @unittest.skipUnless(EXECUTABLE, "without asterism-bench")
    def test_what_the_executable_stores(self):
        for experiment in figures.EXPERIMENTS:
            sizes = [] if experiment == "hard" else ["--sizes", "4"]
            options = ["--solvers", "ida,ncg,ncg-forward", "--systems", "2", "--results", self.results]
            command = [EXECUTABLE, experiment, *sizes, *map(str, options)]
            subprocess.run(command, capture_output=True, check=True, timeout=120)
        result = self.draw()
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        self.assertLessEqual({f"{name}.png" for name in PICTURES}, self.files().keys())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
