#!/usr/bin/env python3
"""asterism.pose: the kernel against dense matrices, cameras against OpenCV's formulas, fuse and Stream against known paths and each other, files, bad input.

pose_test.py PAGE FOLDER: the page whose code is run, and the folder with mouse, fly and paw, whose tests are skipped without it.
"""

import contextlib
import csv
import io
import os
import pathlib
import pickle
import re
import resource
import sys
import tempfile
import unittest
import unittest.mock

import asterism
import numpy as np
from asterism import _asterism, pose, pose_estimate, pose_fuse, pose_tool

try:
    import h5py
except ImportError:
    h5py = None

FOLDER = pathlib.Path(sys.argv.pop())
PAGE = pathlib.Path(sys.argv.pop()).resolve()


def ring(views, size=(1280, 1024)):
    """Cameras around the origin, which look at it."""
    matrix = [[800, 0, 640], [0, 820, 512], [0, 0, 1]]
    return [
        pose.Camera(matrix, [0.1 * view, 2 * np.pi * view / views, 0.05], [0.1, 0, 10], [-0.1, 0.02, 1e-3, -1e-3], size, f"view {view}") for view in range(views)
    ]


def recording(seed, views=3, frames=300, joints=4, noise=1.0, outliers=0.2, missing=0.3):
    """Smooth paths in space, and what the cameras detect: true points, detections, which ones are outliers, cameras."""
    rng = np.random.default_rng(seed)
    phase, rate = rng.uniform(0, 6, (2, joints, 3)) * [[[1]], [[0.01]]]
    truth = rng.normal(0, 1, (joints, 3)) + 0.5 * np.sin(phase + rate * np.arange(frames)[:, None, None])
    cameras = ring(views)
    seen = np.array([camera.project(truth) for camera in cameras]) + rng.normal(0, noise, (views, frames, joints, 2))
    is_wrong = rng.random(seen.shape[:3]) < outliers
    seen[is_wrong] = rng.uniform((0, 0), (1280, 1024), (is_wrong.sum(), 2))
    seen[rng.random(seen.shape[:3]) < missing] = np.nan
    return truth, seen, is_wrong & np.isfinite(seen[..., 0]), cameras


def distances(error, covariance):
    """Squared, in standard deviations."""
    return np.einsum("tji,tji->tj", error, np.linalg.solve(covariance, error[..., None])[..., 0])


class KernelTest(unittest.TestCase):
    def test_chains_are_the_dense_solution(self):
        for dim in (2, 3):
            for points in (1, 2, 3, 4, 9):
                rng = np.random.default_rng(dim * 100 + points)
                joints, row, column = 2, *np.triu_indices(dim)
                half = rng.normal(size=(points, joints, dim, dim))
                blocks = half @ half.swapaxes(-1, -2) * (rng.random((points, joints, 1, 1)) < 0.6) + 1e-3 * np.eye(dim)
                right = rng.normal(size=(points, joints, dim))
                coefficients = rng.normal(size=(max(points - 2, 0), 3))
                weight = rng.uniform(0.1, 5, (max(points - 2, 0), joints))
                found, covariance, spread, log_det = _asterism._difference_chains(blocks[..., row, column], right, coefficients, weight)
                for j in range(joints):
                    matrix = np.zeros((points, dim, points, dim))
                    for t in range(points):
                        matrix[t, :, t] += blocks[t, j]
                    for t, c in enumerate(coefficients):
                        for a in range(3):
                            for b in range(3):
                                matrix[t + a, :, t + b] += weight[t, j] * c[a] * c[b] * np.eye(dim)
                    inverse = np.linalg.inv(matrix.reshape(points * dim, -1)).reshape(matrix.shape)
                    np.testing.assert_allclose(found[:, j], np.einsum("aibj,bj->ai", inverse, right[:, j]), rtol=1e-7, atol=1e-9)
                    self.assertAlmostEqual(log_det[j], np.linalg.slogdet(matrix.reshape(points * dim, -1))[1], places=7)
                    for t in range(points):
                        np.testing.assert_allclose(covariance[t, j], inverse[t, :, t][row, column], rtol=1e-6, atol=1e-9)
                    for t, c in enumerate(coefficients):
                        part = inverse[t : t + 3, :, t : t + 3]
                        self.assertAlmostEqual(spread[t, j], np.einsum("a,aibi,b->", c, part, c), places=6)


    def test_chains_with_a_past_are_the_dense_solution(self):
        for dim in (2, 3):
            rng = np.random.default_rng(dim)
            points, joints, (row, column) = 5, 2, np.triu_indices(dim)
            half = rng.normal(size=(points, joints, dim, dim))
            blocks = half @ half.swapaxes(-1, -2) + 1e-2 * np.eye(dim)
            half = rng.normal(size=(joints, 2 * dim, 2 * dim))
            past = half @ half.swapaxes(-1, -2)
            right, coefficients = rng.normal(size=(points, joints, dim)), rng.normal(size=(points - 2, 3))
            weight = rng.uniform(0.1, 5, (points - 2, joints))
            found, covariance, _, _ = _asterism._difference_chains(blocks[..., row, column], right, coefficients, weight, past)
            for j in range(joints):
                matrix = np.zeros((points * dim, points * dim))
                matrix[: 2 * dim, : 2 * dim] = past[j]
                for t in range(points):
                    matrix[t * dim : (t + 1) * dim, t * dim : (t + 1) * dim] += blocks[t, j]
                for t, c in enumerate(coefficients):
                    matrix[t * dim : (t + 3) * dim, t * dim : (t + 3) * dim] += weight[t, j] * np.kron(np.outer(c, c), np.eye(dim))
                np.testing.assert_allclose(found[:, j].ravel(), np.linalg.solve(matrix, right[:, j].ravel()), rtol=1e-7, atol=1e-9)
                inverse = np.linalg.inv(matrix).reshape(points, dim, points, dim)
                for t in range(points):
                    np.testing.assert_allclose(covariance[t, j], inverse[t, :, t][row, column], rtol=1e-6, atol=1e-9)


class CameraTest(unittest.TestCase):
    def test_projection_is_opencvs(self):
        rng = np.random.default_rng(3)
        points = rng.normal(0, 1, (50, 3))
        try:
            import cv2
        except ImportError:
            self.skipTest("OpenCV's Python module is not installed")
        rotation, translation, distortions = np.array([0.3, -0.4, 0.2]), np.array([0.1, 0.2, 8.0]), np.array([-0.3, 0.1, 2e-3, -1e-3, 0.05])
        matrix = np.array([[700.0, 0, 300], [0, 710, 200], [0, 0, 1]])
        camera = pose.Camera(matrix, rotation, translation, distortions)
        np.testing.assert_allclose(camera.project(points), cv2.projectPoints(points, rotation, translation, matrix, distortions)[0][:, 0], atol=1e-9)

    def test_vectors_may_be_columns_as_opencv_returns_them(self):
        matrix = [[100, 0, 50], [0, 100, 40], [0, 0, 1]]
        flat = pose.Camera(matrix, [0.1, 0.2, 0.3], [1, 2, 3])
        column = pose.Camera(matrix, np.array([[0.1], [0.2], [0.3]]), np.array([[1], [2], [3]]), np.zeros((1, 5)))
        for field in ("rotation", "translation", "distortions"):
            np.testing.assert_array_equal(getattr(column, field), getattr(flat, field))
        with self.assertRaisesRegex(ValueError, "matrix: .*: is it transposed"):
            pose.Camera(np.transpose(matrix), [0, 0, 0], [0, 0, 1])

    def test_undistort_inverts_the_distortion(self):
        camera = ring(3)[1]
        points = np.random.default_rng(1).normal(0, 1, (200, 3))
        image, slope = camera.undistort(camera.project(points))
        seen = points @ camera.rotation.T + camera.translation
        np.testing.assert_allclose(image, seen[:, :2] / seen[:, 2:], atol=1e-10)
        step = 1e-6
        for k in range(2):
            moved = seen.copy()
            moved[:, k] += step * seen[:, 2]
            there = camera.project((moved - camera.translation) @ camera.rotation)
            np.testing.assert_allclose((there - camera.project(points)) / step, slope[:, :, k], rtol=1e-3, atol=1e-1)

    def test_a_distortion_without_inverse_gives_nan(self):
        camera = pose.Camera([[100, 0, 0], [0, 100, 0], [0, 0, 1]], np.eye(3), [0, 0, 1], [-0.5])
        image, _ = camera.undistort([[1.0, 2.0], [900.0, 0.0]])
        self.assertTrue(np.isfinite(image[0]).all())
        self.assertTrue(np.isnan(image[1]).all())


class FuseTest(unittest.TestCase):
    def test_paths_in_space_with_outliers_and_gaps(self):
        for seed in range(3):
            truth, seen, is_wrong, cameras = recording(seed)
            found = pose.fuse(seen, None, cameras, [(0, 1), (2, 3)])
            error = np.linalg.norm(found.points - truth, axis=-1)
            # One detection of one pixel is .0125 at this depth.
            self.assertLess(np.sqrt((error**2).mean()), 0.0125)
            is_seen = np.isfinite(seen[..., 0])
            self.assertGreater(found.outliers[is_wrong].mean(), 0.98)
            self.assertLess(found.outliers[is_seen & ~is_wrong].mean(), 0.02)
            self.assertFalse(found.outliers[~is_seen].any())
            inside = (distances(found.points - truth, found.covariance) < 7.815).mean()
            self.assertGreater(inside, 0.90)
            lengths = np.linalg.norm(truth[:, [0, 2]] - truth[:, [1, 3]], axis=-1)
            np.testing.assert_allclose(found.lengths, lengths.mean(0), rtol=0.02)
            np.testing.assert_allclose(found.reprojections, [camera.project(found.points) for camera in cameras])
            self.assertTrue(((found.noise > 0.5) & (found.noise < 1.5)).all(), found.noise)

    def test_paths_in_the_image(self):
        rng = np.random.default_rng(5)
        t = np.arange(400)[:, None]
        truth = np.stack([100 + 50 * np.sin(t / [30, 40, 50]), 80 + 40 * np.cos(t / [35, 25, 60])], -1)
        seen = truth + rng.normal(0, 2, truth.shape)
        is_wrong = rng.random(seen.shape[:2]) < 0.1
        seen[is_wrong] = rng.uniform(0, 200, (is_wrong.sum(), 2))
        found = pose.fuse(seen)
        error = found.points - truth
        self.assertEqual(found.points.shape, (400, 3, 2))
        self.assertLess(np.sqrt((error**2).sum(-1).mean()), 2.0)
        inside = (distances(error, found.covariance) < 5.991).mean()
        self.assertGreater(inside, 0.90)
        self.assertLess(inside, 0.995)
        # Several detectors' results for one image are more than one of them.
        second = pose.fuse(np.array([seen, truth + rng.normal(0, 2, truth.shape)]))
        self.assertLess(((second.points - truth) ** 2).mean(), (error**2).mean())

    def test_units_do_not_matter(self):
        truth, seen, _, cameras = recording(7, frames=120)
        found = pose.fuse(seen, None, cameras)
        scaled = [pose.Camera(c.matrix, c.rotation, 1000 * c.translation, c.distortions, c.size) for c in cameras]
        there = pose.fuse(seen, None, scaled, times=np.arange(120) / 50)
        np.testing.assert_allclose(there.points / 1000, found.points, rtol=0, atol=1e-5)
        np.testing.assert_allclose(there.covariance / 1e6, found.covariance, rtol=1e-2, atol=1e-9)
        frame = seen.swapaxes(0, 1)
        stream = pose.Stream(found, cameras)
        followed = [stream.push(f).points for f in frame]
        for unit in (1e-9, 1e6, 1e9):  # of time: also micro- and nanoseconds
            times = unit * np.arange(120)
            there = pose.fuse(seen, None, cameras, times=times)
            np.testing.assert_array_equal(there.outliers, found.outliers)
            np.testing.assert_allclose(there.points, found.points, rtol=0, atol=1e-6)
            np.testing.assert_allclose(there.motion * unit**1.5, found.motion, rtol=1e-5)
            stream = pose.Stream(there, cameras)
            away = np.abs(np.array([stream.push(f, t).points for f, t in zip(frame, times)]) - followed)
            self.assertLess(np.mean(away > 1e-4), 0.01)  # rounding decides what a few jumps are
            swapped = seen[:, :, [1, 0, 2, 3]][:, :60]
            some = np.concatenate([swapped, seen[:, 60:]], 1)
            np.testing.assert_array_equal(pose.exchange_back(some, [(0, 1)], times).swapped, pose.exchange_back(some, [(0, 1)]).swapped)
        found = pose.fuse(seen[:2])  # as if both saw one image
        for unit in (1e-9, 1e-4, 1e9):
            there = pose.fuse(seen[:2] * unit)
            np.testing.assert_array_equal(there.outliers, found.outliers)
            np.testing.assert_allclose(there.points / unit, found.points, rtol=0, atol=1e-6)
        networks = np.array([seen, seen + 1 + np.random.default_rng(7).normal(0, 1, seen.shape)])
        some = np.concatenate([seen[:, :60, [1, 0, 2, 3]], seen[:, 60:]], 1)
        for unit in (1e-9, 1e9):
            np.testing.assert_allclose(pose.network_deviation(networks * unit) / unit, pose.network_deviation(networks), rtol=1e-6)
            np.testing.assert_array_equal(pose.exchange_back(some * unit, [(0, 1)]).swapped, pose.exchange_back(some, [(0, 1)]).swapped)
        deviation = np.ones(seen.shape[:3])
        found = pose.fuse(seen[0], deviation=deviation[0])
        there = pose.fuse(seen[0] * 1e9, deviation=1e9 * deviation[0])
        np.testing.assert_allclose(there.covariance / 1e18, found.covariance, rtol=1e-5)

    def test_the_origin_does_not_matter(self):
        truth, seen, _, cameras = recording(7, frames=120)
        found = pose.fuse(seen, None, cameras, [(0, 1)])
        for origin in ([1e4, -1e4, 0], [5e5, 5.4e6, 100]):  # also that of maps
            there = [pose.Camera(c.matrix, c.rotation, c.translation - c.rotation @ origin, c.distortions, c.size) for c in cameras]
            moved = pose.fuse(seen, None, there, [(0, 1)])
            np.testing.assert_array_equal(moved.outliers, found.outliers)
            np.testing.assert_allclose(moved.points - origin, found.points, rtol=0, atol=1e-5)
            np.testing.assert_allclose(moved.covariance, found.covariance, rtol=1e-2, atol=1e-9)
            streams = pose.Stream(found, cameras), pose.Stream(moved, there)
            away = []
            for frame in seen.swapaxes(0, 1):
                one, other = (stream.push(frame) for stream in streams)
                away.append(np.abs(other.points - origin - one.points))
            self.assertLess(np.mean(np.array(away) > 1e-5), 0.02)  # rounding decides what a few jumps are

    def test_masks_and_gaps_are_missing(self):
        truth, seen, _, cameras = recording(8, frames=100)
        seen[:, 40:43] = np.nan  # frames without detections
        found = pose.fuse(seen, None, cameras)
        masked = np.ma.masked_invalid(seen)
        masked.data[masked.mask] = 1e5
        np.testing.assert_array_equal(pose.fuse(masked, None, cameras).points, found.points)
        self.assertTrue(np.isfinite(found.points).all())
        trace = np.trace(found.covariance, axis1=2, axis2=3).mean(1)
        self.assertGreater(trace[41], 1.2 * np.median(trace))

    def test_few_frames(self):
        truth, seen, _, cameras = recording(9, frames=5, outliers=0, missing=0)
        for frames in (1, 2, 3, 4, 5):
            found = pose.fuse(seen[:, :frames], None, cameras)
            self.assertLess(np.linalg.norm(found.points - truth[:frames], axis=-1).max(), 0.1)
            self.assertTrue(np.isfinite(found.covariance).all())

    def test_few_frames_with_wrong_detections(self):
        # Each joint has one wrong detection in each frame, beside three right ones or more.
        for views, frames in ((4, 1), (4, 2), (6, 2), (5, 3), (6, 6)):
            for seed in range(6):
                truth, seen, _, cameras = recording(seed, views, frames, 5, outliers=0, missing=0)
                rng = np.random.default_rng((7, seed))
                wrong = rng.integers(views, size=(frames, 5))
                for t in range(frames):
                    for j in range(5):
                        seen[wrong[t, j], t, j] = rng.uniform((0, 0), (1280, 1024))
                found = pose.fuse(seen, None, cameras)
                with self.subTest(views=views, frames=frames, seed=seed):
                    self.assertLess(np.linalg.norm(found.points - truth, axis=-1).max(), 0.1)  # about seven deviations
                    np.testing.assert_array_equal(found.offsets, 0)  # two frames alike are no calibration's error

    def test_wrong_detections_that_stay(self):
        """Of two cameras, one or the other sees a joint at another place for some frames."""
        for seed in range(8):
            truth, seen, _, cameras = recording(seed, 4, 120, 3, outliers=0, missing=0)
            seen, rng = seen[:2], np.random.default_rng((8, seed))
            for joint in range(3):
                for start in range(4, 110, 20):
                    run = int(rng.integers(2)), slice(start, start + int(rng.integers(10, 16))), joint
                    seen[run] = rng.uniform((0, 0), (1280, 1024)) + rng.normal(0, 1, seen[run].shape)
            found = pose.fuse(seen, None, cameras[:2])
            with self.subTest(seed=seed):
                self.assertLess(np.linalg.norm(found.points - truth, axis=-1).max(), 1)

    def test_few_frames_of_joints_that_turn(self):
        """Three or four frames are no reason to assume that joints move in straight lines."""
        for frames in (3, 4):
            error, free = [], []
            for seed in range(8):
                truth, seen, _, cameras = recording(seed, frames=9 * frames, outliers=0, missing=0)
                truth, seen = truth[::9], seen[:, ::9]
                error.append(pose.fuse(seen, None, cameras).points - truth)
                free.append([pose.fuse(seen[:, [t]], None, cameras).points[0] - truth[t] for t in range(frames)])
            self.assertLess(np.std(error), 1.2 * np.std(free))

    def test_few_frames_of_one_view(self):
        """Nothing contradicts them."""
        for frames in (1, 2):
            seen = np.random.default_rng(frames).uniform(0, 500, (1, frames, 5, 2))
            found = pose.fuse(seen)
            self.assertFalse(found.outliers.any())
            np.testing.assert_allclose(found.points, seen[0], rtol=0, atol=0.1)

    def test_regions_hold_what_they_say(self):
        # Known noise, normal or with Student's t distribution, around velocities that are random walks.
        for degrees in (np.inf, 4):
            inside = {1: [], 2: []}
            for seed in range(12):
                rng = np.random.default_rng(seed)
                truth = np.cumsum(np.cumsum(rng.normal(0, 0.3, (100, 6, 2)), 0), 0)
                for views in inside:
                    noise = rng.normal(0, 1, (views, *truth.shape))
                    if degrees < np.inf:
                        noise /= np.sqrt(rng.chisquare(degrees, (*noise.shape[:3], 1)) / degrees)
                    found = pose.fuse(truth + noise)
                    inside[views].append((distances(found.points - truth, found.covariance) < 5.991).mean())
            for views, shares in inside.items():
                with self.subTest(degrees=degrees, views=views):
                    self.assertGreater(np.mean(shares), 0.90)
                    self.assertLess(np.mean(shares), 0.98)

    def test_regions_hold_in_frames_that_a_view_misses(self):
        # Each view is off by some pixels in all frames: 100 recordings of one joint that hardly moves, as one recording of 100 joints.
        rng = np.random.default_rng(12)
        cameras, joints, frames = ring(3), 100, 60
        truth = rng.normal(0, 1, (joints, 3)) + 0.2 * np.sin(np.arange(frames) / 20)[:, None, None]
        seen = np.array([camera.project(truth) for camera in cameras])
        seen += rng.normal(0, 8, (3, 1, joints, 2)) + rng.normal(0, 0.5, seen.shape)
        seen[rng.random(seen.shape[:3]) < 0.4] = np.nan
        found = pose.fuse(seen, None, cameras)
        inside = distances(found.points - truth, found.covariance) < 7.815
        views = np.isfinite(seen[..., 0]).sum(0)
        for number in range(4):
            with self.subTest(number):
                self.assertGreater(inside[views == number].mean(), 0.90)
                self.assertLess(inside[views == number].mean(), 0.99)

    def test_a_limb_gives_the_depth_that_one_view_does_not(self):
        errors, inside = [], []
        for seed in range(4):
            rng, t, cameras = np.random.default_rng(seed), np.arange(300), ring(6)[:3]
            base = np.stack([np.sin(t / 40), np.cos(t / 50), 0.3 * np.sin(t / 30)], -1)
            limb = np.stack([np.cos(t / 35) * np.cos(t / 55), np.sin(t / 35) * np.cos(t / 55), np.sin(t / 55)], -1)  # of length 1
            truth = np.stack([base, base + limb], 1)
            seen = np.array([camera.project(truth) for camera in cameras]) + rng.normal(0, 1, (3, 300, 2, 2))
            for start in range(20, 300, 60):
                seen[1:, start : start + 40, 1] = np.nan
            alone, held = pose.fuse(seen, None, cameras), pose.fuse(seen, None, cameras, [(0, 1)])
            errors.append([np.sqrt(((found.points - truth)[:, 1] ** 2).sum(-1).mean()) for found in (alone, held)])
            inside.append((distances(held.points - truth, held.covariance) < 7.815)[:, 1].mean())
            np.testing.assert_allclose(held.lengths, 1, rtol=0.01)
        alone, held = np.mean(errors, 0)
        self.assertLess(held, 0.75 * alone)
        self.assertGreater(np.mean(inside), 0.90)

    def test_a_limb_that_changes_its_length_does_not_pull(self):
        truth, seen, _, cameras = recording(13)
        lengths = np.linalg.norm(truth[:, 0] - truth[:, 2], axis=-1)
        self.assertGreater(lengths.std(), 0.1 * lengths.mean())
        alone, held = pose.fuse(seen, None, cameras), pose.fuse(seen, None, cameras, [(0, 2)])
        error = [np.sqrt(((found.points - truth) ** 2).sum(-1).mean()) for found in (alone, held)]
        self.assertLess(error[1], 1.05 * error[0])

    def test_a_joint_that_is_seen_once_or_twice(self):
        rng = np.random.default_rng(14)
        for frames in (3, 50, 1500):
            for times in (1, 2):
                with self.subTest(frames=frames, times=times):
                    seen = np.full((frames, 3, 2), np.nan)
                    seen[:, 0] = rng.normal(0, 1, (frames, 2))
                    for joint in (1, 2):
                        seen[rng.choice(frames, times, replace=False), joint] = rng.normal(5, 1, (times, 2))
                    found = pose.fuse(seen, skeleton=[(0, 1), (1, 2)])
                    self.assertTrue(np.isfinite(found.points).all())
                    self.assertGreater(np.linalg.eigvalsh(found.covariance).min(), 0)

    def test_a_long_recording_takes_the_scales_of_its_parts(self):
        truth, seen, _, cameras = recording(10, frames=1500, joints=2)
        found = pose.fuse(seen, None, cameras)
        self.assertLess(np.sqrt(((found.points - truth) ** 2).sum(-1).mean()), 0.0125)

    def test_more_steps_change_little(self):
        for dim in (2, 3):
            truth, seen, _, cameras = recording(15, frames=200)
            image = cameras[0].project(truth)
            arguments = (seen, None, cameras) if dim == 3 else (seen[0],)
            found = pose.fuse(*arguments)
            settled, pose_estimate._SETTLED = pose_estimate._SETTLED, 0.0
            try:
                longer = pose.fuse(*arguments)
            finally:
                pose_estimate._SETTLED = settled
            error = [np.sqrt(((path.points - (truth if dim == 3 else image)) ** 2).sum(-1).mean()) for path in (found, longer)]
            self.assertLess(error[0], 1.05 * error[1])
            np.testing.assert_allclose(found.noise, longer.noise, rtol=0.1)

    def test_the_estimate_is_a_fixed_point(self):
        # Of the equations on the page, which are written here with NumPy, after so many steps that they change nothing.
        for dim in (2, 3):
            truth, seen, _, cameras = recording(17, frames=60, joints=3, outliers=0.1, missing=0.2)
            if dim == 2:
                rng = np.random.default_rng(17)
                truth, cameras = 100 * truth[..., :2], None
                seen = truth + rng.normal(0, 1, (3, *truth.shape)) + np.where(rng.random((3, *truth.shape[:2], 1)) < 0.1, 50, 0)
            known = pose_fuse._checked(seen, None, cameras, None, np.arange(60) ** 1.1, None)[0]
            _, (noise, motion, offset, _, extent), points, observed, probability, weight, curvature, stiffness = known.compiled.estimate(0, 60, 0.0, 2000)
            error, rows = np.empty((*probability.shape, 2)), np.empty((*probability.shape, 2, dim))
            area = np.full(3, np.prod(np.ptp(seen.reshape(-1, 2), axis=0)))
            for view in range(3):
                if dim == 2:
                    error[view], rows[view] = points - seen[view], np.eye(2)
                    continue
                camera = cameras[view]
                area[view] = np.prod(camera.size)
                image, slope = camera.undistort(seen[view])
                at = (points + known.origin) @ camera.rotation.T + camera.translation
                error[view] = np.einsum("tjab,tjb->tja", slope, at[..., :2] / at[..., 2:] - image)
                flat = camera.rotation[:2] - (at[..., :2] / at[..., 2:])[..., None] * camera.rotation[2]
                rows[view] = np.einsum("tjab,tjbd->tjad", slope, flat) / at[..., 2, None, None]
            is_seen = np.isfinite(error[..., 0])
            error[~is_seen], rows[~is_seen] = 0, 0
            # Offsets: what no place of the joint explains of the mean errors, and noise does not, either.
            share = probability / probability.sum(1, keepdims=True)
            both = probability[:, 1:] * probability[:, :-1]
            lasting = max(0, ((both * (error[:, 1:] * error[:, :-1]).sum(-1)).sum(1) / both.sum(1)).sum() / (3 * (6 - dim)))
            kept = lasting / (lasting + noise**2 / probability.sum(1))
            for joint in range(3):
                slope = np.einsum("vt,vtkd->vkd", share[..., joint], rows[:, :, joint]).reshape(6, dim)
                mean = np.einsum("vt,vtk->vk", share[..., joint], error[:, :, joint]).ravel()
                np.testing.assert_allclose(offset[:, joint].ravel(), np.repeat(kept[:, joint], 2) * (slope @ np.linalg.pinv(slope) @ mean - mean), atol=1e-6)
            error += offset[:, None]
            # The chains of these weights, and of the curvatures.
            step = np.diff(known.times)
            c = np.stack([1 / step[:-1], -1 / step[:-1] - 1 / step[1:], 1 / step[1:]], 1) / np.sqrt((step[:-1] + step[1:]) / 2)[:, None]
            row, column = np.triu_indices(dim)
            weak = (100 * extent) ** -2

            def chain(weight):
                information = np.einsum("vtj,vtjad,vtjae->tjde", weight, rows, rows) + weak * np.eye(dim)
                goal = np.einsum("vtjad,tjd->vtja", rows, points) - error
                right = np.einsum("vtj,vtjad,vtja->tjd", weight, rows, goal) + weak * known.compiled.centre()
                return _asterism._difference_chains(information[..., row, column], right, c, stiffness)

            path, covariance, spread, _ = chain(weight)
            np.testing.assert_allclose(path, points, atol=1e-6 * extent)
            np.testing.assert_allclose(chain(curvature)[1], observed, rtol=1e-5, atol=1e-9 * covariance.max())
            blur = np.einsum("vtjad,tjde,vtjae->vtj", rows, pose_estimate._matrices(covariance), rows)
            square, variance = (error**2).sum(-1) + blur, noise[:, None] ** 2
            base = 1 + square / (4 * variance)
            expected, surprise = variance, base
            if dim == 2:  # the detection does not predict itself
                others = np.maximum(1 - weight * covariance[..., 0], 1e-3)
                expected = variance + covariance[..., 0] / others
                surprise = 1 + np.maximum(square - 2 * covariance[..., 0], 0) / (4 * others**2 * expected)
            likelihood = 0.99 / (2 * np.pi * expected * surprise**3)
            np.testing.assert_allclose(probability, is_seen * likelihood / (likelihood + 0.01 / area[:, None, None]), atol=1e-6)
            trust = probability * 1.5 / base
            np.testing.assert_allclose(weight, trust / variance, rtol=1e-5, atol=1e-9)
            # Half the trace of the Hessian of 3 log(1 + square / (4 variance)) where the point's own variance counts as error.
            np.testing.assert_allclose(curvature, trust / variance * (1 - square / (4 * variance + square)), rtol=1e-5, atol=1e-9)
            total, count = (trust * square).sum(1), 2 * probability.sum(1)
            np.testing.assert_allclose(noise**2, (total + 10 * total.sum() / count.sum()) / (count + 10), rtol=1e-5)
            change = (np.einsum("kt,ktjd->tjd", c.T, np.stack([points[:-2], points[1:-1], points[2:]])) ** 2).sum(-1) + spread
            near = np.stack([change[max(t - 2, 0) : t + 3].sum(0) for t in range(58)])
            number = np.array([len(change[max(t - 2, 0) : t + 3]) for t in range(58)])[:, None]
            calm = (1 + dim * number) / (1 + near / motion)
            np.testing.assert_allclose(stiffness, calm / motion, rtol=1e-4)
            np.testing.assert_allclose((calm * change).mean(0) / dim, motion, rtol=1e-4)

    def test_vectors_of_each_width_agree(self):
        widest = _asterism._pose_lanes(0)
        self.addCleanup(_asterism._pose_lanes, widest)
        truth, seen, _, cameras = recording(18, frames=150, joints=5)
        found = {}
        for lanes in (2, 4, 8):  # a machine without one of them takes the next narrower one
            _asterism._pose_lanes(lanes)
            space, image = pose.fuse(seen, None, cameras, [(0, 1)]), pose.fuse(seen[0])
            stream = pose.Stream(space, cameras)
            found[lanes] = [space.points, space.covariance, image.points, image.covariance, *(stream.push(frame).points for frame in seen.swapaxes(0, 1)[:40])]
        for lanes in (2, 4):
            for one, other in zip(found[lanes], found[8]):
                np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)

    def test_errors_of_networks_that_last(self):
        # Four networks of which the errors last for some 20 frames, of another size in each burst; the first one's path.
        rng, frames, joints = np.random.default_rng(16), 800, 3
        t = np.arange(frames)[:, None]
        truth = np.stack([100 + 50 * np.sin(t / [30, 40, 50]), 80 + 40 * np.cos(t / [35, 25, 60])], -1)
        errors = np.zeros((4, frames, joints, 2))
        for k in range(1, frames):
            errors[:, k] = 0.95 * errors[:, k - 1] + np.sqrt(1 - 0.95**2) * rng.normal(size=(4, joints, 2))
        errors *= np.where(t[:, :, None] // 100 % 2, 3.0, 1.0)
        networks = truth + errors + rng.normal(0, 0.1, errors.shape)
        deviation = pose.network_deviation(networks)
        self.assertGreater(np.median(deviation[100:200]), 1.5 * np.median(deviation[:100]))
        others = np.mean(networks[1:], 0)
        without, found = pose.fuse(networks[0]), pose.fuse(networks[0], deviation=deviation)
        for reference, least in ((truth, 0.90), (others, 0.90)):
            alone = distances(without.points - reference, without.covariance) < 5.991
            inside = distances(found.points - reference, found.covariance) < 5.991
            self.assertLess(alone.mean(), 0.5)
            self.assertGreater(inside.mean(), least)
            self.assertLess(inside.mean(), 0.999)
        for bad, words in [(networks[:1], "two networks or more"), (np.where(np.arange(joints)[:, None] == 1, np.nan, networks), "see joint 1")]:
            with self.assertRaisesRegex(ValueError, words):
                pose.network_deviation(bad)
        for bad, words in [(deviation[:5], "deviation: expected shape"), (0 * deviation, "deviation: expected positive numbers, found 0.0 in view 0, frame 0, joint 0")]:
            with self.assertRaisesRegex(ValueError, words):
                pose.fuse(networks[0], deviation=bad)

    def test_bad_input(self):
        truth, seen, _, cameras = recording(11, frames=20)
        never = seen.copy()
        never[:, :, 2] = np.nan
        infinite, half = seen.copy(), seen.copy()
        infinite[1, 3, 2, 0] = np.inf
        half[1, 3, 2] = np.nan, 5
        small = [pose.Camera(c.matrix, c.rotation, c.translation, c.distortions, (320, 256)) for c in cameras]
        times = np.arange(20.0)
        times[7] = times[6]
        cases = [
            ((np.zeros((3, 20, 4)),), {}, "detections: expected shape"),
            ((np.zeros((3, 0, 4, 2)),), {}, "at least one view, frame and joint"),
            ((infinite, None, cameras), {}, "infinite in view 1, frame 3, joint 2"),
            ((half, None, cameras), {}, "only one coordinate is missing in view 1, frame 3, joint 2"),
            ((never, None, cameras), {}, "joint 2 is never seen"),
            ((np.full((1, 9, 1, 2), np.nan),), {}, "joint 0 is never seen"),
            ((seen, None, cameras[:2]), {}, "cameras: expected one for each of the 3 views, found 2"),
            ((seen[:1], None, cameras[:1]), {}, "one view has no depth"),
            ((seen, None, [cameras[0], cameras[1], cameras[1]]), {}, "view 1 and view 1 are in one place"),
            ((seen, None, small), {}, "calibrated for an image of 320 x 256"),
            ((seen, np.full((3, 20, 4), 2.0), cameras), {}, "confidence: expected 0 to 1, found 2.0 in view"),
            ((seen, np.ones((3, 20, 5)), cameras), {}, "confidence: expected shape"),
            ((seen, None, cameras), {"times": times}, "times: expected rising times, found 6.0 before 6.0 at frame 7"),
            ((seen, None, cameras), {"times": 1e-300 * np.arange(20)}, "times: another unit is needed for 20 times between 0.0 and 1.9e-299"),
            ((seen, None, cameras), {"times": 1e300 * np.arange(20)}, "times: another unit is needed"),
            ((seen, None, cameras), {"times": np.full(20, np.nan)}, "times: expected finite numbers"),
            ((seen, None, cameras, [(0, 4)]), {}, "skeleton: expected pairs of the numbers of two joints, 0 to 3, found (0, 4)".replace("(", "[(]").replace(")", "[)]")),
            *(((seen, None, cameras, limbs), {}, "skeleton: expected pairs") for limbs in ([(1, 1)], [0, 1, 2], [(0, 1, 2), (0, 2, 3)], [(0, 1), (2,)], [(0.0, 1.0)], 3)),
            *(((seen, None, cameras), {"pairs": pairs}, "pairs: expected pairs") for pairs in ([(0.5, 1)], [("a", "b")], [0, 1], [(0, 1, 2)], 3)),
        ]
        for arguments, options, words in cases:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words) as caught:
                pose.fuse(*arguments, **options)
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaisesRegex(TypeError, "asterism.pose.Camera"):
            pose.fuse(seen, None, [1, 2, 3])
        for field, value in [("matrix", np.eye(2)), ("rotation", 2 * np.eye(3)), ("translation", [0, 0, np.nan]), ("distortions", range(8)), ("size", (0, 5)), ("matrix", [[1, 0, 0], [0, 1, 0], [9, 9, 1]])]:
            with self.subTest(field), self.assertRaisesRegex(ValueError, f"camera c: {field}"):
                pose.Camera(**{"matrix": np.eye(3), "rotation": [0, 0, 0], "translation": [0, 0, 1], "name": "c", field: value})


class StreamTest(unittest.TestCase):
    def test_a_frame_that_leaves_is_marginalised(self):
        # With the evidence and the weights of each frame when it left, all frames at once have the same newest frames.
        for dim in (2, 3):
            truth, seen, _, cameras = recording(20, frames=40, joints=2, outliers=0.05, missing=0.1)
            recorded = pose.fuse(seen, None, cameras) if dim == 3 else pose.fuse(seen[:1])
            stream = pose.Stream(recorded, cameras if dim == 3 else None, window=6)
            views, left = (slice(None), []) if dim == 3 else (slice(1), [])
            for frame in range(40):
                if len(stream.points) == 6:  # the oldest one leaves
                    left.append([array[0] for array in stream._window.evidence])
                newest = stream.push(seen[views, frame])
            self.assertEqual(len(left), 34)
            evidence = stream._window.evidence
            rows = left + [[array[k] for array in evidence[:2]] + [array[k] if k < 4 else None for array in evidence[2:]] for k in range(6)]
            for j in range(2):
                matrix, right = np.zeros((40 * dim, 40 * dim)), np.zeros(40 * dim)
                for t, (information, side, stiffness, c) in enumerate(rows):
                    here = slice(t * dim, (t + 1) * dim)
                    matrix[here, here] += pose_estimate._matrices(information[j])
                    right[here] += side[j]
                    if c is not None:
                        three = slice(t * dim, (t + 3) * dim)
                        matrix[three, three] += stiffness[j] * np.kron(np.outer(c, c), np.eye(dim))
                whole = np.linalg.solve(matrix, right).reshape(40, dim)
                np.testing.assert_allclose(stream.points[:, j], whole[-6:] + stream._origin, rtol=1e-6, atol=1e-7)
                if recorded.disagreement == 0:
                    # That of the curvatures in the window is larger than that of the weights.
                    ratios = np.linalg.eigvals(np.linalg.solve(np.linalg.inv(matrix)[-dim:, -dim:], newest.covariance[j])).real
                    self.assertTrue(((ratios > 1) & (ratios < 2)).all(), ratios)

    def test_it_is_near_the_whole_recording(self):
        truth, seen, is_wrong, cameras = recording(21, frames=400)
        recorded = pose.fuse(seen[:, :200], None, cameras)
        batch = pose.fuse(seen, None, cameras)
        stream = pose.Stream(recorded, cameras)
        found = [stream.push(frame) for frame in seen.swapaxes(0, 1)[200:]]
        points, covariance = np.array([f.points for f in found]), np.array([f.covariance for f in found])
        outliers, later = np.array([f.outliers for f in found]).swapaxes(0, 1), slice(10, None)

        def error(path):
            return np.sqrt(((path - truth[200:])[later] ** 2).sum(-1).mean())

        self.assertLess(error(points), 2.5 * error(batch.points[200:]))  # it does not see what comes later
        inside = distances((points - truth[200:])[later], covariance[later]) < 7.815
        self.assertGreater(inside.mean(), 0.90)
        is_seen, wrong = np.isfinite(seen[:, 200:, :, 0])[:, later], is_wrong[:, 200:][:, later]
        self.assertGreater(outliers[:, later][wrong].mean(), 0.95)
        self.assertLess(outliers[:, later][is_seen & ~wrong].mean(), 0.04)

    def test_the_first_frames_and_sudden_motions(self):
        # Two cameras see joints that rest and then move within a few frames; nothing is wrong or missing.
        rng = np.random.default_rng(25)
        cameras = ring(2)
        truth = np.zeros((400, 3, 3)) + rng.normal(0, 0.5, (3, 3))
        for begin in range(30, 400, 40):
            way = (1 - np.cos(np.pi * np.clip(np.arange(400) - begin, 0, 8) / 8)) / 2
            truth += way[:, None, None] * rng.normal(0, 0.3, (3, 3))
        seen = np.array([camera.project(truth) for camera in cameras]) + rng.normal(0, 1, (2, 400, 3, 2))
        stream = pose.Stream(pose.fuse(seen[:, :200], None, cameras), cameras)
        found = [stream.push(frame) for frame in seen.swapaxes(0, 1)[200:]]
        points, covariance = np.array([f.points for f in found]), np.array([f.covariance for f in found])
        away = np.linalg.norm(points - truth[200:], axis=-1)
        self.assertLess(away[:5].max(), 0.15)
        self.assertLess(np.quantile(away, 0.9), 0.1)
        self.assertLess(np.mean([f.outliers for f in found]), 0.01)
        self.assertGreater((distances(points - truth[200:], covariance) < 7.815).mean(), 0.8)

    def test_wrong_detections_do_not_begin_a_path(self):
        for seed in range(3):
            truth, seen, _, cameras = recording(26 + seed, frames=300, outliers=0.05, missing=0.1)
            rng = np.random.default_rng(seed)
            seen[:, 230:237] = rng.uniform((0, 0), (1280, 1024), (3, 7, 4, 2))
            stream = pose.Stream(pose.fuse(seen[:, :200], None, cameras), cameras)
            found = np.array([stream.push(frame).points for frame in seen.swapaxes(0, 1)[200:]])
            self.assertLess(np.quantile(np.linalg.norm(found - truth[200:], axis=-1)[38:60], 0.95), 0.1)
            # A cut that all three cameras see is no outlier after a few frames.
            moved = [camera.project(truth + 1) for camera in cameras] + rng.normal(0, 1, seen.shape)
            found = np.array([stream.push(frame).points for frame in moved.swapaxes(0, 1)[:40]])
            self.assertLess(np.linalg.norm(found - truth[:40] - 1, axis=-1)[6:].max(), 0.1)

    def test_confidence_is_relative(self):
        _, seen, _, cameras = recording(29, frames=60, joints=2)
        recorded = pose.fuse(seen, None, cameras)
        high, low, none = (pose.Stream(recorded, cameras) for _ in range(3))
        for frame in seen.swapaxes(0, 1):
            plain = high.push(frame, confidence=np.ones((3, 2))).points
            np.testing.assert_array_equal(low.push(frame, confidence=np.full((3, 2), 0.25)).points, plain)
            np.testing.assert_array_equal(none.push(frame, confidence=np.zeros((3, 2))).points, plain)

    def test_a_joint_that_comes_late_or_jumps(self):
        rng = np.random.default_rng(22)
        truth = np.stack([100 + 2.0 * np.arange(200), 80 + 30 * np.sin(np.arange(200) / 20)], -1)[:, None] + np.zeros((1, 2, 1))
        truth[120:, 1] += 150  # a cut
        seen = truth + rng.normal(0, 1, truth.shape)
        stream = pose.Stream(pose.fuse(seen))
        seen[:30, 0] = np.nan
        found = np.array([stream.push(frame).points for frame in seen])
        away = np.linalg.norm(found - truth, axis=-1)
        self.assertTrue(np.isfinite(found).all())
        self.assertLess(away[35:, 0].max(), 6)
        self.assertLess(away[10:119, 1].max(), 6)
        self.assertLess(away[140:, 1].max(), 6)

    def test_bad_input(self):
        truth, seen, _, cameras = recording(23, frames=30, joints=2)
        recorded = pose.fuse(seen, None, cameras)
        for arguments, words in [((recorded,), "points in 3 dimensions"), ((recorded, cameras, 2), "window"), ((recorded, cameras[:2]), "expected one for each of the 3 views")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.Stream(*arguments)
        stream = pose.Stream(recorded, cameras)
        stream.push(seen[:, 0], 5.0)
        before = stream.points
        infinite = seen[:, 1].copy()
        infinite[0, 0, 0] = np.inf
        for arguments, words in [((seen[:, 1, :1],), "detections: expected shape"), ((infinite,), "infinite in frame 1"), ((seen[:, 1], 5.0), "rising times, found 5.0 in frame 1"), ((seen[:, 1], np.nan), "time: expected a finite number, found nan"), ((seen[:, 1], 6.0, np.full((3, 2), 2.0)), "confidence"), ((seen[:, 1], 6.0, np.ones(6)), "confidence"), ((np.where([True, False], 1.0, np.nan) * seen[:, 1], 6.0), "only one coordinate")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                stream.push(*arguments)
        np.testing.assert_array_equal(stream.points, before)
        self.assertTrue(np.isfinite(stream.push(np.full((3, 2, 2), np.nan), 6.0).covariance).all())  # an empty frame


class SwapTest(unittest.TestCase):
    def swapped(self, path, pairs, seed):
        """Some stretches of frames with left and right exchanged, fewer than half; and which."""
        rng, found = np.random.default_rng(seed), path.copy()
        where = np.zeros((len(path), len(pairs)), bool)
        for p, (a, b) in enumerate(pairs):
            for start in rng.choice(len(path) // 40, len(path) // 120, replace=False) * 40:
                where[start : start + rng.integers(1, 35), p] = True
            found[where[:, p], a], found[where[:, p], b] = path[where[:, p], b], path[where[:, p], a]
        return found, where

    def test_paths_that_cross(self):
        for seed in range(5):
            rng, t = np.random.default_rng(seed), np.arange(600)[:, None]
            stride = 60 * np.sin(t / 9 + np.array([0, np.pi, 1, 4]))  # legs from the side: left and right cross
            truth = np.stack([200 + 0.5 * t + stride, 100 + 15 * np.cos(t / 9 + np.array([0, np.pi, 2, 5])) + [0, 0, 40, 40]], -1)
            seen, where = self.swapped(truth + rng.normal(0, 1, truth.shape), [(0, 1), (2, 3)], seed)
            seen[rng.random(seen.shape[:2]) < 0.1] = np.nan
            found = pose.exchange_back(seen, [(0, 1), (2, 3)])
            is_seen = np.isfinite(seen[..., 0])
            both = is_seen[:, [0, 2]] & is_seen[:, [1, 3]]
            self.assertLess((found.swapped != where)[both].mean(), 0.005)
            away = np.linalg.norm(found.detections - truth, axis=-1)
            self.assertLess((away[is_seen] > 10).mean(), 0.01)
            np.testing.assert_array_equal(found.apply(seen, [(0, 1), (2, 3)]), found.detections)
            fused = pose.fuse(seen, pairs=[(0, 1), (2, 3)])
            np.testing.assert_array_equal(fused.swapped[0], found.swapped)
            self.assertLess(np.median(np.linalg.norm(fused.points - truth, axis=-1)), 2)

    def test_nothing_swapped(self):
        truth, seen, _, _ = recording(24, frames=300, joints=4)
        self.assertLess(pose.exchange_back(seen, [(0, 1), (2, 3)]).swapped.mean(), 0.01)

    def test_views_that_disagree(self):
        # Legs that cross in the images of three cameras; swaps in one view, in single frames of all, and none at all.
        t = np.arange(300)[:, None]
        side = np.array([1, -1])
        truth = np.stack([0.25 * np.sin(t / 4) * side + 0.5 * np.sin(t / 80), 0.08 * np.maximum(0, np.cos(t / 4) * side), 0.2 * side + 0 * t], -1)
        cameras = ring(3)
        for kind in ("one view", "all views", "none"):
            rng = np.random.default_rng(len(kind))
            seen = np.array([camera.project(truth) for camera in cameras]) + rng.normal(0, 1, (3, 300, 2, 2))
            is_wrong = rng.random((3, 300, 2)) < 0.05
            seen[is_wrong] = rng.uniform((0, 0), (1280, 1024), (is_wrong.sum(), 2))
            where = np.zeros((3, 300), bool)
            if kind == "one view":
                where[1, 40:80] = where[1, 200:220] = True
            elif kind == "all views":
                where[:, rng.choice(300, 12, replace=False)] = True
            swapped = seen.copy()
            swapped[where] = seen[where][:, ::-1]
            found, right = pose.fuse(swapped, None, cameras, pairs=[(0, 1)]), pose.fuse(seen, None, cameras)
            is_clear = ~is_wrong.any(-1) & (np.linalg.norm(right.reprojections[:, :, 0] - right.reprojections[:, :, 1], axis=-1) > 6)
            self.assertLess((found.swapped[..., 0] != where)[is_clear].mean(), 0.005, kind)
            ratio = np.linalg.norm(found.points - truth, axis=-1).mean() / np.linalg.norm(right.points - truth, axis=-1).mean()
            self.assertLess(ratio, 1.3, kind)
        confidence = np.where(is_wrong, 0.2, 0.9)
        self.assertLess(pose.fuse(seen, confidence, cameras, pairs=[(0, 1)], times=t[:, 0] / 50, deviation=np.ones((3, 300, 2))).swapped.mean(), 0.005)

    def test_pairs_of_names(self):
        names = ["nose", "left_hip", "right_hip", "EarL", "EarR", "Ear_R", "Ear_L", "tail_left", "kneeRight", "kneeLeft", "L2", "R2"]
        self.assertEqual(sorted(pose.left_right_pairs(names)), [(1, 2), (3, 4), (6, 5), (9, 8), (10, 11)])

    def test_bad_input(self):
        seen = np.zeros((5, 3, 2))
        for arguments, words in [((seen[0], [(0, 1)]), "detections: expected shape"), ((seen, [(0, 1), (1, 2)]), "at most once"), ((seen, [(0, 3)]), "0 to 2"), ((seen + np.inf, [(0, 1)]), "finite"), ((seen, [(0, 1)], [0, 1, 1, 2, 3]), "rising")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.exchange_back(*arguments)


class FilesTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def write(self, text, name="a.csv"):
        (self.folder / name).write_text(text)
        return self.folder / name

    def test_tables(self):
        deeplabcut = self.write("scorer,n,n,n,n,n,n\nbodyparts,a,a,a,b,b,b\ncoords,x,y,likelihood,x,y,likelihood\n0,1,2,.5,,,\n7,3,4,.25,5,6,1\n")
        plain = self.write("frame,a_x,a_y,a_likelihood,b_x,b_y,b_likelihood\n0,1,2,.5,nan,nan,\n7,3,4,.25,5,6,1\n", "b.csv")
        for path in (deeplabcut, plain):
            found = pose.read_detections(path)
            self.assertEqual((found.joints, found.frames), (["a", "b"], ["0", "7"]))
            np.testing.assert_array_equal(found.points, [[[1, 2], [np.nan, np.nan]], [[3, 4], [5, 6]]])
            np.testing.assert_array_equal(found.confidence, [[0.5, 1], [0.25, 1]])
        for dim in (2, 3):
            points = np.random.default_rng(1).normal(size=(4, 2, dim))
            points[1, 1] = np.nan
            pose.write_points(self.folder / "c.csv", points, ["a", "b"])
            np.testing.assert_array_equal(pose.read_detections(self.folder / "c.csv").points, points)

    def test_what_is_no_table_is_told(self):
        for text, words in [
            ("frame;a_x;a_y\n0;1;2\n", "cells are separated by commas, not by ';'"),
            ("frame\ta_x\ta_y\n0\t1\t2\n", "cells are separated by commas, not by '.t'"),
            ("hello\n", "expected a header line, frame,NAME_x,NAME_y,.*, found 'hello'"),
            ("a_x,a_y\n1,2\n", "the first column is 'a_x', where the frame is expected"),
            ("x,y\n1,2\n", "the first column is 'x', where the frame is expected"),
            ("0,1,2\n1,2,3\n", "expected a header line, .*, found '0,1,2'"),
        ]:
            with self.subTest(text), self.assertRaisesRegex(ValueError, "a.csv: .*" + words):
                pose.read_detections(self.write(text))
        with self.assertRaisesRegex(ValueError, "points.txt: expected a name that ends with .csv, .h5 or .hdf5"):
            pose.write_points(self.folder / "points.txt", np.zeros((2, 1, 2)), ["a"])

    def test_cameras(self):
        path = self.write('[cam_0]\nname = "left"\nsize = [ 640, 480,]\nmatrix = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]\ndistortions = [0.1, 0, 0, 0, 0]\nrotation = [0.0, 0, 0]\ntranslation = [1.0, 2, 3]\n[metadata]\nerror = 1.0\n')
        (camera,) = pose.read_cameras(path)
        self.assertEqual(camera.name, "left")
        np.testing.assert_array_equal(camera.translation, [1, 2, 3])

    def test_one_animal_of_several(self):
        rest = "\nbodyparts,a,a,b,b\ncoords,x,y,x,y\n0,1,2,3,4\n"
        one = pose.read_detections(self.write("scorer,n,n,n,n\nindividuals,m,m,m,m" + rest))
        self.assertEqual(one.joints, ["a", "b"])
        np.testing.assert_array_equal(one.points, [[[1, 2], [3, 4]]])
        with self.assertRaisesRegex(ValueError, "a.csv: expected one animal, found 2"):
            pose.read_detections(self.write("scorer,n,n,n,n\nindividuals,m,m,w,w" + rest))

    def test_bad_files(self):
        header = "bodyparts,a,a,a\ncoords,x,y,likelihood\n"
        for text, words in [("", "empty"), (header, "no frames"), (header + "0,1,2\n", "a.csv:3: expected 4 cells, found 3"), (header + "0,1,inf,1\n", "a.csv:3: infinite"), (header + "0,1,2,three\n", "a.csv:3: not a number: 'three'"), (header + "\n0,1,2,three\n", "a.csv:4: not a number: 'three'"), ("bodyparts,a\ncoords,x\n0,1\n", "joint a has no column y"), ("frame,a_x,a_x\n0,1,2\n", "once each")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_detections(self.write(text))
        for text, words in [("[a", "a.toml: "), ("x = 1\n", "no cameras"), ("[c]\nmatrix = [1]\n", "c: no rotation"), ("[c]\nmatrix = [1]\nrotation = [0,0,0]\ntranslation = [0,0,0]\n", "c: camera c: matrix: expected shape")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_cameras(self.write(text, "a.toml"))
        with self.assertRaises(OSError):
            pose.read_detections(self.folder / "none.csv")
        with self.assertRaisesRegex(ValueError, "no table of text"):
            (self.folder / "b.csv").write_bytes(b"\xff\xfe\x00")
            pose.read_detections(self.folder / "b.csv")
        if h5py is None:
            with self.assertRaisesRegex(ImportError, "h5py"):
                pose.read_detections(self.write("", "a.h5"))


    @unittest.skipIf(h5py is None, "h5py is not installed")
    def test_sleap(self):
        # As SLEAP's documentation describes it: tracks (animals, 2, nodes, frames), point_scores (animals, nodes, frames), names in bytes.
        points, scores = np.random.default_rng(1).normal(50, 10, (6, 3, 2)), np.random.default_rng(2).uniform(0, 1.2, (6, 3))
        points[2, 1], scores[2, 1] = np.nan, np.nan

        def write(tracks, name="a.h5", **others):
            with h5py.File(self.folder / name, "w") as file:
                for key, value in {"tracks": tracks, "node_names": [b"nose", b"left", b"right"], "track_names": [b"mouse"], **others}.items():
                    file[key] = value
            return self.folder / name

        tracks = points.transpose(2, 1, 0)[None]
        found = pose.read_detections(write(tracks, point_scores=scores.T[None]))
        self.assertEqual((found.joints, found.frames), (["nose", "left", "right"], [str(t) for t in range(6)]))
        np.testing.assert_array_equal(found.points, points)
        np.testing.assert_array_equal(found.confidence, np.where(np.isnan(scores), 1, np.minimum(scores, 1)))
        pose.write_points(self.folder / "b.h5", points, found.joints, confidence=found.confidence)
        again = pose.read_detections(self.folder / "b.h5")
        np.testing.assert_array_equal(again.points, points)
        np.testing.assert_array_equal(again.confidence, found.confidence)
        for path, words in [(write(np.zeros((2, 2, 3, 6)), "e.h5"), "one animal, found 2"), (write(np.zeros((1, 2, 4, 6)), "f.h5"), "tracks of shape"), (write(tracks, "g.h5", point_scores=np.zeros((1, 3, 5))), "point_scores of shape"), (write(np.zeros((1, 2, 3, 0)), "h.h5"), "no frames"), (self.write("no", "c.h5"), "c.h5: no HDF5 file")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_detections(path)
        with self.assertRaisesRegex(ValueError, "in the image only"):
            pose.write_points(self.folder / "d.h5", np.zeros((2, 1, 3)), ["a"])
        with self.assertRaises(OSError):
            pose.read_detections(self.folder / "none.h5")

    @unittest.skipIf(h5py is None, "h5py is not installed")
    def test_deeplabcuts_hdf5(self):
        # As pandas writes a table: rows of index and values, the columns' names a pickle in an attribute.
        columns = [("net", joint, kind) for joint in ("a", "b") for kind in ("x", "y", "likelihood")]
        values = np.random.default_rng(3).uniform(0, 1, (4, 6))
        values[1, 3:] = np.nan

        def write(name, columns, values=values):
            rows = np.zeros(len(values), [("index", "i8"), ("values_block_0", "f8", (values.shape[1],))])
            rows["index"], rows["values_block_0"] = np.arange(len(values)), values
            with h5py.File(self.folder / name, "w") as file:
                group = file.create_group("df_with_missing")
                group["table"] = rows
                group.attrs["non_index_axes"] = np.bytes_(columns if isinstance(columns, bytes) else pickle.dumps([(1, columns)], 0))
            return self.folder / name

        found = pose.read_detections(write("a.h5", columns))
        self.assertEqual(found.joints, ["a", "b"])
        np.testing.assert_array_equal(found.points, np.stack([values[:, [0, 3]], values[:, [1, 4]]], -1))
        np.testing.assert_array_equal(found.confidence, [[v[2], 1 if np.isnan(v[5]) else v[5]] for v in values])
        for bad, words in [(columns[:3], "3 columns are named"), (pickle.dumps(print, 0), "not DeepLabCut's table"), ([("x", *c) if k else ("y", *c) for k, c in enumerate(columns)], "one animal")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_detections(write("b.h5", bad))


class ToolTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.truth, self.seen, _, self.cameras = recording(30, frames=60)
        self.names = ["hip_left", "hip_right", "knee", "toe"]
        text = ""
        for view, camera in enumerate(self.cameras):
            fields = {field: getattr(camera, field).tolist() for field in ("matrix", "rotation", "translation", "distortions", "size")}
            text += f'[cam_{view}]\nname = "{camera.name}"\n' + "".join(f"{key} = {value}\n" for key, value in fields.items())
        self.write("calibration.toml", text)
        for camera, view in zip(self.cameras, self.seen):
            pose.write_points(self.folder / f"{camera.name}.csv", view, self.names)
        self.files = [str(self.folder / f"{camera.name}.csv") for camera in self.cameras]

    def write(self, name, text):
        (self.folder / name).write_text(text)
        return str(self.folder / name)

    def run_tool(self, *arguments):
        """Exit code, output and errors."""
        output, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            code = pose_tool.main([*arguments, "--output", str(self.folder / "points.csv")])
        return code, output.getvalue(), errors.getvalue()

    def test_points_in_space(self):
        skeleton = self.write("skeleton.csv", "from,to\nhip_left,knee\nknee,toe\n")
        times = self.write("times.txt", "\n".join(str(t / 30) for t in range(60)))
        options = ["--cameras", str(self.folder / "calibration.toml"), "--skeleton", skeleton, "--times", times, "--details", str(self.folder / "details.csv")]
        code, output, errors = self.run_tool(*reversed(self.files), *options)  # in another order than the calibration's
        self.assertEqual((code, errors), (0, ""))
        self.assertIn("60 frames, 4 joints", output)
        expected = pose.fuse(self.seen[::-1], None, self.cameras[::-1], [(0, 2), (2, 3)], np.arange(60) / 30)
        np.testing.assert_array_equal(pose.read_detections(self.folder / "points.csv").points, expected.points)
        rows = list(csv.reader((self.folder / "details.csv").read_text().splitlines()))
        self.assertEqual(len(rows), 1 + 60 * 4)
        np.testing.assert_allclose([float(v) for v in rows[5][2:8]], [*expected.points[1, 0], *np.sqrt(np.diag(expected.covariance[1, 0]))])

    def test_frames_that_are_left_out(self):
        kept = np.r_[0:20, 35:60]
        pose.write_points(self.folder / "gap.csv", self.seen[0, kept], self.names, [str(k) for k in kept])
        code, output, errors = self.run_tool(str(self.folder / "gap.csv"))
        self.assertEqual((code, errors), (0, ""))
        self.assertRegex(output, r"the others are \d\S* px off \(median\)")
        found = pose.read_detections(self.folder / "points.csv").points
        np.testing.assert_array_equal(found, pose.fuse(self.seen[0, kept], times=kept).points)
        self.assertFalse(np.array_equal(found, pose.fuse(self.seen[0, kept]).points))

    def test_pairs_in_the_image(self):
        code, output, errors = self.run_tool(self.files[0], "--pairs", "names", "--confidence")
        self.assertEqual((code, errors), (0, ""))
        self.assertIn("swapped pair", output)
        self.assertEqual(self.run_tool(self.files[0], "--pairs", "knee:toe")[0], 0)

    def test_errors_are_one_line(self):
        other = self.write("other.csv", "frame,a_x,a_y\n0,1,2\n")
        short = str(self.folder / "short.csv")
        pose.write_points(short, self.seen[0, :9], self.names)
        toml = str(self.folder / "calibration.toml")
        cases = [
            ([str(self.folder / "none.csv")], "none.csv: No such file"),
            ([self.files[0], other], "other.csv: has other joints than"),
            ([self.files[0], short], "short.csv: has 9 frames"),
            ([*self.files[:1], short, short, short, "--cameras", toml], "short.csv: has 9 frames"),
            ([self.files[0], "--cameras", toml], "one view has no depth"),
            ([self.files[0], "--cameras", other], "other.csv: "),
            ([self.files[0], "--skeleton", self.write("s.csv", "knee,toe\nknee,tail\n")], "s.csv:2: no joint is named tail"),
            ([self.files[0], "--skeleton", self.write("e.csv", "")], "e.csv: no limbs"),
            ([self.files[0], "--times", self.write("t.txt", "0\none\n")], "t.txt:2: not a number: 'one'"),
            ([self.files[0], "--times", self.write("u.txt", "0\n1\n")], "u.txt: has 2 times for"),
            ([self.write("falls.csv", "frame,a_x,a_y\n1,1,2\n0,2,3\n")], "falls.csv: expected rising frames, found 0 after 1"),
            ([self.write("never.csv", "frame,a_x,a_y,b_x,b_y\n0,1,2,,\n1,2,3,,\n")], "never.csv: joint b is never seen"),
            ([self.files[0], self.write("other view.csv", pathlib.Path(self.files[1]).read_text()), "--cameras", toml], "named as they are (view 0.csv, view 1.csv, view 2.csv)"),
            ([self.files[0], "--pairs", "knee"], "expected LEFT:RIGHT"),
            ([self.files[0], "--pairs", "knee:tail"], "no joint is named tail"),
            ([other, "--pairs", "names"], "differ in left and right"),
            ([self.files[0], "--details", self.files[0]], "would change the input"),
            ([self.files[0], "--times", toml, "--details", toml], "would change the input"),
            ([self.files[0], "--details", str(self.folder / "points.csv")], "is the file of --output"),
        ]
        for arguments, words in cases:
            with self.subTest(words):
                code, output, errors = self.run_tool(*arguments)
                self.assertEqual((code, output), (1, ""))
                self.assertIn(words, errors)
                self.assertEqual(errors.count("\n"), 1)
                self.assertTrue(errors.startswith("asterism-pose: "))

    def test_wrong_options_and_outputs_are_one_line_before_any_work(self):
        folder = str(self.folder)
        for arguments, code, words in [
            ([], 2, "required: FILE, --output/-o; see --help"),
            ([self.files[0], "-o", "x.csv", "--nope"], 2, "unrecognized arguments: --nope; see --help"),
            ([self.files[0], "-o", folder + "/no/x.csv"], 1, f"--output {folder}/no/x.csv: no folder {folder}/no"),
            ([self.files[0], "-o", folder + "/x.csv", "--details", folder + "/no/x.csv"], 1, f"--details {folder}/no/x.csv: no folder {folder}/no"),
            ([self.files[0], "-o", folder], 1, "expected the name of a file"),
            ([self.files[0], "-o", "-"], 1, "--output -: expected the name of a file"),
        ]:
            errors = io.StringIO()
            with self.subTest(words), contextlib.redirect_stderr(errors), unittest.mock.patch.object(pose, "fuse", side_effect=AssertionError):
                try:
                    found = pose_tool.main(arguments)
                except SystemExit as stopped:
                    found = stopped.code
                self.assertEqual(found, code)
                self.assertEqual(errors.getvalue().count("\n"), 1)
                self.assertTrue(errors.getvalue().startswith("asterism-pose: "))
                self.assertIn(words, errors.getvalue())

    def test_an_interrupt_is_one_line(self):
        with unittest.mock.patch.object(pose, "fuse", side_effect=KeyboardInterrupt):
            self.assertEqual(self.run_tool(self.files[0]), (130, "", "asterism-pose: interrupted\n"))
        self.assertFalse((self.folder / "points.csv").exists())

    def test_files_are_whole_or_as_they_were(self):
        system = asterism.SpringSystem(asterism.Topology.full(30))
        system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = 0, 1, 1, 1
        writers = [("points.csv", lambda path: pose.write_points(path, self.seen[0], self.names))]
        if hasattr(asterism, "write_systems"):
            writers.append(("systems.json", lambda path: asterism.write_systems(path, [asterism.StoredSystem(system, np.zeros((30, 2)))])))
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        for name, write in writers:
            path = self.folder / name
            for before in (None, "what was there\n"):
                with self.subTest(name, before=before):
                    if before:
                        path.write_text(before)
                    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))  # as a full disk
                    try:
                        with self.assertRaises(OSError) as raised:
                            write(path)
                    finally:
                        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
                    self.assertEqual(raised.exception.filename, str(path))
                    self.assertEqual(path.read_text() if path.exists() else None, before)
                    self.assertEqual([file for file in self.folder.iterdir() if ".part" in file.name], [])
            path.chmod(0o640)
            write(path)
            self.assertEqual(path.stat().st_mode & 0o777, 0o640)
            self.assertNotEqual(path.read_text(), before)

    def test_no_input_is_overwritten(self):
        before = pathlib.Path(self.files[0]).read_bytes()
        (self.folder / "link.csv").symlink_to(self.files[0])
        for output, words in [(self.files[0], "would change the input"), (str(self.folder / "link.csv"), "would change the input"),
                              (str(self.folder / "points.slp"), "expected a name that ends with .csv, .h5 or .hdf5")]:
            errors = io.StringIO()
            with self.subTest(output), contextlib.redirect_stderr(errors):
                self.assertEqual(pose_tool.main([self.files[0], "--output", output]), 1)
                self.assertIn(words, errors.getvalue())
        self.assertEqual(pathlib.Path(self.files[0]).read_bytes(), before)


class PageTest(unittest.TestCase):
    def test_the_code_of_the_page(self):
        truth, seen, _, cameras = recording(12, frames=60)
        names = ["hip", "knee", "ankle", "toe"]
        with tempfile.TemporaryDirectory() as folder:
            here = os.getcwd()
            os.chdir(folder)
            self.addCleanup(os.chdir, here)
            with open("calibration.toml", "w") as file:
                for view, camera in enumerate(cameras):
                    fields = {field: getattr(camera, field).tolist() for field in ("matrix", "rotation", "translation", "distortions", "size")}
                    file.write(f'[cam_{view}]\nname = "{camera.name}"\n' + "".join(f"{key} = {value}\n" for key, value in fields.items()))
            for camera, view in zip(cameras, seen):
                pose.write_points(f"{camera.name}.csv", view, names)
            session = {}
            for block in re.findall(r"^```python\n(.*?)^```\n", PAGE.read_text(), re.MULTILINE | re.DOTALL):
                exec(compile(block, str(PAGE), "exec"), session)
            np.testing.assert_array_equal(pose.read_detections("points.csv").points, session["found"].points)
            self.assertLess(np.median(np.linalg.norm(session["found"].points - truth, axis=-1)), 0.0125)
            os.chdir(here)


class ManyOutliersTest(unittest.TestCase):
    def test_as_many_as_a_vote_of_the_views_bears(self):
        for seed in range(3):
            truth, seen, _, cameras = recording(seed, views=5, frames=20, joints=6, outliers=0.4, missing=0)
            least = np.median(np.linalg.norm(pose.fuse(recording(seed, views=5, frames=20, joints=6, outliers=0, missing=0)[1], None, cameras).points - truth, axis=-1))
            found = pose.fuse(seen, None, cameras)
            self.assertLess(np.median(np.linalg.norm(found.points - truth, axis=-1)), 3 * least, seed)
            self.assertLess(np.median(found.noise), 3, seed)

    def test_in_an_image_of_three_detectors(self):
        rng = np.random.default_rng(4)
        truth = 500 + np.cumsum(rng.normal(0, 2, (50, 1, 2)), 0) + rng.normal(0, 100, (1, 6, 2))
        seen = truth + rng.normal(0, 1, (3, 50, 6, 2))
        is_wrong = rng.random(seen.shape[:3]) < 0.4
        seen[is_wrong] = rng.uniform(0, 1000, (is_wrong.sum(), 2))
        self.assertLess(np.median(np.linalg.norm(pose.fuse(seen).points - truth, axis=-1)), 1.5)

    def test_of_one_frame(self):
        # Offsets of the views would explain every error of one frame.
        for joints in (1, 6):
            truth, seen, _, cameras = recording(5, views=5, frames=1, joints=joints, outliers=0, missing=0)
            seen[0, :, 0] += 300
            if joints > 1:
                seen[3, :, 2] -= 200
            for these in (cameras, [pose.Camera(c.matrix, c.rotation, c.translation, c.distortions) for c in cameras]):
                found = pose.fuse(seen, None, these)
                self.assertLess(np.linalg.norm(found.points - truth, axis=-1).max(), 0.1)
                self.assertTrue(found.outliers[0, 0, 0])
                np.testing.assert_array_equal(found.offsets, 0)

    def test_the_same_confidence_for_all_says_nothing(self):
        _, seen, _, cameras = recording(6, views=4, frames=20, outliers=0.1)
        expected = pose.fuse(seen, None, cameras).points
        for confidence in (0, 1e-3, 0.5, 1):
            np.testing.assert_array_equal(pose.fuse(seen, np.full(seen.shape[:3], confidence), cameras).points, expected)


class RecordingsTest(unittest.TestCase):
    def setUp(self):
        if not FOLDER.is_dir():
            self.skipTest("the folder with mouse, fly and paw is missing")

    def test_the_copy_of_a_calibration_is_found(self):
        cameras = pose.read_cameras(FOLDER / "mouse" / "calibration.toml")
        seen = np.array([pose.read_detections(FOLDER / "mouse" / f"{camera.name}.csv").points for camera in cameras])
        with self.assertRaisesRegex(ValueError, "side and top are in one place"):
            pose.fuse(seen, None, cameras)

    def test_wrong_detections_of_the_fly_are_found(self):
        cameras = pose.read_cameras(FOLDER / "fly" / "calibration.toml")
        seen = np.array([pose.read_detections(FOLDER / "fly" / f"{camera.name}.seed0.csv").points for camera in cameras])
        reference = pose.fuse(seen, None, cameras)
        rng = np.random.default_rng(1)
        is_wrong = rng.random(seen.shape[:3]) < 0.2
        seen[is_wrong] = rng.uniform((0, 0), cameras[0].size, (is_wrong.sum(), 2))
        found = pose.fuse(seen, None, cameras)
        self.assertGreater(found.outliers[is_wrong].mean(), 0.98)
        self.assertLess(np.median(np.linalg.norm(found.points - reference.points, axis=-1)), 0.005)


if __name__ == "__main__":
    unittest.main()
