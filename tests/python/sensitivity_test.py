#!/usr/bin/env python3
"""Gradients of functions of solutions, against differences of solutions."""

import copy
import pickle
import unittest

import asterism
import numpy as np

ARRAYS = ("anchors", "anchor_stiffness", "rest_length", "link_stiffness")


def solved_system(dim=2, seed=1):
    random = np.random.default_rng(seed)
    points = random.uniform(0, 10, (6, dim))
    system = asterism.SpringSystem(asterism.Topology.full(6), dim)
    system.set_rest_lengths(points)
    system.rest_length *= random.uniform(0.9, 1.1, system.link_count)
    system.anchors = points + random.normal(scale=0.3, size=points.shape)
    system.anchor_stiffness = random.uniform(0.5, 2, 6)
    system.link_stiffness = random.uniform(0.5, 2, system.link_count)
    return system, solve(system, points), random.normal(size=points.shape)


def solve(system, start):
    x = start.copy()
    summary = asterism.solve(system, x, "newton", tolerance=1e-13)
    assert summary.status == asterism.Status.CONVERGED, summary
    return x


class SensitivityTest(unittest.TestCase):
    def test_gradients_are_differences_of_solutions(self):
        for dim in (2, 3):
            system, x, weights = solved_system(dim)
            gradient = asterism.sensitivity(system, x, weights)
            for name in ARRAYS:
                values = getattr(system, name)
                result = getattr(gradient, name)
                self.assertEqual(result.shape, values.shape)
                expected = np.empty_like(result)
                for i in range(values.size):
                    losses = []
                    for step in (1e-4, -1e-4):
                        moved = system.copy()
                        getattr(moved, name).flat[i] += step
                        losses.append(np.sum(weights * solve(moved, x)))
                    expected.flat[i] = (losses[0] - losses[1]) / 2e-4
                np.testing.assert_allclose(result, expected, atol=1e-6, err_msg=name)

    def test_the_solution_tangent_is_the_same_derivative(self):
        system, x, weights = solved_system(3)
        gradient = asterism.sensitivity(system, x, weights)
        random = np.random.default_rng(1)
        total = 0
        tangents = {name: random.normal(size=getattr(system, name).shape) for name in ARRAYS}
        for name, tangent in tangents.items():
            moved = asterism.solution_tangent(system, x, **{name: tangent})
            self.assertEqual(moved.shape, x.shape)
            total = total + moved
            self.assertAlmostEqual(np.sum(weights * moved), np.sum(getattr(gradient, name) * tangent), places=10)
        np.testing.assert_allclose(asterism.solution_tangent(system, x, **tangents), total, atol=1e-12)
        self.assertTrue((asterism.solution_tangent(system, x) == 0).all())

    def test_results_are_copied_and_pickled(self):
        gradient = asterism.sensitivity(*solved_system())
        for other in (gradient.copy(), copy.copy(gradient), copy.deepcopy(gradient), pickle.loads(pickle.dumps(gradient))):
            self.assertIs(type(other), asterism.Sensitivity)
            for name in ARRAYS:
                np.testing.assert_array_equal(getattr(other, name), getattr(gradient, name))

    def test_errors(self):
        system, x, weights = solved_system()
        with self.assertRaisesRegex(np.linalg.LinAlgError, "not a stationary point"):
            asterism.sensitivity(system, x + 0.1 * weights, weights)
        with self.assertRaisesRegex(np.linalg.LinAlgError, "not a stationary point"):
            asterism.solution_tangent(system, x + 0.1 * weights)
        asterism.sensitivity(system, x + 1e-3 * weights, weights, stationarity=0.1)
        with self.assertRaisesRegex(ValueError, "grad_x"):
            asterism.sensitivity(system, x, weights[1:])
        with self.assertRaisesRegex(ValueError, "grad_x of node 2 is not finite"):
            asterism.sensitivity(system, x, np.where(np.arange(6)[:, None] == 2, np.nan, weights))
        with self.assertRaisesRegex(ValueError, "option stationarity is negative"):
            asterism.sensitivity(system, x, weights, stationarity=-1)
        with self.assertRaisesRegex(ValueError, "rest_length"):
            asterism.solution_tangent(system, x, rest_length=np.ones(3))
        system.anchor_stiffness = [1, 0, 0, 0, 0, 0]
        x = solve(system, x)
        with self.assertRaisesRegex(np.linalg.LinAlgError, "can rotate about node 0"):
            asterism.sensitivity(system, x, weights)


if __name__ == "__main__":
    unittest.main()
