#!/usr/bin/env python3
"""asterism-bench as a user runs it: laboratory_test.py EXECUTABLE [MPIEXEC]."""

import json
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

EXECUTABLE = sys.argv[1]
MPIEXEC = sys.argv[2] if len(sys.argv) > 2 else None

# Four nodes near a square's corners, which are their targets: one minimum, of energy 0.
SQUARE = {
    "asterism_system": 1,
    "dim": 2,
    "name": "square",
    "anchors": [[0, 0], [10, 0], [0, 10], [10, 10]],
    "anchor_stiffness": [1, 2, 3, 4],
    "links": [[0, 1], [0, 2], [1, 3], [2, 3]],
    "rest_length": [11, 9, 10, 10],
    "link_stiffness": [5, 6, 7, 8],
    "start": [[1, 1], [9, 2], [-1, 8], [12, 10]],
}

# Five nodes, one of them fixed, linked like a house: no solver is compiled for so many.
HOUSE = {
    "asterism_system": 1,
    "dim": 2,
    "name": "house",
    "anchors": [[0, 0], [10, 0], [0, 10], [10, 10], [5, 16]],
    "anchor_stiffness": [1, 2, 3, 4, 2],
    "links": [[0, 1], [0, 2], [1, 3], [2, 3], [2, 4], [3, 4]],
    "rest_length": [11, 9, 10, 10, 9, 8],
    "link_stiffness": [5, 6, 7, 8, 6, 5],
    "fixed": [1],
    "start": [[1, 1], [9, 1], [-1, 8], [12, 10], [4, 17]],
}


def run(*arguments, launcher=()):
    return subprocess.run([*launcher, EXECUTABLE, *map(str, arguments)], capture_output=True, text=True, timeout=600)


class Laboratory(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def cells(self, name, folder="results"):
        """Cells by key, without what depends on the clock."""
        lines = (self.folder / folder / (name + ".jsonl")).read_text().splitlines()
        cells = {}
        for line in map(json.loads, lines):
            if "machine" not in line:
                cells[line["key"]] = {k: v for k, v in line.items() if k not in ("clock", "run", "seconds")}
        return cells

    def convergence(self, *arguments, folder="results", solvers="ida,newton", launcher=()):
        return run("convergence", "--sizes", 4, "--solvers", solvers, "--results", self.folder / folder,
                   *arguments, launcher=launcher)

    def long_run(self):
        """An experiment of hours that has stored its first cells."""
        path = self.folder / "results" / "convergence.jsonl"
        process = subprocess.Popen([EXECUTABLE, "convergence", "--sizes", "4", "--solvers", "ida", "--systems",
                                    "10000000", "--results", str(self.folder / "results")],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and (not path.exists() or path.read_text().count("\n") < 4):
            time.sleep(0.05)
        return process

    def test_every_solver_reaches_the_minimum(self):
        for system in (SQUARE, HOUSE):
            with self.subTest(system["name"]):
                file = self.folder / "system.json"
                file.write_text(json.dumps(system))
                result = run("solve", file, "--solver", "all")
                self.assertEqual(result.returncode, 0, result.stderr)
                rows = [line.split() for line in result.stdout.splitlines()[2:]]
                names = [row[0] for row in rows]
                self.assertEqual(names, sorted(names))
                for name in ("ida", "newton", "lbfgs", "auto", "ncg", "eigen-lm"):
                    self.assertIn(name, names)
                if "ceres-dense" in names:
                    self.assertIn("ceres-tiny", names)
                energies = {row[0]: float(row[-6]) for row in rows}
                for name, energy in energies.items():
                    self.assertAlmostEqual(energy / energies["newton"], 1, delta=1e-6, msg=name)

    def test_systems_of_terms(self):
        """The square as anchors and links has the energy of its springs, in one file with them, by every method of such systems."""
        terms = {
            "asterism_system": 2, "dim": 2, "nodes": 4, "name": "terms", "start": SQUARE["start"],
            "terms": [
                {"kind": "anchors", "nodes": [0, 1, 2, 3], "position": SQUARE["anchors"], "stiffness": SQUARE["anchor_stiffness"]},
                {"kind": "links", "nodes": SQUARE["links"], "length": SQUARE["rest_length"], "stiffness": SQUARE["link_stiffness"]},
            ],
        }
        file = self.folder / "both.jsonl"
        file.write_text(json.dumps(SQUARE) + "\n" + json.dumps(terms))
        result = run("solve", file, "--solver", "newton,ida")
        self.assertEqual(result.returncode, 0, result.stderr)
        energies = [float(line.split()[-6]) for line in result.stdout.splitlines() if line.startswith(("newton", "ida"))]
        self.assertEqual(len(energies), 4)
        for energy in energies:
            self.assertAlmostEqual(energy / energies[0], 1, delta=1e-6)
        file.write_text(json.dumps(terms))
        result = run("solve", file)
        self.assertEqual(result.returncode, 0, result.stderr)
        rows = [line.split() for line in result.stdout.splitlines()[2:]]
        self.assertEqual([row[0] for row in rows], ["auto", "newton", "newton-cg", "lbfgs", "ncg", "ida", "schwarz", "schwarz-direct", "multi-start", "graduated"])
        for row in rows:
            self.assertAlmostEqual(float(row[-6]) / energies[0], 1, delta=1e-6, msg=row[0])
        result = run("solve", file, "--solver", "newtn")
        self.assertNotEqual(result.returncode, 0)
        self.assertIn("did you mean 'newton'", result.stderr)

    def test_problem_set(self):
        """Every stored problem is scored; the strongest method solves more than the paper's, and all that are made anew."""
        stored = pathlib.Path(__file__).parents[2] / "bench/problems"
        result = run("problems", "--set", stored, "--solvers", "ida,staircase")
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        solved = dict(re.findall(r"^(\S+): (\d+) of \d+ solved$", result.stdout, re.MULTILINE))
        count = sum(len(file.read_text().splitlines()) for file in stored.glob("*.jsonl"))
        self.assertIn(f"of {count} solved", result.stdout)
        self.assertGreater(int(solved["staircase"]), int(solved["ida"]))

        made = self.folder / "made"
        self.assertEqual(run("problems", "--set", made, "--make", 1).returncode, 0)
        for file in made.glob("*.jsonl"):
            self.assertEqual(len(file.read_text().splitlines()), 1)
            remade, kept = (json.loads(f.read_text().splitlines()[0]) for f in (file, stored / file.name))
            self.assertEqual(remade["anchors"], kept["anchors"])
            self.assertAlmostEqual(remade["origin"]["minimum"] / kept["origin"]["minimum"], 1, delta=1e-6, msg=file.stem)

        worse = json.loads((made / "lit-4.jsonl").read_text())
        worse["origin"]["minimum"] *= 1.1
        (made / "lit-4.jsonl").write_text(json.dumps(worse))
        result = run("problems", "--set", made)
        self.assertEqual(result.returncode, 1)
        self.assertRegex(result.stderr, r"^asterism-bench: .*lit-4\.jsonl: lit-4/0: the energy of origin\.minimiser is .*\n$")
        result = run("problems", "--set", self.folder)
        self.assertRegex(result.stderr, r"^asterism-bench: .*: no files \*\.jsonl of problems\n$")

    def plugin(self, code):
        """The shared library of a C program that includes solver_plugin.h."""
        source, library = self.folder / "own.c", self.folder / "own.so"
        source.write_text('#include "solver_plugin.h"\n' + code)
        include = pathlib.Path(__file__).parents[2] / "bench/laboratory"
        subprocess.run(["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-I", include, "-o", library, source],
                       check=True)
        return library

    @unittest.skipUnless(shutil.which("cc"), "no C compiler")
    def test_a_solver_from_a_shared_library(self):
        file = self.folder / "house.json"
        file.write_text(json.dumps(HOUSE))
        descent = """
static int minimise(const asterism_problem* problem, double* x) {
  double g[10];
  if (problem->nodes != 5 || problem->links != 6 || problem->ends[3] != 2 || !problem->fixed[1] || problem->fixed[0]) return 1;
  for (int iteration = 0; iteration < problem->max_iterations; ++iteration) {
    problem->evaluate(problem, x, g);
    if (problem->iterated(problem)) break;
    for (int k = 0; k < 10; ++k) x[k] -= 0.02 * g[k];
  }
  return 0;
}
const asterism_solver asterism_solver_plugin = {%s, "mine", "my own", 10, 10, minimise};
"""
        library = self.plugin(descent % "ASTERISM_SOLVER_VERSION")
        result = run("--plugin", library, "solve", file, "--solvers", "mine,newton")
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        mine, newton = (line.split() for line in result.stdout.splitlines()[2:])
        self.assertEqual(mine[:2], ["mine", "converged"])
        self.assertAlmostEqual(float(mine[2]) / float(newton[2]), 1, delta=1e-9)
        self.assertGreater(int(mine[5]), 10)  # evaluations
        self.assertEqual(int(mine[4]), int(mine[5]))

        result = run("--plugin", library, "solve", file, "--solvers", "mine", "--iterations", 3)
        self.assertRegex(result.stdout, r"mine +maximum number of iterations +\S+ +\S+ +3 ")
        result = run("--plugin", library, "solvers")
        self.assertRegex(result.stdout, r"(?m)^mine +own\.so +my own$")

        # One that makes nothing of its evaluations but its x, and one that fails and leaves no number.
        no_use = "static int minimise(const asterism_problem* p, double* x) { %s return 1; }" + descent.split("}\n")[-1]
        for wrong in ("(void)p; x[0] = 0.0 / 0.0;", "(void)p; x[0] = 1e9;", "(void)p; x[2] = 77;"):
            result = run("--plugin", self.plugin(no_use % (wrong, "ASTERISM_SOLVER_VERSION")), "solve", file, "--solvers", "mine")
            start = re.search(r"energy at the start (\S+)", result.stdout)[1]
            self.assertRegex(result.stdout, rf"mine +no progress +{re.escape(start)} ")

        other = self.folder / "other.so"
        other.write_bytes(b"not a library")
        empty = self.plugin("int nothing = 1;")
        for library, words in [(other, "other.so"), (empty, "has no asterism_solver_plugin")]:
            result = run("--plugin", library, "solvers")
            self.assertEqual(result.returncode, 1)
            self.assertRegex(result.stderr, rf"^asterism-bench: .*{words}.*\n$")
        result = run("--plugin", self.plugin(descent % "7"), "solvers")
        self.assertRegex(result.stderr, r"^asterism-bench: .*made for version 7 of solver_plugin.h, not 1\n$")
        result = run("--plugin", self.folder / "missing.so", "solvers")
        self.assertEqual(result.returncode, 2)

    def test_problems_are_one_line(self):
        broken = self.folder / "broken.json"
        broken.write_text('{"asterism_system": 1, "dim": 2}')
        for arguments, words in [
            (("solve", self.folder / "missing.json"), "missing.json"),
            (("solve", broken), "anchors is missing"),
            (("solve", broken, "--solver", "newtom"), "unknown solver 'newtom', did you mean 'newton'?"),
            (("convergence", "--kinds", "lid"), "lid"),
            ((), "subcommand"),
            (("frobnicate",), "unknown argument frobnicate (commands: "),
            (("slove",), "unknown argument slove, did you mean 'solve'? (commands: "),
        ]:
            result = run(*arguments)
            self.assertNotEqual(result.returncode, 0)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            self.assertIn(words, result.stderr)

    def test_results_are_measured_once(self):
        first = self.convergence("--systems", 200)
        self.assertEqual(first.returncode, 0, first.stderr)
        self.assertIn("IDA needs fewer iterations", self.convergence("--systems", 200, solvers="ida,ncg").stdout)
        before = (self.folder / "results" / "convergence.jsonl").read_text()
        again = self.convergence("--systems", 200)
        self.assertEqual(again.stdout, first.stdout)
        self.assertEqual(sorted((self.folder / "results" / "convergence.jsonl").read_text().splitlines()),
                         sorted(before.splitlines()))

    def test_an_incomplete_line_is_measured_again(self):
        self.convergence("--systems", 200)
        path = self.folder / "results" / "convergence.jsonl"
        expected = self.cells("convergence")
        self.assertEqual(len(expected), 4)
        path.write_text(path.read_text()[:-20])
        self.assertEqual(self.convergence("--systems", 200).returncode, 0)
        self.assertEqual(self.cells("convergence"), expected)

    def test_damage_names_file_and_line(self):
        self.convergence("--systems", 100)
        path = self.folder / "results" / "convergence.jsonl"
        lines = path.read_text().splitlines()
        lines[1] = lines[1][:30]
        path.write_text("\n".join(lines) + "\n")
        result = self.convergence("--systems", 100)
        self.assertEqual(result.returncode, 1)
        self.assertIn("convergence.jsonl, line 2", result.stderr)

    def test_goes_on_after_an_interruption(self):
        long_run = self.long_run()
        long_run.send_signal(signal.SIGINT)
        _, errors = long_run.communicate(timeout=60)
        self.assertEqual(long_run.returncode, 128 + signal.SIGINT)
        self.assertIn("the same command goes on from here", errors)
        kept = self.cells("convergence")
        self.assertGreaterEqual(len(kept), 2)
        self.assertEqual(self.convergence("--systems", 200).returncode, 0)
        after = self.cells("convergence")
        for key, cell in kept.items():
            self.assertEqual(after[key], cell)

    def test_a_folder_at_work_is_refused(self):
        long_run = self.long_run()
        second = self.convergence("--systems", 200)
        long_run.send_signal(signal.SIGINT)
        long_run.communicate(timeout=60)
        self.assertEqual(second.returncode, 1)
        self.assertEqual(second.stderr.count("\n"), 1, second.stderr)
        self.assertIn("another process is at work there", second.stderr)

    def test_recorded_systems_are_those_of_the_file(self):
        found = []
        for stiffness in (5, 50):
            recorded = self.folder / "recorded.jsonl"
            recorded.write_text(json.dumps({**SQUARE, "link_stiffness": [stiffness] * 4}) + "\n")
            result = run("convergence", "--kinds", "lit", "--sizes", 4, "--systems", 1, "--solvers", "ida",
                         "--recorded", recorded, "--results", self.folder / "results")
            self.assertEqual(result.returncode, 0, result.stderr)
            found.append(set(self.cells("convergence")))
        self.assertEqual(len(found[1] - found[0]), 1)

    def test_what_cannot_be_printed_is_an_error(self):
        with open("/dev/full", "w", encoding="utf-8") as full:
            result = subprocess.run([EXECUTABLE, "solvers"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        self.assertEqual((result.returncode, result.stderr),
                         (1, "asterism-bench: standard output cannot be written\n"))

    @unittest.skipIf(MPIEXEC is None, "built without MPI")
    def test_processes_find_the_same(self):
        self.convergence("--systems", 500, folder="one")
        shared = self.convergence("--systems", 500, folder="three",
                                  launcher=(MPIEXEC, "--allow-run-as-root", "--oversubscribe", "-n", "3"))
        self.assertEqual(shared.returncode, 0, shared.stderr)
        self.assertEqual(self.cells("convergence", "three"), self.cells("convergence", "one"))
        self.assertEqual(list(self.cells("convergence", "three")), list(self.cells("convergence", "one")))
        self.assertEqual(list((self.folder / "three").glob("*.part*")), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
