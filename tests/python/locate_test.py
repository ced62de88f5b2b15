#!/usr/bin/env python3
"""asterism.locate on NumPy arrays, against SciPy's least squares from many starts."""

import itertools
import unittest

import asterism
import numpy as np
from scipy.optimize import least_squares

NAN = float("nan")
SQUARE = [[0, 0], [10, 0], [10, 8], [0, 8]]


def residuals(x, beacons, ranges, sigma):
    return (np.linalg.norm(x - beacons, axis=1) - ranges) / sigma


def least_energy(beacons, ranges, sigma, starts):
    """The least energy of SciPy's descents."""
    best = np.inf, None
    for start in starts:
        found = least_squares(residuals, start, args=(beacons, ranges, sigma), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        best = min(best, (found.cost, tuple(found.x)))
    return best


class LocateTest(unittest.TestCase):
    def test_the_least_energy_that_scipy_finds(self):
        rng = np.random.default_rng(1)
        for trial, dim in itertools.product(range(15), (2, 3)):
            beacons = rng.uniform(0, 10, (dim + 1 + trial % 5, dim))
            sigma = rng.uniform(0.1, 0.5, len(beacons))
            ranges = np.linalg.norm(rng.uniform(0, 10, dim) - beacons, axis=1) + sigma * rng.normal(size=len(beacons))
            ranges = np.maximum(ranges, 0)
            fix = asterism.locate(beacons, ranges, sigma)
            energy, x = least_energy(beacons, ranges, sigma, rng.uniform(-5, 15, (30, dim)))
            self.assertTrue(fix.proven)
            self.assertAlmostEqual(fix.energy, energy, places=7)
            np.testing.assert_allclose(fix.x, x, atol=1e-4)
            self.assertAlmostEqual(sum(minimum.weight for minimum in fix.minima), 1)
            np.testing.assert_array_equal(fix.minima[0].x, fix.x)
            jacobian = (fix.x - beacons) / np.linalg.norm(fix.x - beacons, axis=1)[:, None] / sigma[:, None]
            self.assertEqual(fix.covariance.shape, (dim, dim))
            if fix.energy < 1:  # Gauss-Newton's matrix is near the Hessian
                gauss_newton = np.linalg.inv(jacobian.T @ jacobian)
                np.testing.assert_allclose(fix.covariance, gauss_newton, atol=np.abs(gauss_newton).max())
            self.assertFalse(fix.outliers.any())

    def test_minima_in_curved_valleys_are_stationary(self):
        """Far from few beacons, of different certainty, a valley along a circle has hardly any slope."""
        for seed in range(80):
            rng, dim, cutoff = np.random.default_rng(seed), 2 + seed % 2, None if seed % 4 == 0 else 3.0
            beacons = rng.normal(0, 1, (dim + 1 + seed % 3, dim))
            sigma = 10 ** rng.uniform(-2, 0.5, len(beacons))
            ranges = np.abs(np.linalg.norm(rng.normal(0, 60, dim) - beacons, axis=1) + sigma * rng.normal(size=len(beacons)))
            for minimum in asterism.locate(beacons, ranges, sigma, cutoff=cutoff, max_cells=20_000).minima:
                found = residuals(minimum.x, beacons, ranges, sigma)
                slope = np.where(np.abs(found) < (cutoff or np.inf), found / sigma, 0)
                gradient = slope @ ((minimum.x - beacons) / np.linalg.norm(minimum.x - beacons, axis=1)[:, None])
                self.assertGreater(np.linalg.eigvalsh(minimum.covariance).min(), 0)
                self.assertLess(0.5 * gradient @ minimum.covariance @ gradient, 1e-6)

    def test_outliers(self):
        beacons = np.array(SQUARE + [[5, 12], [-4, 4], [14, 4]], float)
        tag = np.array([3.0, 2.0])
        ranges = np.linalg.norm(tag - beacons, axis=1)
        ranges[[1, 5]] += [4, 7]
        fix = asterism.locate(beacons, ranges, 0.1, cutoff=3)
        self.assertTrue(fix.proven)
        np.testing.assert_allclose(fix.x, tag, atol=1e-6)
        self.assertEqual(list(np.flatnonzero(fix.outliers)), [1, 5])
        self.assertAlmostEqual(fix.energy, 2 * 9 / 2)
        self.assertGreater(np.linalg.norm(asterism.locate(beacons, ranges, 0.1).x - tag), 0.3)

    def test_the_mirror_image(self):
        fix = asterism.locate([[0, 0], [10, 0]], [5, 8], 0.1)
        self.assertEqual(len(fix.minima), 2)
        self.assertAlmostEqual(fix.minima[0].x[1], -fix.minima[1].x[1])
        self.assertIn("mirror", fix.message)

    def test_a_batch_is_each_tag(self):
        rng = np.random.default_rng(2)
        beacons = rng.uniform(0, 10, (6, 3))
        ranges = np.linalg.norm(rng.uniform(0, 10, (300, 1, 3)) - beacons, axis=2) + 0.1 * rng.normal(size=(300, 6))
        ranges = np.abs(ranges)
        ranges[::3, 1] = NAN
        sigma = rng.uniform(0.05, 0.2, (300, 6))
        for threads, places in ((1, beacons), (2, np.tile(beacons, (300, 1, 1)))):
            batch = asterism.locate(places, ranges, sigma, cutoff=4, threads=threads)
            for tag in range(0, 300, 7):
                one = asterism.locate(beacons, ranges[tag], sigma[tag], cutoff=4)
                np.testing.assert_array_equal(batch.x[tag], one.x)
                np.testing.assert_array_equal(batch.covariance[tag], one.covariance)
                np.testing.assert_array_equal(batch.outliers[tag], one.outliers)
                self.assertEqual(batch.energy[tag], one.energy)
                self.assertEqual(batch.message[tag], one.message)
                self.assertEqual(batch.proven[tag], one.proven)
                self.assertEqual([m.energy for m in batch.minima[tag]], [m.energy for m in one.minima])
        empty = asterism.locate(beacons, np.empty((0, 6)), 0.1)
        self.assertEqual((empty.x.shape, empty.minima), ((0, 3), []))

    def test_unit_origin_and_order_do_not_matter(self):
        # 60 tags with beacons of their own: about half are proven in closed form, others are searched; also beacons in one plane.
        rng = np.random.default_rng(3)
        beacons = rng.uniform(0, 10, (60, 4, 3))
        beacons[:20, :, 2] = 2.5
        ranges = np.abs(np.linalg.norm(rng.uniform(0, 10, (60, 1, 3)) - beacons, axis=2) + 0.1 * rng.normal(size=(60, 4)))
        ranges[::7, 1] = 0
        order = [2, 0, 3, 1]
        expected = asterism.locate(beacons, ranges, 0.1)
        self.assertTrue(expected.proven.all())
        # Between 2 mirror images, rounding decides which is the first.
        tags = np.array([len(minima) == 1 for minima in expected.minima])
        self.assertGreater(tags.sum(), 25)
        for unit, origin, which in ((1e-9, [0, 0, 0], order), (1e9, [0, 0, 0], order), (1, [5e5, 5.4e6, 100], order), (1, [1e7, -1e7, 1e7], slice(None))):
            with self.subTest(unit=unit, origin=origin):
                moved = asterism.locate((beacons * unit + origin)[:, which], ranges[:, which] * unit, 0.1 * unit)
                self.assertTrue(moved.proven.all())
                self.assertEqual([len(m) for m in moved.minima], [len(m) for m in expected.minima])
                np.testing.assert_allclose(moved.energy, expected.energy, rtol=0, atol=1e-5)
                np.testing.assert_allclose((moved.x - origin)[tags] / unit, expected.x[tags], rtol=0, atol=1e-5)
                np.testing.assert_allclose(moved.covariance[tags] / unit**2, expected.covariance[tags], rtol=1e-4, atol=1e-7)
                for tag in range(0, 60, 5):
                    one = asterism.locate((beacons[tag] * unit + origin)[which], ranges[tag, which] * unit, 0.1 * unit)
                    self.assertEqual(len(one.minima), len(expected.minima[tag]))
                    self.assertAlmostEqual(one.energy, expected.energy[tag], places=5)

    def test_a_range_that_was_not_heard(self):
        for missing in ([3, 4, NAN, 5], np.ma.masked_equal([3.0, 4, -1, 5], -1)):
            fix = asterism.locate(SQUARE, missing, [0.1, 0.1, NAN, 0.1])
            np.testing.assert_array_equal(fix.x, asterism.locate([SQUARE[i] for i in (0, 1, 3)], [3, 4, 5], 0.1).x)
            self.assertFalse(fix.outliers[2])

    def test_bad_input(self):
        ones = [1, 1, 1, 1]
        for arguments, options, error, says in (
            ((SQUARE, [1, -1, 1, 1], 1), {}, ValueError, "ranges: expected finite numbers >= 0, or NaN where nothing was heard, found -1.0 at [1]"),
            ((SQUARE, [1, np.inf, 1, 1], 1), {}, ValueError, "found inf at [1]"),
            ((SQUARE, [1, 1e300, 1, 1], 1), {}, ValueError, "range 1 is too large or infinite"),
            ((SQUARE, [ones, [1, 1, 1, -1]], 1), {}, ValueError, "ranges: expected finite numbers >= 0, or NaN where nothing was heard, found -1.0 at [1, 3]"),
            ((SQUARE, ones, 0), {}, ValueError, "sigma: expected finite numbers > 0, found 0.0"),
            ((SQUARE, [ones, ones], [1, 1, -2, 1]), {}, ValueError, "sigma: expected finite numbers > 0, found -2.0 at [2]"),
            ((SQUARE, ones, NAN), {}, ValueError, "sigma: expected finite numbers > 0, found nan"),
            ((SQUARE, ones, 1e-300), {}, ValueError, "sigma 0 is too large or too small"),
            ((SQUARE, ones, [1, 1]), {}, ValueError, "sigma: expected a number or shape (4,)"),
            ((SQUARE, ones, "much"), {}, TypeError, "sigma: expected numbers"),
            ((SQUARE, [1, 1], 1), {}, ValueError, "beacons: expected shape (2, 2)"),
            ((SQUARE, 1, 1), {}, ValueError, "ranges: expected shape (M,) or (tags, M)"),
            (([SQUARE], ones, 1), {}, ValueError, "beacons: expected shape (M, 2) or (M, 3)"),
            (([[1], [2], [3], [4]], ones, 1), {}, ValueError, "beacons: expected shape"),
            (([[0, NAN]] + SQUARE[1:], ones, 1), {}, ValueError, "beacon 0 has a coordinate"),
            ((np.ma.masked_equal(SQUARE, 8), ones, 1), {}, TypeError, "beacons: expected numbers, found masked ones"),
            ((SQUARE, [1, NAN, NAN, NAN], 1), {}, ValueError, "at least 2 beacons, found 1"),
            (([[5, 5]] * 4, ones, 1), {}, ValueError, "all in one place"),
            (([[0, 0, 0], [1, 1, 1], [2, 2, 2], [5, 5, 5]], ones, 1), {}, ValueError, "on one line"),
            ((SQUARE, ones, 0.1), {"cutoff": 0.01}, ValueError, "no position agrees with 2 ranges"),
            ((SQUARE, ones, 1), {"cutoff": 0}, ValueError, "cutoff: expected a number > 0, found 0.0"),
            ((SQUARE, ones, 1), {"within": -1}, ValueError, "within: expected a finite number >= 0, found -1.0"),
            ((SQUARE, ones, 1), {"max_cells": 0}, ValueError, "max_cells: expected >= 1, found 0"),
            ((SQUARE, ones, 1), {"threads": -1}, ValueError, "threads: expected 0 or more"),
        ):
            with self.subTest(says):
                with self.assertRaises(error) as raised:
                    asterism.locate(*arguments, **options)
                self.assertIn(says, str(raised.exception))
                self.assertNotIn("\n", str(raised.exception))

    def test_a_position_that_does_not_fit_is_doubted(self):
        self.assertEqual(asterism.locate(SQUARE, [6.4, 6.4, 6.4, 9], 1).message, "")
        says = "the residuals are .* sigma \\(root mean square\\): are beacons, ranges and sigma in one unit"
        self.assertRegex(asterism.locate(SQUARE, np.full(4, 640), 0.1).message, says)  # in cm
        on_a_line = asterism.locate([[0, 0], [10, 0], [20, 0]], [50, 40, 50], 0.1).message
        self.assertRegex(on_a_line, "^the beacons lie on one line: .*; " + says)
        both = asterism.locate(SQUARE, [[6.4] * 4, [640] * 4], 0.1).message
        self.assertEqual(both[0], "")
        self.assertRegex(both[1], says)
        self.assertNotIn("residuals", asterism.locate(SQUARE, [6.4, 6.4, 6.4, 90], 0.1, cutoff=3).message)

    def test_the_repr_is_one_short_line(self):
        one = repr(asterism.locate([[0, 0], [4, 0], [0, 3]], [2.5, 2.5, 2.5], 0.1))
        self.assertRegex(one, r"^<asterism\.PositionFix: x \[2\. , 1\.5\], covariance \(2, 2\), energy \S+, proven True, within 5, outliers \[False, False, False\]>$")
        many = asterism.locate(SQUARE, np.full((50, 4), 6.4), 0.1)
        for value in (many, many.minima[0][0]):
            self.assertEqual(len(repr(value).splitlines()), 1)
            self.assertLess(len(repr(value)), 200)


if __name__ == "__main__":
    unittest.main()
