#!/usr/bin/env python3
"""asterism.locate_path and PathStream, against an energy of its own: finite differences, SciPy's descents, dense matrices."""

import unittest

import asterism
import numpy as np
from scipy.optimize import minimize

NAN = float("nan")
BEACONS = np.array([[0, 0], [30, 2], [28, 25], [-3, 22.0]])


def drive(seed, count, noise=0.2, turn_noise=0.01, outliers=0.0, ranges_a_pose=1):
    """A robot's true positions, odometry, and ranges (pose, beacon, length), one after the other."""
    rng = np.random.default_rng(seed)
    turns = 0.15 * np.sin(np.arange(count) / 9) + 0.05 * rng.normal(size=count) + 0.03
    headings = 0.7 + np.concatenate([[0], np.cumsum(turns)])
    lengths = rng.uniform(0.5, 1, count)
    moves = lengths * np.exp(1j * headings[:-1])
    path = 12 + 10j + np.concatenate([[0], np.cumsum(moves)])
    truth = np.stack([path.real, path.imag], axis=1)
    steps = np.stack([lengths * (1 + 0.01 * rng.normal(size=count)), 0.01 * rng.normal(size=count), turns + turn_noise * rng.normal(size=count)], axis=1)
    pose = np.repeat(np.arange(count + 1), ranges_a_pose)
    beacon = rng.integers(0, len(BEACONS), len(pose))
    lengths = np.linalg.norm(truth[pose] - BEACONS[beacon], axis=1) + noise * rng.normal(size=len(pose))
    lengths[rng.random(len(pose)) < outliers] += 6
    return truth, steps, pose, beacon, np.maximum(lengths, 0)


class Energy:
    """That of docs/locate.md, of all poses as nodes and of the unknown beacons, as real numbers."""

    def __init__(self, steps, beacons, pose, beacon, ranges, sigma, turn_sigma, step_sigma=0.1, cutoff=None, has_scale=False):
        headings = np.concatenate([[0], np.cumsum(steps[:-1, 2])])
        self.moves = np.exp(1j * headings) * (steps[:, 0] + 1j * steps[:, 1])
        self.beacons, self.pose, self.beacon, self.ranges, self.sigma = beacons, pose, beacon, ranges, sigma
        self.turn_sigma, self.step_sigma, self.cutoff = turn_sigma, step_sigma, cutoff
        self.unknown = np.isnan(beacons[:, 0])
        self.has_scale = has_scale  # the last number, about 1 to 0.1

    def __call__(self, z):
        n = len(self.moves) + 1
        z, scale = (z[:-1], z[-1]) if self.has_scale else (z, 1)
        z = z.reshape(-1, 2)
        p = z[:n, 0] + 1j * z[:n, 1]
        beacons = self.beacons.copy()
        beacons[self.unknown] = z[n:]
        d, lengths = np.diff(p), np.abs(self.moves)
        chain = np.abs(d[1:] - self.moves[1:] / self.moves[:-1] * d[:-1]) / (self.turn_sigma * lengths[1:])
        step = (np.abs(d) - scale * lengths) / (self.step_sigma * lengths)
        s = ((np.linalg.norm(z[self.pose] - beacons[self.beacon], axis=1) - self.ranges) / self.sigma) ** 2
        if self.cutoff is not None:
            s = s / (1 + s / self.cutoff**2)
        return (np.sum(chain**2) + np.sum(step**2) + np.sum(s) + ((scale - 1) / 0.1) ** 2) / 2

    def gradient(self, z, h=1e-5):
        return np.array([(self(z + e) - self(z - e)) / (2 * h) for e in h * np.eye(z.size)])

    def hessian(self, z, h=1e-4):
        e = h * np.eye(z.size)
        plus = [[self(z + a + b) - self(z + a - b) - self(z - a + b) + self(z - a - b) for b in e] for a in e]
        return np.array(plus) / (4 * h * h)


class LocatePathTest(unittest.TestCase):
    def test_a_mirror_image_that_only_the_end_tells_apart(self):
        # Beacons on a line fit a straight way on both of its sides; a turn at its end does not.
        turn = np.where(np.arange(260) == 200, np.pi / 2, 0)
        heading = np.concatenate([[0], np.cumsum(turn)[:-1]])
        truth = np.concatenate([[[0, 8]], [0, 8] + np.cumsum(0.5 * np.stack([np.cos(heading), np.sin(heading)], 1), 0)])
        beacons = np.array([[20, 0], [60, 0], [90, 0.0]])
        for seed in range(8):
            rng = np.random.default_rng(seed)
            steps = np.stack([0.5 + 0.005 * rng.normal(size=260), np.zeros(260), turn + 0.002 * rng.normal(size=260)], 1)
            beacon = rng.integers(0, 3, 261)
            ranges = np.linalg.norm(truth - beacons[beacon], axis=1) + 0.1 * rng.normal(size=261)
            found = asterism.locate_path(steps, beacons, np.arange(261), beacon, ranges, 0.1, lower_bound=False)
            self.assertLess(np.sqrt(np.mean(np.sum((found.x - truth) ** 2, axis=1))), 0.2, seed)

    def test_unknown_beacons_are_on_the_right_side(self):
        # Rows of a mower, which are long and near each other: while the first ones are driven, a beacon may be on both sides.
        for seed in range(6):
            rng = np.random.default_rng(seed)
            turn = np.zeros(640)
            for row in range(80, 640, 80):
                turn[row : row + 2] = np.pi / 2 * (1 if row // 80 % 2 else -1)
            heading = np.concatenate([[0], np.cumsum(turn)[:-1]])
            truth = np.concatenate([[[0, 0]], np.cumsum(0.25 * np.stack([np.cos(heading), np.sin(heading)], 1), 0)])
            beacons = np.array([[4, 9], [15, -7], [-6, 5], [24, 3.0]])
            steps = np.stack([0.25 * (1 + 0.02 * rng.normal(size=640)), np.zeros(640), turn + 0.01 * rng.normal(size=640)], 1)
            beacon = rng.integers(0, 4, 641)
            ranges = np.linalg.norm(truth - beacons[beacon], axis=1) + 0.3 * rng.normal(size=641)
            known, found = (
                asterism.locate_path(steps, places, np.arange(641), beacon, np.abs(ranges), 0.3, lower_bound=False)
                for places in (beacons, np.full((4, 2), NAN))
            )
            self.assertLess(found.energy, 1.2 * known.energy, seed)  # their least energy is not greater

    def test_minimum_covariance_and_evidence(self):
        for seed, cutoff in ((1, None), (2, 2.0)):
            _, steps, pose, beacon, ranges = drive(seed, 16, outliers=0.15 if cutoff else 0, ranges_a_pose=3)
            options = {"cutoff": cutoff, "shortest": 0.1}

            def path_of(turn_sigma):
                return asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2, turn_sigma=turn_sigma, **options)

            found = path_of(0.02)
            self.assertTrue(found.converged)
            energy = Energy(steps, BEACONS, pose, beacon, ranges, 0.2, 0.02, cutoff=cutoff)
            z = found.x.reshape(-1)
            self.assertAlmostEqual(energy(z), found.energy, places=8)
            hessian = energy.hessian(z)
            self.assertLess(np.abs(np.linalg.solve(hessian, energy.gradient(z))).max(), 1e-5)
            dense = np.linalg.inv(hessian)
            blocks = np.array([dense[i : i + 2, i : i + 2] for i in range(0, len(z), 2)])
            np.testing.assert_allclose(found.covariance, blocks, atol=1e-3 * np.abs(blocks).max())
            # The evidence, up to a constant.
            other = path_of(0.05)
            determinants = [np.linalg.slogdet(Energy(steps, BEACONS, pose, beacon, ranges, 0.2, f.turn_sigma, cutoff=cutoff).hessian(f.x.reshape(-1)))[1] for f in (found, other)]
            expected = -found.energy + other.energy - (determinants[0] - determinants[1]) / 2 - 2 * 15 * np.log(0.02 / 0.05)
            self.assertAlmostEqual(found.evidence - other.evidence, expected, places=2)
            np.testing.assert_array_equal(found.outliers, np.abs(found.residuals) >= (cutoff or np.inf))

    def test_the_weight_of_the_chain_has_the_largest_evidence(self):
        for seed, turn_noise in ((3, 0.01), (4, 0.04)):
            truth, steps, pose, beacon, ranges = drive(seed, 1500, turn_noise=turn_noise, outliers=0.1)

            def path_of(turn_sigma):
                return asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2, cutoff=2, turn_sigma=turn_sigma, lower_bound=False)

            found = path_of(None)
            self.assertGreater(found.turn_sigma, turn_noise / 2)
            self.assertLess(found.turn_sigma, turn_noise * 4)
            for factor in (0.5, 0.8, 1.25, 2):
                self.assertLess(path_of(found.turn_sigma * factor).evidence, found.evidence)
            error = found.x - truth
            self.assertLess(np.sqrt(np.mean(np.sum(error**2, axis=1))), 0.3)
            inside = np.einsum("ki,ki->k", error, np.linalg.solve(found.covariance, error[..., None])[..., 0]) < 5.99
            self.assertGreater(inside.mean(), 0.8)
            self.assertGreater(found.outliers.sum(), 0.8 * 0.1 * len(ranges))

    def test_few_ranges_do_not_make_the_odometry_exact(self):
        inside = []
        for seed in range(8):
            truth, steps, pose, beacon, ranges = drive(seed, 300, noise=1.0)
            few = np.arange(seed, len(pose), 12)
            found = asterism.locate_path(steps, BEACONS, pose[few], beacon[few], ranges[few], 1.0, lower_bound=False)
            error = found.x - truth
            inside.append((np.einsum("ki,ki->k", error, np.linalg.solve(found.covariance, error[..., None])[..., 0]) < 5.99).mean())
            self.assertGreater(found.turn_sigma, 1e-3)
        self.assertGreater(np.mean(inside), 0.7)
        # Four ranges say nothing of it: it is neither 0 nor large.
        at = np.array([0, 60, 150, 290])
        found = asterism.locate_path(steps, BEACONS, at, range(4), np.linalg.norm(truth[at] - BEACONS, axis=1), 0.2, lower_bound=False)
        self.assertGreater(found.turn_sigma, 1e-3)
        self.assertLess(found.turn_sigma, 0.1)

    def test_unit_and_origin_do_not_matter(self):
        truth, steps, pose, beacon, ranges = drive(21, 60, outliers=0.05)
        beacons = BEACONS.copy()
        beacons[3] = NAN
        expected = asterism.locate_path(steps, beacons, pose, beacon, ranges, 0.2, cutoff=3)
        start = np.array([12, 10, 0.7])

        def streamed(unit, origin):
            stream = asterism.PathStream(shortest=0.3 * unit, start=list(start * [unit, unit, 1] + [*origin, 0]), start_sigma=[0.5 * unit, 0.1], window=20)
            for n in range(61):
                for k in np.flatnonzero((pose == n) & (beacon < 3)):
                    stream.range(list(beacons[beacon[k]] * unit + origin), ranges[k] * unit, 0.2 * unit)
                if n < 60:
                    stream.move(*(steps[n] * [unit, unit, 1]))
            stream.settle()
            return stream.positions

        online = streamed(1, [0, 0])
        for unit, origin in ((1e-9, [0, 0]), (1e9, [0, 0]), (1, [5e5, 5.4e6]), (1, [1e7, -1e7])):
            with self.subTest(unit=unit, origin=origin):
                found = asterism.locate_path(steps * [unit, unit, 1], beacons * unit + origin, pose, beacon, ranges * unit, 0.2 * unit, cutoff=3)
                np.testing.assert_allclose((found.x - origin) / unit, expected.x, rtol=0, atol=1e-6)
                np.testing.assert_allclose((found.beacons - origin) / unit, expected.beacons, rtol=0, atol=1e-6)
                np.testing.assert_allclose(found.covariance / unit**2, expected.covariance, rtol=1e-5)
                self.assertAlmostEqual(found.energy, expected.energy, places=5)
                self.assertAlmostEqual(found.turn_sigma, expected.turn_sigma, places=8)
                np.testing.assert_allclose((streamed(unit, origin) - origin) / unit, online, rtol=0, atol=1e-6)

    def test_unknown_beacons(self):
        truth, steps, pose, beacon, ranges = drive(5, 400, outliers=0.05)
        for known in ([], [1], [0, 2]):
            beacons = np.full_like(BEACONS, NAN)
            beacons[known] = BEACONS[known]
            found = asterism.locate_path(steps, beacons, pose, beacon, ranges, 0.2, cutoff=3, start=(*truth[0], 0.7))
            self.assertTrue(found.converged)
            self.assertEqual(found.message == "", len(known) == 2)
            if not known:
                np.testing.assert_allclose(found.x[0], truth[0], atol=1e-3)
                self.assertAlmostEqual(found.heading[0], 0.7, places=3)
            both, there = np.concatenate([found.x, found.beacons]), np.concatenate([truth, BEACONS])
            if len(known) < 2:
                left, _, right = np.linalg.svd((both - both.mean(0)).T @ (there - there.mean(0)))
                both = (both - both.mean(0)) @ left @ right + there.mean(0)
            self.assertLess(np.sqrt(np.mean(np.sum((both - there) ** 2, axis=1))), 0.4)
            np.testing.assert_array_equal(found.beacons[known], BEACONS[known])
            self.assertEqual([i for i in range(4) if not found.beacon_covariance[i].any()], known)
            self.assertGreaterEqual(found.energy, found.lower_bound)

    def test_covariance_of_unknown_beacons(self):
        _, steps, pose, beacon, ranges = drive(6, 12, ranges_a_pose=4)
        beacons = BEACONS.copy()
        beacons[2] = NAN
        found = asterism.locate_path(steps, beacons, pose, beacon, ranges, 0.2, turn_sigma=0.05, shortest=0.1)
        energy = Energy(steps, beacons, pose, beacon, ranges, 0.2, 0.05)
        z = np.concatenate([found.x, found.beacons[2:3]]).reshape(-1)
        hessian = energy.hessian(z)
        self.assertLess(np.abs(np.linalg.solve(hessian, energy.gradient(z))).max(), 1e-5)
        dense = np.linalg.inv(hessian)
        np.testing.assert_allclose(found.beacon_covariance[2], dense[-2:, -2:], atol=1e-3 * np.abs(dense).max())
        np.testing.assert_allclose(found.covariance[5], dense[10:12, 10:12], atol=1e-3 * np.abs(dense).max())

    def test_scale_of_the_odometry(self):
        # A minimum of positions, an unknown beacon and the scale together, with the covariance of all.
        _, steps, pose, beacon, ranges = drive(6, 12, ranges_a_pose=4)
        beacons = BEACONS.copy()
        beacons[2] = NAN
        steps[:, :2] /= 1.2
        found = asterism.locate_path(steps, beacons, pose, beacon, ranges, 0.2, turn_sigma=0.05, shortest=0.1)
        energy = Energy(steps, beacons, pose, beacon, ranges, 0.2, 0.05, has_scale=True)
        z = np.concatenate([found.x.ravel(), found.beacons[2], [found.scale]])
        self.assertAlmostEqual(energy(z), found.energy, places=8)
        hessian = energy.hessian(z)
        self.assertLess(np.abs(np.linalg.solve(hessian, energy.gradient(z))).max(), 1e-5)
        dense = np.linalg.inv(hessian)
        self.assertAlmostEqual(found.scale_deviation, dense[-1, -1] ** 0.5, places=4)
        np.testing.assert_allclose(found.covariance[5], dense[10:12, 10:12], atol=1e-3 * np.abs(dense).max())
        np.testing.assert_allclose(found.beacon_covariance[2], dense[-3:-1, -3:-1], atol=1e-3 * np.abs(dense).max())
        # No path with this scale is lower.
        rng = np.random.default_rng(0)
        least = min(minimize(lambda y: energy(np.append(y, found.scale)), z[:-1] + rng.normal(0, 3, len(z) - 1), method="BFGS").fun for _ in range(3))
        self.assertLessEqual(found.lower_bound, least + 1e-6)
        self.assertGreater(found.lower_bound, 0)

    def test_wheels_that_are_not_calibrated(self):
        for seed, scale in ((30, 0.9), (31, 1.1), (32, 0.8)):
            truth, steps, pose, beacon, ranges = drive(seed, 400, outliers=0.1)
            steps[:, :2] /= scale

            def error(**options):
                path = asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2, cutoff=3, lower_bound=False, **options)
                return path, np.sqrt(np.mean(np.sum((path.x - truth) ** 2, axis=1)))

            found, known = error()
            self.assertLess(abs(found.scale - scale), 4 * found.scale_deviation)
            self.assertLess(found.scale_deviation, 0.02)
            self.assertLess(known, 0.8 * error(scale_sigma=0)[1])
        # Where it may as well be 1, it is 1.
        _, steps, pose, beacon, ranges = drive(33, 400)
        found, held = (asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2, scale_sigma=s) for s in (0.1, 0))
        self.assertEqual((found.scale, found.scale_deviation), (1, 0))
        np.testing.assert_allclose(found.x, held.x, atol=1e-3)
        self.assertAlmostEqual(found.energy, held.energy, delta=0.1)

    def test_no_descent_gets_below_the_bound(self):
        for seed in range(4):
            _, steps, pose, beacon, ranges = drive(seed, 10, noise=1.0)
            found = asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 1.0, turn_sigma=0.1, shortest=0.1)
            energy = Energy(steps, BEACONS, pose, beacon, ranges, 1.0, 0.1)
            rng = np.random.default_rng(seed)
            least = min(minimize(energy, (found.x + rng.normal(0, 8, found.x.shape)).reshape(-1), method="BFGS").fun for _ in range(4))
            self.assertLessEqual(found.lower_bound, min(least, found.energy) + 1e-6)
            self.assertGreater(found.lower_bound, 0.3 * found.energy)

    def test_ranges_between_poses_and_times(self):
        truth, steps, pose, beacon, ranges = drive(7, 200, noise=0)
        at = np.linspace(0, 200, 401)[1:-1:2]  # halves
        there = (truth[:-1] + truth[1:]) / 2
        to = np.arange(200) % 4
        lengths = np.linalg.norm(there - BEACONS[to], axis=1)
        found = asterism.locate_path(steps, BEACONS, at, to, lengths, 0.05)
        self.assertLess(np.abs(found.x - truth).max(), 0.3)
        times = 100 + np.arange(201) * 0.25
        timed = asterism.locate_path(steps, BEACONS, 100 + at * 0.25, to, lengths, 0.05, times=times)
        np.testing.assert_allclose(timed.x, found.x, atol=1e-9)

    def test_a_robot_that_stands_still_and_ranges_not_heard(self):
        truth, steps, pose, beacon, ranges = drive(8, 60)
        still = np.concatenate([steps[:30], np.zeros((20, 3)), steps[30:]])
        later = np.where(pose > 30, pose + 20, pose)
        ranges[3] = NAN
        found = asterism.locate_path(still, BEACONS, later, beacon, ranges, 0.2)
        plain = asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2)
        np.testing.assert_allclose(np.delete(found.x, np.arange(31, 51), axis=0), plain.x, atol=1e-7)
        np.testing.assert_allclose(found.x[30:51], np.broadcast_to(found.x[30], (21, 2)), atol=1e-9)
        self.assertTrue(np.isnan(found.residuals[3]) and not found.outliers[3])

    def test_a_path_that_does_not_fit_is_doubted(self):
        truth, steps, pose, beacon, ranges = drive(8, 60)
        self.assertEqual(asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2).message, "")
        in_cm = asterism.locate_path(steps, BEACONS, pose, beacon, np.asarray(ranges) * 100, 0.2)
        self.assertRegex(in_cm.message, "the residuals are .* sigma .*: are steps, beacons, ranges and sigma in one unit")
        steps[7][2] = 10.0
        in_degrees = asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2)
        self.assertIn("step 7 turns by 10: are turns in radians?", in_degrees.message)

    def test_bad_input(self):
        good = {"steps": [[1, 0, 0.1]] * 5, "beacons": BEACONS[:3], "pose": [0, 1, 2, 3.5], "beacon": [0, 1, 2, 0], "ranges": [15, 16, 20, 18], "sigma": 0.1}
        self.assertTrue(np.isfinite(asterism.locate_path(**good).x).all())
        for change, says in (
            ({"steps": [[1, 0, NAN]] * 5}, "step 0 has a number"),
            ({"steps": [[0, 0, 1.0]] * 5}, "the robot does not move"),
            ({"steps": np.empty((0, 3)), "pose": [0, 0, 0, 0]}, "at least one step"),
            ({"steps": [1, 2, 3]}, "steps: expected shape"),
            ({"ranges": [15, -1, 20, 18]}, "ranges: expected finite numbers >= 0, or NaN where nothing was heard, found -1.0 at [1]"),
            ({"ranges": [15, np.inf, 20, 18]}, "found inf at [1]"),
            ({"sigma": [1, 1, 0, 1]}, "sigma: expected finite numbers > 0, found 0.0 at [2]"),
            ({"sigma": [1, 1]}, "sigma: expected a number or shape"),
            ({"beacon": [0, 1, 2, 7]}, "beacon: expected the number of a beacon, 0 to 2, found 7 at [3]"),
            ({"beacon": [0, 1, 2, 0.5]}, "beacon: expected whole numbers"),
            ({"pose": [0, 1, 2, 9]}, "pose: expected the number of a pose, 0 to 5, found 9.0 at [3]"),
            ({"pose": [0, 1, NAN, 3]}, "pose: expected the number of a pose, 0 to 5, found nan at [2]"),
            ({"beacons": [[0, 0], [1, np.inf], [2, 2]]}, "beacon 1 has a coordinate"),
            ({"beacons": [[0, 0], [1, NAN], [2, 2]]}, "beacons: row 1 is [1.0, nan]; expected finite numbers, or NaN in both"),
            ({"beacons": [[0, 0], [NAN, NAN], [2, 2]]}, "beacon 1 has no place and fewer than two ranges"),
            ({"times": [0, 1, 2, 2, 3, 4]}, "times: expected rising numbers, found 2.0 before 2.0 at pose 3"),
            ({"times": [0, 1, 2, 3, 3.1, 3.2]}, "pose: expected the time of each range, 0.0 to 3.2 as the times are, found 3.5 at [3]"),
            ({"cutoff": 0}, "cutoff: expected a number > 0, found 0.0"),
            ({"turn_sigma": -1}, "turn_sigma"),
            ({"step_sigma": 0}, "step_sigma: expected a finite number > 0, found 0.0"),
            ({"scale_sigma": -1}, "scale_sigma: expected a finite number >= 0, found -1.0"),
            ({"scale_sigma": NAN}, "scale_sigma"),
            ({"shortest": NAN}, "shortest"),
            ({"start": [0, 0, NAN]}, "start"),
            ({"start_sigma": [1, 1]}, "start_sigma needs a start"),
            ({"max_iterations": 0}, "max_iterations: expected >= 1, found 0"),
        ):
            with self.subTest(says):
                with self.assertRaises(ValueError) as raised:
                    asterism.locate_path(**{**good, **change})
                self.assertIn(says, str(raised.exception))
        # Sensible answers, and no NaN.
        for change in (
            {"beacons": [[3, 3]] * 3},
            {"ranges": [0, 0, 0, 0]},
            {"ranges": [NAN] * 4},
            {"pose": [], "beacon": [], "ranges": [], "sigma": []},
            {"ranges": [1e5, 1e-5, 1e5, 0], "cutoff": 1},
        ):
            with self.subTest(str(change)):
                try:
                    found = asterism.locate_path(**{**good, **change})
                except ValueError as error:
                    self.assertIn("do not determine the path", str(error))
                    continue
                for values in (found.x, found.heading, found.covariance, found.energy, found.lower_bound):
                    self.assertTrue(np.isfinite(values).all())


class PathStreamTest(unittest.TestCase):
    OPTIONS = {"shortest": 0.1, "turn_sigma": 0.02, "cutoff": 2.0, "start": (12.0, 10.0, 0.7), "start_sigma": (0.5, 0.2)}

    def test_equals_the_batch_before_and_after_old_positions_are_marginalised(self):
        truth, steps, pose, beacon, ranges = drive(9, 900, outliers=0.1)
        stream = asterism.PathStream(window=100, **self.OPTIONS)
        for k in range(901):
            if k > 0:
                stream.move(*steps[k - 1])
            stream.range(BEACONS[beacon[k]], ranges[k], 0.2)
            self.assertLess(np.linalg.norm(stream.pose[:2] - truth[k]), 2.5)
            if k == 80:  # nothing is marginalised yet
                stream.settle()
                whole = asterism.locate_path(steps[:80], BEACONS, pose[:81], beacon[:81], ranges[:81], 0.2, scale_sigma=0, **self.OPTIONS)
                np.testing.assert_allclose(stream.positions, whole.x, atol=1e-9)
                np.testing.assert_allclose(stream.pose[:2], whole.x[-1], atol=1e-9)
                np.testing.assert_allclose(stream.covariance, whole.covariance[-1], rtol=1e-6)
                self.assertAlmostEqual(stream.energy, whole.energy, places=8)
                self.assertAlmostEqual(stream.pose[2], whole.heading[-1], places=8)
            if k > 0 and k % 100 == 0:  # the first range comes before the first step
                np.testing.assert_allclose(stream.positions, stream.batch(), atol=1e-9)
            self.assertLessEqual(len(stream.positions), 112)

    def test_marginalised_positions_are_remembered(self):
        truth, steps, pose, beacon, ranges = drive(10, 600)
        stream = asterism.PathStream(window=100, **{**self.OPTIONS, "cutoff": None})
        for k in range(601):
            if k > 0:
                stream.move(*steps[k - 1])
            stream.range(BEACONS[beacon[k]], ranges[k], 0.2)
        stream.settle()
        whole = asterism.locate_path(steps, BEACONS, pose, beacon, ranges, 0.2, scale_sigma=0, **{**self.OPTIONS, "cutoff": None})
        np.testing.assert_allclose(stream.positions, whole.x[-len(stream.positions) :], atol=5e-3)

    def test_bad_input(self):
        for change, says in (({"shortest": 0}, "shortest"), ({"shortest": 1, "window": 3}, "window"), ({"shortest": 1, "start": (0, NAN, 0)}, "start"), ({"shortest": 1, "start_sigma": (0, 1)}, "start_sigma")):
            with self.assertRaisesRegex(ValueError, says):
                asterism.PathStream(**change)
        stream = asterism.PathStream(shortest=1)
        self.assertTrue(np.isinf(stream.covariance[0, 0]))
        for call, says in (
            (lambda: stream.move(NAN, 0, 0), "a step"), (lambda: stream.range((0, NAN), 1, 1), "a beacon"), (lambda: stream.range((0, 0), -1, 1), "a range"),
            (lambda: stream.range((0, 0), np.inf, 1), "a range"), (lambda: stream.range((0, 0), 1, 0), "sigma"),
        ):
            with self.assertRaisesRegex(ValueError, says):
                call()
        stream.range((0, 0), NAN, 1)
        stream.move(0.5, 0, 0.1)
        np.testing.assert_allclose(stream.pose, [0.5, 0, 0.1])
        stream.settle()
        self.assertEqual(len(stream.positions), 0)
        for k in range(20):
            stream.move(1, 0, 0)
            stream.range((3, 3), 5, 1)
        # Any number of ranges from one place.
        refused = 0
        stream = asterism.PathStream(shortest=1, window=16, settle_every=10)
        for k in range(3):
            stream.move(1, 0, 0)
        for k in range(300):
            try:
                stream.range((3, 3), 3, 1)
            except ValueError as error:
                self.assertIn("too many ranges from one place", str(error))
                refused += 1
        self.assertGreater(refused, 0)
        self.assertTrue(np.isfinite(stream.positions).all())


if __name__ == "__main__":
    unittest.main()
