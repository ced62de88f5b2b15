#!/usr/bin/env python3
"""bench/laboratory/peers.py: energies against closed forms, derivatives against each other, its table from outside.

Exit code 77, skipped, where numpy is not installed.
"""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
if importlib.util.find_spec("numpy") is None:
    print("skipped: numpy is not installed (Debian package python3-numpy)")
    sys.exit(77)

import numpy as np

SCRIPT = pathlib.Path(__file__).parents[2] / "bench" / "laboratory" / "peers.py"
specification = importlib.util.spec_from_file_location("peers", SCRIPT)
peers = importlib.util.module_from_spec(specification)
sys.modules["peers"] = peers  # dataclasses look the module up there
specification.loader.exec_module(peers)

# Two anchors of stiffness 1, at distance 2, and a spring of stiffness 3 and rest length 4: at the minimum the
# nodes are r = (1 + 12) / 3.5 apart, on the line through the anchors.
PAIR = {
    "asterism_system": 1,
    "name": "pair",
    "dim": 2,
    "anchors": [[0, 0], [2, 0]],
    "anchor_stiffness": [1, 1],
    "links": [[0, 1]],
    "rest_length": [4],
    "link_stiffness": [3],
}
PAIR_APART = 13 / 3.5
PAIR_ENERGY = (PAIR_APART / 2 - 1) ** 2 + 1.5 * (4 - PAIR_APART) ** 2

TRIANGLE = {
    "asterism_system": 1,
    "dim": 2,
    "anchors": [[0, 0], [3, 1], [1, 2]],
    "anchor_stiffness": [1, 0.5, 2],
    "anchor_shape": [[[1, 0], [0, 0.2]], [[0.6, 0.4], [0.4, 0.6]], [[1, 0], [0, 1]]],
    "links": [[0, 1], [0, 2], [1, 2]],
    "rest_length": [1, 2, 3],
    "link_stiffness": [3, 2, 1],
    "fixed": [1],
    "start": [[0.1, 0.2], [3, 2], [1, 1]],
}
LIMITS = peers.Limits(1e-10, 10000)


def run(path, *options, **environment):
    return subprocess.run(
        [sys.executable, str(SCRIPT), str(path), "--repeats", "1", *options],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
    )


class Peers(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = pathlib.Path(scratch.name)

    def write(self, text, name="systems.jsonl"):
        path = self.folder / name
        path.write_text(text)
        return path

    def test_ida_finds_the_known_minimum(self):
        system = peers.system_of(PAIR, 0)
        solution = peers.ida(system, LIMITS)
        self.assertAlmostEqual(system.energy(solution.x), PAIR_ENERGY, places=13)
        self.assertAlmostEqual(np.linalg.norm(solution.x[0] - solution.x[1]), PAIR_APART, places=9)

    def test_ida_never_raises_the_energy(self):
        system = peers.system_of(TRIANGLE, 0)
        energies = [system.energy(peers.ida(system, peers.Limits(0, k)).x) for k in range(30)]
        self.assertTrue(all(b <= a for a, b in zip(energies, energies[1:])), energies)
        self.assertTrue((peers.ida(system, LIMITS).x[1] == [3, 2]).all())

    def test_scipy_agrees(self):
        if peers.optimize is None:
            self.skipTest("scipy is not installed")
        for entry in (PAIR, TRIANGLE):
            system = peers.system_of(entry, 0)
            expected = system.energy(peers.ida(system, LIMITS).x)
            for solver in peers.solvers():
                if solver.name.startswith("scipy"):
                    found = system.energy(solver.solve(system, LIMITS).x)
                    self.assertAlmostEqual(found, expected, places=9, msg=solver.name)

    def test_derivatives(self):
        system = peers.system_of(TRIANGLE, 0)
        x = system.start
        r = system.residuals(x)
        self.assertAlmostEqual(0.5 * r @ r, system.energy(x), places=13)
        gradient = system.gradient(x)
        np.testing.assert_allclose(system.jacobian(x).T @ r, gradient[system.free].ravel(), atol=1e-13)
        hessian = system.hessian(x)
        np.testing.assert_array_equal(hessian, hessian.T)
        step = 1e-6
        for column, (i, d) in enumerate((i, d) for i in (0, 2) for d in (0, 1)):  # of the free nodes
            e = np.zeros_like(x)
            e[i, d] = step
            difference = system.gradient(x + e) - system.gradient(x - e)
            np.testing.assert_allclose(
                hessian[:, column], difference[system.free].ravel() / (2 * step), atol=1e-7
            )
        for i, d in ((0, 0), (2, 1)):
            e = np.zeros_like(x)
            e[i, d] = step
            self.assertAlmostEqual(
                (system.energy(x + e) - system.energy(x - e)) / (2 * step), gradient[i, d], places=7
            )

    def test_coincident_nodes_part(self):
        system = peers.system_of({**PAIR, "start": [[1, 1], [1, 1]]}, 0)
        self.assertAlmostEqual(system.energy(peers.ida(system, LIMITS).x), PAIR_ENERGY, places=13)

    def test_table(self):
        path = self.write(json.dumps(PAIR) + "\n\n" + json.dumps(TRIANGLE) + "\n")
        result = run(path)
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        self.assertIn("For context", result.stdout)
        self.assertIn("pair: 2 nodes, 1 link,", result.stdout)
        self.assertIn("system 1: 3 nodes, 3 links", result.stdout)
        lines = [line.split() for line in result.stdout.splitlines() if line.startswith("numpy-ida")]
        self.assertEqual([line[1] for line in lines], ["converged"] * 2)
        self.assertAlmostEqual(float(lines[0][2]), PAIR_ENERGY, places=12)

    def test_without_scipy_the_rest_runs(self):
        self.write("raise ImportError", "scipy.py")
        result = run(self.write(json.dumps([PAIR])), PYTHONPATH=str(self.folder))
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        self.assertEqual(sum("is not installed" in line for line in result.stdout.splitlines()), 2)
        self.assertIn("numpy-ida", result.stdout)

    def test_bad_input_is_one_line(self):
        result = run(self.folder / "missing.json")
        self.assertEqual((result.returncode, len(result.stderr.splitlines())), (1, 1))
        entries = [{**PAIR, "links": [[0, 2]]}, {**PAIR, "links": [[1, 1]]}, {**PAIR, "rest_length": [-1]}]
        entries += [
            {**PAIR, "anchors": [[0, 0], [2]]},
            {**PAIR, "asterism_system": 2},
            {"dim": 2},
            [],
            5,
            {**PAIR, "fixed": [9]},
        ]
        for text in ("", "[]", "{damaged", *(json.dumps(entry) for entry in entries)):
            path = self.write(text)
            with self.assertRaises(peers.BadInput, msg=text) as caught:
                peers.read(path)
            self.assertTrue(str(caught.exception).startswith(str(path)))
            self.assertNotIn("\n", str(caught.exception))


if __name__ == "__main__":
    unittest.main()
