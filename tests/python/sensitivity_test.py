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

    def test_a_batch_has_the_gradients_of_its_systems(self):
        for dim in (2, 3):
            cases = [solved_system(dim, seed) for seed in range(20)]
            cases[3][1][0, 0] += 1  # not stationary
            cases[5][2][1, 1] = np.nan
            batch = asterism.SpringBatch(cases[0][0].topology, len(cases), dim)
            for name in ARRAYS:
                setattr(batch, name, [getattr(system, name) for system, _, _ in cases])
            batch.x = [x for _, x, _ in cases]
            weights = np.array([weights for _, _, weights in cases])
            gradient = batch.sensitivity(weights)
            self.assertIs(type(gradient), asterism.Sensitivity)
            expected = np.full(20, asterism.SensitivityStatus.COMPUTED)
            expected[3], expected[5] = asterism.SensitivityStatus.NOT_STATIONARY, asterism.SensitivityStatus.INVALID_INPUT
            np.testing.assert_array_equal(gradient.status, expected)
            for name in ARRAYS:
                values = getattr(gradient, name)
                self.assertEqual(values.shape, getattr(batch, name).shape)
                for b, (system, x, _) in enumerate(cases):
                    if b in (3, 5):
                        self.assertTrue(np.isnan(values[b]).all())
                    else:
                        one = getattr(asterism.sensitivity(system, x, weights[b]), name)
                        np.testing.assert_allclose(values[b], one, rtol=1e-9, atol=1e-10, err_msg=name)
            loose = batch.sensitivity(weights, stationarity=10, threads=2, simd="portable")
            self.assertNotEqual(loose.status[3], asterism.SensitivityStatus.NOT_STATIONARY)
            other = pickle.loads(pickle.dumps(gradient.copy()))
            np.testing.assert_array_equal(other.anchors, gradient.anchors)
            np.testing.assert_array_equal(other.status, gradient.status)

    def test_errors_of_a_batch(self):
        system, x, weights = solved_system()
        batch = asterism.SpringBatch(system.topology, 2)
        with self.assertRaisesRegex(ValueError, r"grad_x: expected shape \(2, 6, 2\), found \(6, 2\)"):
            batch.sensitivity(weights)
        weights = np.stack([weights, weights])
        self.assertTrue((batch.sensitivity(weights).status == asterism.SensitivityStatus.INVALID_INPUT).all())  # never filled
        for options, message in (
            ({"stationarity": -1}, "option stationarity is negative"),
            ({"threads": -1}, "threads: expected 0 or more"),
            ({"simd": "mmx"}, "simd: expected auto"),
        ):
            with self.assertRaisesRegex(ValueError, message):
                batch.sensitivity(weights, **options)
        empty = asterism.SpringBatch(system.topology, 0).sensitivity(np.empty((0, 6, 2)))
        self.assertEqual((empty.anchors.shape, empty.link_stiffness.shape, empty.status.shape), ((0, 6, 2), (0, 15), (0,)))

    def test_the_status_numbers_are_those_of_the_library(self):
        system, x, weights = solved_system()
        Status = asterism.SensitivityStatus
        saddle = np.array([[0.0, 0], [4, 0], [9, 0], [15, 0], [22, 0], [30, 0]])
        crossed = system.copy()
        crossed.anchors, crossed.link_stiffness = saddle, 0.1
        crossed.set_rest_lengths(saddle)
        crossed.rest_length *= 3
        force = np.zeros((6, 2))  # of the links on the nodes: the anchors are put where they balance it
        for (i, j), k, mu in zip(crossed.topology.links, crossed.link_stiffness, crossed.rest_length):
            d = saddle[i] - saddle[j]
            pull = k * (1 - mu / np.linalg.norm(d)) * d
            force[i] += pull
            force[j] -= pull
        crossed.anchor_stiffness = 1e-2
        crossed.anchors = saddle + force / 1e-2
        at_one_point = system.copy()
        at_one_point.anchors, at_one_point.rest_length = np.ones((6, 2)), 1  # the links push the nodes apart
        cases = {
            Status.COMPUTED: (system, x, weights),
            Status.NOT_STATIONARY: (system, x + 1, weights),
            Status.NOT_POSITIVE_DEFINITE: (crossed, saddle, weights),
            Status.COINCIDENT_NODES: (at_one_point, np.ones((6, 2)), weights),
            Status.INVALID_INPUT: (system, x, weights * np.inf),
        }
        batch = asterism.SpringBatch(system.topology, len(cases))
        for name in ARRAYS:
            setattr(batch, name, [getattr(case[0], name) for case in cases.values()])
        batch.x = [case[1] for case in cases.values()]
        np.testing.assert_array_equal(batch.sensitivity([case[2] for case in cases.values()]).status, list(cases))
        self.assertEqual(f"{Status.NOT_STATIONARY}", "SensitivityStatus.NOT_STATIONARY")

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
