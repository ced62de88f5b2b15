#!/usr/bin/env python3
"""asterism.bench: a solver of one's own beside the library's."""

import unittest

import asterism
import numpy as np
from asterism import bench


def newton(problem):
    """Newton's method with the Hessian's absolute eigenvalues, and backtracking."""
    x = problem.start.copy()
    for _ in range(200):
        gradient = problem.gradient(x).ravel()
        values, vectors = np.linalg.eigh(problem.hessian(x))
        step = (vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(values), 1e-9 * np.abs(values).max()))).reshape(x.shape)
        energy, t = problem.energy(x), 1.0
        while t > 1e-12 and problem.energy(x - t * step) > energy:
            t /= 2
        x = x - t * step
        if asterism.stationarity(problem.system, x) < 1e-10:
            break
    return x


class RandomSystemTest(unittest.TestCase):
    def test_repeats(self):
        for kind in ("lit", "orig", "disp", "track"):
            for dim in (2, 3):
                (a, x), (b, y) = (asterism.random_system(kind, 5, 7, dim) for _ in range(2))
                self.assertEqual(x.shape, (5, dim))
                self.assertTrue((x == y).all() and (a.anchors == b.anchors).all() and (a.rest_length == b.rest_length).all())
                self.assertFalse((asterism.random_system(kind, 5, 8, dim)[1] == x).all())
                self.assertTrue(asterism.solve(a, x))

    def test_refuses(self):
        for arguments in (("lit", 0, 1), ("lit", 4, 1, 4), ("grid", 4, 1)):
            with self.assertRaises(ValueError):
                asterism.random_system(*arguments)


class CompareTest(unittest.TestCase):
    def test_counts_and_judges(self):
        result = bench.compare(newton, kinds=["lit", "track"], sizes=[4], systems=20, against=["newton", "ida"])
        self.assertEqual([(row.kind, row.solver) for row in result.rows], [(k, s) for k in ("lit", "track") for s in ("mine", "newton", "ida")])
        for row in result.rows:
            self.assertEqual((row.nodes, row.systems, row.failed), (4, 20, 0))
            self.assertGreaterEqual(row.converged, 19)
            self.assertLessEqual(row.lowest, 20)
            self.assertGreater(row.lowest, 10)
            self.assertGreater(row.proven, 10)
            self.assertGreater(row.evaluations, 2)
            self.assertGreater(row.seconds, 0)
        self.assertIn("mine", str(result))
        self.assertEqual(result.errors, [])

    def test_a_wrong_answer_is_not_lowest(self):
        result = bench.compare(lambda problem: problem.start, kinds=["lit"], sizes=[4], systems=5, against=[])
        (row,) = result.rows
        self.assertEqual((row.converged, row.lowest, row.failed, row.evaluations), (0, 0, 0, 0))

    def test_the_solver_may_change_its_system(self):
        def cheat(problem):
            problem.system.link_stiffness = 0
            return problem.system.anchors.copy()

        (row,) = bench.compare(cheat, kinds=["lit"], sizes=[4], systems=3, against=[]).rows
        self.assertEqual(row.lowest, 0)

    def test_failures_are_reported(self):
        def raises(problem):
            raise RuntimeError("no idea")

        for solver, text in (
            (raises, "RuntimeError: no idea"),
            (lambda problem: problem.start[:2], "shape (2, 2), expected (4, 2)"),
            (lambda problem: problem.start * np.nan, "not finite"),
        ):
            result = bench.compare(solver, kinds=["track"], sizes=[4], systems=2, against=["ida"])
            self.assertEqual([row.failed for row in result.rows], [2, 0])
            self.assertIn(text, str(result))
        with self.assertRaises(ValueError):
            bench.compare(newton, systems=0)
        with self.assertRaises(ValueError):
            bench.compare(newton, against=["nonsense"])


if __name__ == "__main__":
    unittest.main()
