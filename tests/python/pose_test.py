#!/usr/bin/env python3
"""asterism.pose: the kernel against dense matrices, cameras against OpenCV's formulas, fuse against known paths, files, bad input.

pose_test.py PAGE FOLDER: the page whose code is run, and the folder with mouse, fly and paw, whose tests are skipped without it.
"""

import os
import pathlib
import re
import sys
import tempfile
import unittest

import numpy as np
from asterism import _asterism, pose

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
        for frames in (1, 2, 3, 5):
            found = pose.fuse(seen[:, :frames], None, cameras)
            self.assertLess(np.linalg.norm(found.points - truth[:frames], axis=-1).max(), 0.1)
            self.assertTrue(np.isfinite(found.covariance).all())

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
            ((seen, None, cameras), {"times": np.full(20, np.nan)}, "times: expected finite numbers"),
            ((seen, None, cameras, [(0, 4)]), {}, "skeleton: expected pairs of two joints, 0 to 3"),
            ((seen, None, cameras, [(1, 1)]), {}, "skeleton: expected pairs"),
        ]
        for arguments, options, words in cases:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words) as caught:
                pose.fuse(*arguments, **options)
            self.assertNotIn("\n", str(caught.exception))
        with self.assertRaisesRegex(TypeError, "asterism.pose.Camera"):
            pose.fuse(seen, None, [1, 2, 3])
        for field, value in [("matrix", np.eye(2)), ("rotation", 2 * np.eye(3)), ("translation", [0, 0, np.nan]), ("distortions", range(8)), ("size", (0, 5))]:
            with self.subTest(field), self.assertRaisesRegex(ValueError, f"camera c: {field}"):
                pose.Camera(**{"matrix": np.eye(3), "rotation": [0, 0, 0], "translation": [0, 0, 1], "name": "c", field: value})


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

    def test_cameras(self):
        path = self.write('[cam_0]\nname = "left"\nsize = [ 640, 480,]\nmatrix = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]\ndistortions = [0.1, 0, 0, 0, 0]\nrotation = [0.0, 0, 0]\ntranslation = [1.0, 2, 3]\n[metadata]\nerror = 1.0\n')
        (camera,) = pose.read_cameras(path)
        self.assertEqual(camera.name, "left")
        np.testing.assert_array_equal(camera.translation, [1, 2, 3])

    def test_bad_files(self):
        header = "bodyparts,a,a,a\ncoords,x,y,likelihood\n"
        for text, words in [("", "empty"), (header, "no frames"), (header + "0,1,2\n", "a.csv:3: expected 4 cells, found 3"), (header + "0,1,2,three\n", "a.csv:3: not a number: 'three'"), (header + "\n0,1,2,three\n", "a.csv:4: not a number: 'three'"), ("bodyparts,a\ncoords,x\n0,1\n", "joint a has no column y"), ("frame,a_x,a_x\n0,1,2\n", "once each")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_detections(self.write(text))
        for text, words in [("[a", "a.toml: "), ("x = 1\n", "no cameras"), ("[c]\nmatrix = [1]\n", "c: no rotation"), ("[c]\nmatrix = [1]\nrotation = [0,0,0]\ntranslation = [0,0,0]\n", "c: camera c: matrix: expected shape")]:
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                pose.read_cameras(self.write(text, "a.toml"))
        with self.assertRaises(OSError):
            pose.read_detections(self.folder / "none.csv")
        try:
            import h5py  # noqa: F401
        except ImportError:
            with self.assertRaisesRegex(ImportError, "h5py"):
                pose.read_detections(self.write("", "a.h5"))


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
            (block,) = re.findall(r"^```python\n(.*?)^```\n", PAGE.read_text(), re.MULTILINE | re.DOTALL)
            exec(compile(block, str(PAGE), "exec"), session)
            np.testing.assert_array_equal(pose.read_detections("points.csv").points, session["found"].points)
            self.assertLess(np.median(np.linalg.norm(session["found"].points - truth, axis=-1)), 0.0125)
            os.chdir(here)


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
