#!/usr/bin/env python3
"""asterism.survey, against SciPy's least squares, finite differences and simulations."""

import unittest

import asterism
import numpy as np
from asterism.survey import _Network
from scipy.optimize import least_squares


def distances(x):
    return np.linalg.norm(x[:, None] - x[None], axis=-1)


def turned(x, onto):
    """x, moved and turned (or mirrored) as near to `onto` as a rigid motion can, and that rotation."""
    u, _, v = np.linalg.svd((x - x.mean(0)).T @ (onto - onto.mean(0)))
    return (x - x.mean(0)) @ u @ v, u @ v


def scene(seed, count, dim, noise, bias, missing=0.0):
    """Places, biases, and the ranges between them: two of each pair."""
    rng = np.random.default_rng(seed)
    x, c = rng.uniform(0, 10, (count, dim)), bias * rng.normal(size=count)
    ranges = np.maximum(distances(x) + c[:, None] + c[None] + noise * rng.normal(size=(count, count)), 0)
    lost = np.triu(rng.random((count, count)) < missing, 1)
    ranges[lost | lost.T] = np.nan
    return x, c, ranges


class SurveyTest(unittest.TestCase):
    def test_places_without_noise(self):
        for dim in (2, 3):
            x, _, ranges = scene(1, 8, dim, 0, 0, 0.1)
            found = asterism.survey(ranges, 0.1, dim=dim)
            np.testing.assert_allclose(turned(found.x, x)[0], x - x.mean(0), atol=1e-5)
            self.assertLess(found.energy, 1e-6)
            np.testing.assert_array_equal(found.bias, 0)
            np.testing.assert_array_equal(np.isnan(found.residuals), np.isnan(ranges) | np.eye(8, dtype=bool))

    def test_unit_and_order_do_not_matter(self):
        for bias in (0.0, 0.3):
            _, _, ranges = scene(2, 8, 2, 0.05, bias)
            expected = distances(asterism.survey(ranges, 0.05, bias=bias).x)
            order = [3, 0, 7, 1, 6, 2, 5, 4]
            for unit in (1e-9, 1.0, 1e9):
                found = asterism.survey(ranges[np.ix_(order, order)] * unit, 0.05 * unit, bias=bias * unit)
                np.testing.assert_allclose(distances(found.x) / unit, expected[np.ix_(order, order)], rtol=0, atol=1e-6)

    def test_the_least_energy_that_scipy_finds(self):
        for seed, dim, bias in ((1, 2, 0.0), (2, 2, 0.3), (3, 3, 0.3), (4, 3, 0.0)):
            x, c, ranges = scene(seed, 9, dim, 0.1, bias, 0.1)
            sigma = np.random.default_rng(seed).uniform(0.05, 0.2, ranges.shape)
            found = asterism.survey(ranges, sigma, bias=bias, dim=dim)
            i, j = np.nonzero(~np.isnan(ranges) & ~np.eye(9, dtype=bool))

            def residuals(unknowns):
                places, biases = unknowns[: 9 * dim].reshape(9, dim), unknowns[9 * dim :] if bias else np.zeros(9)
                stretch = np.linalg.norm(places[i] - places[j], axis=1) + biases[i] + biases[j] - ranges[i, j]
                return np.concatenate([stretch / sigma[i, j], biases / bias if bias else []])

            start = np.concatenate([x.ravel(), c if bias else []])
            peer = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
            places = peer.x[: 9 * dim].reshape(9, dim)
            np.testing.assert_allclose(turned(found.x, places)[0], places - places.mean(0), atol=1e-4)
            if bias:
                np.testing.assert_allclose(found.bias, peer.x[9 * dim :], atol=1e-4)
            given = (found.residuals[i, j] ** 2).sum() / 2 + (found.bias**2).sum() / 2 / (bias or 1) ** 2
            self.assertAlmostEqual(given, peer.cost, delta=1e-6 * peer.cost)
            # The energy is that of the means of both ranges of a pair.
            self.assertLessEqual(found.energy, peer.cost)
            self.assertLessEqual(found.lower_bound, found.energy)

    def test_the_derivatives_are_those_of_the_energy(self):
        rng = np.random.default_rng(5)
        for bias in (0.0, 0.5):
            weight = rng.uniform(0, 2, (6, 6))
            weight = (weight + weight.T) * (1 - np.eye(6))
            lengths = rng.uniform(0, 9, (6, 6))
            network = _Network((lengths + lengths.T) / 2, weight, bias)
            at = rng.uniform(0, 9, 18 if bias else 12)

            def split(unknowns):
                return unknowns[:12].reshape(6, 2), network._unit * unknowns[12:] if bias else np.zeros(6)

            gradient, hessian = network.derivatives(*split(at), False)
            for k, step in enumerate(1e-5 * np.eye(len(at))):
                ahead, behind = split(at + step), split(at - step)
                self.assertAlmostEqual(gradient[k], (network.energy(*ahead) - network.energy(*behind)) / 2e-5, delta=1e-5)
                change = (network.derivatives(*ahead, False)[0] - network.derivatives(*behind, False)[0]) / 2e-5
                np.testing.assert_allclose(hessian[k], change, atol=1e-5)

    def test_biases_that_are_known_to_be_small(self):
        """A narrow prior is no ill condition: the less the biases may be, the nearer are the places to those without."""
        for dim in (2, 3):
            _, _, ranges = scene(6, 7, dim, 0.1, 0)
            without = asterism.survey(ranges, 0.1, dim=dim)
            for bias in (1e-5, 1e-8, 1e-30, 1e-140):
                found = asterism.survey(ranges, 0.1, bias=bias, dim=dim)
                np.testing.assert_allclose(distances(found.x), distances(without.x), atol=1e-5 + 100 * bias)
                np.testing.assert_allclose(found.covariance, without.covariance, rtol=1e-3, atol=1e-6)
                np.testing.assert_allclose(found.bias_sigma, bias, rtol=1e-3)

    def test_numbers_that_leave_the_range_are_named(self):
        _, _, ranges = scene(6, 5, 2, 0.1, 0)
        for out_of_range in (1e308, 1e-320):
            for arguments, name in (({"sigma": out_of_range}, "sigma"), ({"bias": out_of_range}, "bias")):
                with self.assertRaisesRegex(ValueError, f"^{name}: its square is out of range"):
                    asterism.survey(ranges, **arguments)

    def test_ranges_that_are_too_long(self):
        """With a cutoff, places are those of least squares of the right ranges, which is told which ones these are."""
        for seed, dim, bias, count in ((1, 2, 0.0, 16), (2, 2, 0.3, 20), (3, 3, 0.0, 20), (4, 3, 0.3, 24), (5, 2, 0.0, 16)):
            x, c, ranges = scene(seed, count, dim, 0.05, bias, 0.1)
            rng = np.random.default_rng(seed)
            is_wrong = (rng.random(ranges.shape) < 0.2) & ~np.isnan(ranges) & ~np.eye(count, dtype=bool)
            heard = np.where(is_wrong, ranges + rng.uniform(1, 8, ranges.shape), ranges)
            if seed == 5:  # each pair is measured once
                heard, is_wrong = np.triu(heard, 1) + np.triu(heard, 1).T, np.triu(is_wrong) | np.triu(is_wrong).T
            found = asterism.survey(heard, 0.05, bias=bias, dim=dim, cutoff=5)
            told = asterism.survey(np.where(is_wrong, np.nan, heard), 0.05, bias=bias, dim=dim)
            np.testing.assert_array_equal(found.outliers, is_wrong)
            np.testing.assert_allclose(turned(found.x, told.x)[0], told.x, atol=1e-5)
            np.testing.assert_allclose(found.bias, told.bias, atol=1e-5)
            np.testing.assert_allclose(np.trace(found.covariance, axis1=1, axis2=2), np.trace(told.covariance, axis1=1, axis2=2), rtol=1e-3)
            self.assertAlmostEqual(found.energy, told.energy + 12.5 * is_wrong.sum() / (2 if seed == 5 else 1), places=4)
            self.assertEqual((found.proven, found.lower_bound), (False, 0))

    def test_a_cutoff_that_no_range_reaches(self):
        for bias in (0.0, 0.3):
            _, _, ranges = scene(6, 9, 2, 0.05, bias)
            without, found = asterism.survey(ranges, 0.05, bias=bias), asterism.survey(ranges, 0.05, bias=bias, cutoff=50)
            np.testing.assert_allclose(distances(found.x), distances(without.x), atol=1e-6)
            self.assertFalse(found.outliers.any())
            self.assertAlmostEqual(found.energy, without.energy, places=6)
        noise = np.random.default_rng(7).uniform(1, 90, (7, 7))
        for sigma, cutoff, words in ((1e-6, 1e-3, "no places were found that agree"), (1, 1e200, "its square"), (1, 1e-200, "its square")):
            with self.subTest(cutoff), self.assertRaisesRegex(ValueError, f"^cutoff: {words}"):
                asterism.survey(noise, sigma, cutoff=cutoff)
        for cutoff in (0, -1, np.nan, np.inf, "x"):
            with self.subTest(cutoff), self.assertRaisesRegex((ValueError, TypeError), "cutoff"):
                asterism.survey(ranges, 0.05, cutoff=cutoff)

    def test_a_symmetric_matrix_has_each_measurement_once(self):
        rng = np.random.default_rng(3)
        x = rng.uniform(0, 10, (9, 2))
        ranges = np.triu(distances(x) + 0.05 * rng.normal(size=(9, 9)), 1)
        for bias in (0.0, 0.3):
            once = asterism.survey(np.where(ranges > 0, ranges, np.nan), 0.05, bias=bias)
            both = asterism.survey(ranges + ranges.T, 0.05, bias=bias)
            self.assertAlmostEqual(once.energy, both.energy, places=6)
            np.testing.assert_allclose(np.trace(both.covariance, axis1=1, axis2=2), np.trace(once.covariance, axis1=1, axis2=2), rtol=1e-4)
            self.assertAlmostEqual(once.lower_bound, both.lower_bound, places=6)

    def test_errors_are_as_large_as_the_covariances_say(self):
        for dim, bias in ((2, 0.0), (2, 0.3), (3, 0.3)):
            of_places, of_biases = [], []
            for seed in range(60):
                x, c, ranges = scene(seed, 10, dim, 0.05, bias)
                found = asterism.survey(ranges, 0.05, bias=bias, dim=dim)
                moved, rotation = turned(found.x, x)
                errors = (moved - (x - x.mean(0))) @ rotation.T
                of_places.append(np.mean([e @ np.linalg.solve(C, e) for e, C in zip(errors, found.covariance)]) / dim)
                if bias:
                    of_biases.append(np.mean(((found.bias - c) / found.bias_sigma) ** 2))
            # The median: where biases and places are hardly to be told apart, errors are no longer normal.
            self.assertAlmostEqual(np.median(of_places), 0.95, delta=0.25)
            if bias:
                self.assertAlmostEqual(np.median(of_biases), 0.9, delta=0.3)

    def test_saddles_are_left(self):
        for seed, bias in ((1, 0.3), (13, 0.3), (1, 1.0), (22, 1.0), (27, 1.0)):  # Newton's method ends in one first
            x, c, ranges = scene(seed, 5, 3, 0.1, bias)
            i, j = np.triu_indices(5, 1)

            def residuals(unknowns):
                places, biases = unknowns[:15].reshape(5, 3), unknowns[15:]
                stretch = np.linalg.norm(places[i] - places[j], axis=1) + biases[i] + biases[j] - (ranges[i, j] + ranges[j, i]) / 2
                return np.concatenate([stretch / (0.1 / np.sqrt(2)), biases / bias])

            peer = least_squares(residuals, np.concatenate([x.ravel(), c]), xtol=1e-15, ftol=1e-15, gtol=1e-15)
            found = asterism.survey(ranges, 0.1, bias=bias, dim=3)
            self.assertLessEqual(found.energy, peer.cost * (1 + 1e-6))
            self.assertTrue((found.bias_sigma > 0).all())

    def test_biases_that_are_not_asked_for_are_errors(self):
        x, _, ranges = scene(3, 12, 2, 0.02, 0.3)
        with_biases, without = asterism.survey(ranges, 0.02, bias=0.3), asterism.survey(ranges, 0.02)
        errors = [np.linalg.norm(turned(found.x, x)[0] - (x - x.mean(0))) for found in (with_biases, without)]
        self.assertLess(3 * errors[0], errors[1])
        self.assertEqual((with_biases.proven, with_biases.lower_bound), (False, 0))

    def test_what_the_ranges_cannot_tell(self):
        x, _, ranges = scene(1, 6, 2, 0, 0)
        ranges[2, [0, 1, 3]] = ranges[[0, 1, 3], 2] = np.nan
        self.assertIn("device 2 has ranges to 2 others alone", asterism.survey(ranges, 0.1).message)
        self.assertEqual(asterism.survey(scene(1, 6, 2, 0, 0)[2], 0.1).message, "")
        ranges[2, 4] = ranges[4, 2] = np.nan
        with self.assertRaisesRegex(ValueError, "device 2 can move without changing a range"):
            asterism.survey(ranges, 0.1)

    def test_places_that_do_not_fit_are_doubted(self):
        ranges = scene(1, 6, 2, 0, 0)[2]
        ranges[0, 1] = ranges[1, 0] = 100
        self.assertRegex(asterism.survey(ranges, 0.1).message, "the residuals are .* sigma .*: are ranges and sigma in one unit")
        self.assertEqual(asterism.survey(ranges, 0.1, cutoff=3).message, "")

    def test_bad_input(self):
        good = scene(1, 6, 2, 0.1, 0)[2]
        bad = good.copy()
        bad[1, 2] = -1
        for ranges, options, says in (
            (np.float64(3), {}, r"ranges: expected shape \(N, N\), found \(\)"),
            (good[:5], {}, r"ranges: expected shape \(N, N\), found \(5, 6\)"),
            (bad, {}, "ranges: expected finite numbers >= 0"),
            (np.where(good > 5, np.inf, good), {}, "ranges: "),
            (good, {"sigma": 0.0}, "sigma: expected finite numbers > 0"),
            (good, {"sigma": [1.0, 2.0]}, r"sigma: expected a number or shape \(6, 6\), found \(2,\)"),
            (good, {"bias": -1.0}, "bias: expected a finite number >= 0"),
            (good, {"dim": 4}, "dim: expected 2 or 3, found 4"),
            (good[:2, :2], {}, "expected those of 3 devices or more in 2 dimensions, found 2"),
            (np.full((4, 4), np.nan), {}, "ranges: "),
        ):
            with self.assertRaisesRegex(ValueError, says):
                asterism.survey(ranges, **options)

    def test_the_repr_is_one_short_line(self):
        found = asterism.survey(scene(1, 6, 2, 0.1, 0)[2], 0.1)
        self.assertRegex(repr(found), r"^<asterism\.Survey: x \(6, 2\)[^\n]*>$")


if __name__ == "__main__":
    unittest.main()
