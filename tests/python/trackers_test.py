#!/usr/bin/env python3
"""Trackers from Python, against asterism-track: trackers_test.py [ASTERISM_TRACK]."""

import math
import pathlib
import subprocess
import sys
import tempfile
import threading
import tracemalloc
import unittest

import asterism
import numpy as np
from moving_square import BOX, draw_frame, true_box, write_png

TRACK = sys.argv.pop() if len(sys.argv) > 1 and not sys.argv[-1].startswith("-") else None
FRAMES = 12


def follow(tracker, frames):
    return [tracker.update(frame) for frame in frames]


def boxes(results):
    return [result.box for result in results]


class TrackersTest(unittest.TestCase):
    frames = [draw_frame(i) for i in range(FRAMES)]

    def started(self, name="dpt", options=None):
        tracker = asterism.Tracker(name, options)
        tracker.init(self.frames[0], BOX)
        return tracker

    @unittest.skipUnless(TRACK, "asterism-track was not built")
    def test_the_same_numbers_as_asterism_track(self):
        with tempfile.TemporaryDirectory() as folder:
            images = pathlib.Path(folder) / "images"
            images.mkdir()
            for i, frame in enumerate(self.frames):
                write_png(images / f"{i:04}.png", frame)
            for name in ("dpt", "kcf", "dpt_plus"):
                with self.subTest(name):
                    box = ",".join(map(str, BOX))
                    command = [TRACK, str(images), "--box", box, "--tracker", name, "--out", "-"]
                    csv = subprocess.run(command, check=True, capture_output=True, text=True).stdout
                    expected = [line.split(",")[1:7] for line in csv.splitlines()[2:]]
                    self.assertEqual(len(expected), FRAMES - 1)
                    results = follow(self.started(name), self.frames[1:])
                    found = [
                        [f"{number:.4f}" for number in (*result.box, result.confidence)] + [str(int(result.lost))]
                        for result in results
                    ]
                    self.assertEqual(found, expected)

    def test_starts_on_polygons_and_masks(self):
        x, y, width, height = BOX
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        mask = np.zeros(self.frames[0].shape[:2], bool)
        mask[y:y + height, x:x + width] = True
        expected = follow(self.started("kcf"), self.frames[1:3])
        for region in (corners, np.array(corners, float).ravel(), np.array(corners), mask, mask.astype(np.uint8)):
            tracker = asterism.Tracker("kcf")
            tracker.init(self.frames[0], region)
            for result, other in zip(follow(tracker, self.frames[1:3]), expected):
                np.testing.assert_allclose(result.box, other.box, atol=1e-6)
        diamond = asterism.Tracker("kcf")
        diamond.init(self.frames[0], [x + width / 2, y, x + width, y + height / 2, x + width / 2, y + height, x, y + height / 2])
        result = diamond.update(self.frames[1])
        self.assertAlmostEqual(result.box[2] * result.box[3], width * height / 2, delta=1e-6)
        for bad in ((1, 2, 3), "box", np.zeros((3, 3)), np.ones((4, 5), np.uint8), 0 * mask, [[1, 2], [3, 4]], None, {}):
            with self.assertRaises(ValueError, msg=repr(bad)):
                asterism.Tracker("kcf").init(self.frames[0], bad)

    def test_results(self):
        for frame, result in enumerate(follow(self.started(), self.frames[1:]), 1):
            np.testing.assert_allclose(result.box, true_box(frame), atol=3)
            self.assertFalse(result.lost)
            self.assertTrue(0 < result.confidence <= 1)
        x, y, width, height = result.box
        upright = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        middle = upright.mean(axis=0)
        turn = np.array([[math.cos(result.angle), -math.sin(result.angle)], [math.sin(result.angle), math.cos(result.angle)]])
        np.testing.assert_allclose(result.corners(), middle + (upright - middle) @ turn.T, atol=1e-9)
        self.assertEqual(len(result.parts), 4)
        self.assertEqual(result.links.shape, (6, 2))
        part = result.parts[0]
        self.assertEqual(part.position.shape, (2,))
        # Boxes cover whole pixels; positions refer to pixel centres.
        np.testing.assert_allclose(result.corners(part).mean(axis=0), part.position + 0.5, atol=1e-9)
        self.assertEqual(result.covariance.shape, (3, 3))
        self.assertTrue(np.all(np.linalg.eigvalsh(result.covariance) >= 0))
        self.assertAlmostEqual(sum(result.times.values()), result.milliseconds)
        self.assertRegex(repr(result), r"^<asterism.TrackResult: box \(\d+\.\d+, .*, confidence 0\.\d+>$")

    def test_in_the_shape_of_cv2(self):
        tracker, plain = asterism.OpenCvTracker.create("kcf"), self.started("kcf")
        self.assertIsNone(tracker.init(self.frames[0], np.array(BOX)))
        self.assertIsNone(tracker.result)
        for frame in self.frames[1:]:
            ok, box = tracker.update(frame)
            result = plain.update(frame)
            self.assertTrue(ok)
            self.assertEqual(tracker.result.box, result.box)
            self.assertTrue(all(type(value) is int for value in box))
            x, y, width, height = result.box
            edges = (box[0], box[1], box[0] + box[2], box[1] + box[3])
            np.testing.assert_allclose(edges, (x, y, x + width, y + height), atol=0.5)
        noise = np.random.default_rng(0).integers(0, 256, self.frames[0].shape, np.uint8)
        for _ in range(9):
            ok, there = tracker.update(noise)
            if not ok:
                break
            box = there
        self.assertEqual((ok, there), (False, box))  # the last box stays
        tracker.init(self.frames[0], BOX)
        self.assertEqual(asterism.OpenCvTracker()._tracker.name, asterism.Tracker().name)
        self.assertRaisesRegex(ValueError, "width and height above 0, found -1.0 x 20.0", tracker.init, self.frames[0], (9, 9, -1, 20))
        self.assertRaisesRegex(ValueError, "0 x 20 px", tracker.init, self.frames[0], (9, 9, 0, 20))
        self.assertRaisesRegex(RuntimeError, "update before init", asterism.OpenCvTracker("kcf").update, noise)

    def test_images_of_every_kind(self):
        expected = boxes(follow(self.started("kcf"), self.frames[1:]))
        alpha = np.full((240, 320, 1), 255, np.uint8)
        for name, convert in {
            "16 bit": lambda f: f.astype(np.uint16) * 257,
            "float": lambda f: f.astype(np.float32) / 255,
            "four channels": lambda f: np.concatenate([f, alpha], axis=2),
            "rows of a larger image": lambda f: np.pad(f, ((3, 3), (5, 5), (0, 0)))[3:-3, 5:-5],
            "in another order": lambda f: np.ascontiguousarray(f[..., ::-1])[..., ::-1],
            "columns first": np.asfortranarray,
            "read-only": lambda f: np.frombuffer(f.tobytes(), np.uint8).reshape(f.shape),
            "upside down": lambda f: np.ascontiguousarray(f[::-1])[::-1],
        }.items():
            with self.subTest(name):
                tracker = asterism.Tracker("kcf")
                tracker.init(convert(self.frames[0]), BOX)
                self.assertEqual(boxes(follow(tracker, map(convert, self.frames[1:]))), expected)
        gray = asterism.Tracker("kcf")
        gray.init(self.frames[0][..., 1], BOX)
        np.testing.assert_allclose(gray.update(np.ascontiguousarray(self.frames[1][..., 1])).box, true_box(1), atol=3)

    def test_values_beyond_the_type_s_range(self):
        expected = boxes(follow(self.started("kcf"), self.frames[1:]))
        for name, convert, suggested, refused in [  # one line per kind
            ("uint8 in uint16", lambda f: f.astype(np.uint16), (0, 255), "at most 255"),
            ("10 bits in uint16", lambda f: ((f.astype(np.uint32) * 1023 + 127) // 255).astype(np.uint16), (0, 1023), None),
            ("12 bits in uint16", lambda f: (f.astype(np.uint16) << 4) + (f >> 4), (0, 4095), None),
            ("uint8 in float32", lambda f: f.astype(np.float32), (0, 255), r"in \[0, 1\] and are in"),
            ("-1 to 1 in float32", lambda f: f / np.float32(127.5) - np.float32(1), None, r"in \[0, 1\] and are in"),
        ]:
            with self.subTest(name):
                images = [convert(frame) for frame in self.frames]
                pixel_range = asterism.suggested_range(images[0])
                if suggested:
                    self.assertEqual(pixel_range, suggested)
                tracker = asterism.Tracker("kcf")
                objects = asterism.MultiTracker()
                if refused:
                    with self.assertRaisesRegex(ValueError, refused):
                        tracker.init(images[0], BOX)
                    with self.assertRaisesRegex(ValueError, refused):
                        objects.add(1, images[0], BOX, "kcf")
                pixel_range = suggested or (-1, 1)
                tracker = asterism.Tracker("kcf", pixel_range=pixel_range)
                tracker.init(images[0], BOX)
                self.assertEqual(boxes(follow(tracker, images[1:])), expected)
                objects = asterism.MultiTracker(pixel_range=pixel_range)
                objects.add(1, images[0], BOX, "kcf")
                self.assertEqual([objects.update(image)[1].box for image in images[1:]], expected)
        self.assertIsNone(asterism.suggested_range(self.frames[0]))
        for bad in [(1, 0), (0, math.nan), (0, math.inf)]:
            with self.assertRaisesRegex(ValueError, "black must be below white"):
                asterism.Tracker("kcf", pixel_range=bad)

    def test_images_are_used_as_they_are(self):
        tracker = asterism.Tracker("kcf")
        large = np.zeros((1200, 1600, 3), np.uint8)
        large[:240, :320] = self.frames[0]
        tracker.init(large, BOX)
        for image, copies in [(large, 0), (large[100:, 100:-7], 0), (large[..., ::-1], 1)]:
            tracemalloc.start()  # traces NumPy's memory
            tracker.update(image)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            self.assertEqual(round(peak / large.nbytes), copies)

    def test_refuses_what_is_no_image(self):
        tracker = self.started("kcf")
        image = self.frames[1]
        for bad, error, message in [
            (image.tolist(), TypeError, "image: expected a NumPy array, found list"),
            (image.astype(float), TypeError, "found float64; convert it, in .0, 1., to float32"),
            (image.astype(np.float16), TypeError, "found float16; convert it, in .0, 1., to float32"),
            (image.astype(np.uint32), TypeError, "image: expected uint8, uint16 or float32, found uint32$"),
            (image.astype(np.int16), TypeError, "image: expected uint8, uint16 or float32, found int16$"),
            (image.astype(">u2"), TypeError, "image: expected uint8, uint16 or float32, found >u2"),
            (image.astype(">f4"), TypeError, "image: expected uint8, uint16 or float32, found >f4"),
            (image > 9, TypeError, "image: expected uint8, uint16 or float32, found bool"),
            (image.astype(object), TypeError, "image: expected uint8, uint16 or float32, found object"),
            (np.array(7, np.uint8), ValueError, r"found \(\)"),
            (np.uint8(7), TypeError, "image: expected a NumPy array, found uint8"),
            (None, TypeError, "image: expected a NumPy array, found NoneType; cv2.imread returns None for a file that it cannot read"),
            ("a.png", TypeError, "image: expected a NumPy array, found str; cv2.imread reads one from a file"),
            (image[..., :2], ValueError, r"image: expected shape .*, found \(240, 320, 2\)"),
            (image[None], ValueError, r"found \(1, 240, 320, 3\)"),
            (image[:0], ValueError, r"found \(0, 320, 3\)"),
            (np.full((240, 320), np.nan, np.float32), ValueError, "a pixel is not finite"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(error, message):
                tracker.update(bad)
        self.assertEqual(tracker.update(image).box, self.started("kcf").update(image).box)

    def test_errors_of_a_call_do_not_print_the_image(self):
        tracker = self.started("kcf")
        objects = asterism.MultiTracker()
        image = self.frames[1]
        for call, error, message in [
            (lambda: tracker.init(image), TypeError, r"init\(\) misses argument 'box'"),
            (lambda: tracker.init(image, bbox=BOX), TypeError, r"init\(\) has no argument 'bbox'"),
            (lambda: tracker.init(image, BOX, BOX), TypeError, r"init\(\) takes 2 arguments, but 3 were given"),
            (lambda: tracker.init(image, BOX, image=image), TypeError, r"init\(\) got argument 'image' twice"),
            (lambda: tracker.init(BOX, image), TypeError, "image: expected a NumPy array, found tuple"),
            (lambda: tracker.init(image, image), ValueError, "the object: expected x, y, width, height"),
            (lambda: tracker.init(image, [image, 1]), ValueError, "the object: expected numbers or a mask, found list"),
            (lambda: tracker.init(image, object()), ValueError, "the object: expected "),
            (lambda: tracker.update(), TypeError, r"update\(\) misses argument 'image'"),
            (lambda: tracker.update(image, BOX), TypeError, r"update\(\) takes 1 argument, but 2 were given"),
            (lambda: objects.add("1", image, BOX), TypeError, r"add\(\) expected an integer as 'id', found str"),
            (lambda: objects.add(1.0, image, BOX), TypeError, r"add\(\) expected an integer as 'id', found float"),
            (lambda: objects.add(2**40, image, BOX), TypeError, r"add\(\) expected an integer as 'id', found int"),
            (lambda: objects.add(1, image), TypeError, r"add\(\) misses argument 'box'"),
            (lambda: objects.add(1, image, BOX, 7), TypeError, r"add\(\) expected a str as 'name', found int"),
            (lambda: objects.update(images=image), TypeError, r"update\(\) has no argument 'images'"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(error, message) as raised:
                call()
            self.assertLess(len(str(raised.exception)), 200)
        objects.add(np.int64(4), image=image, box=BOX, name="kcf")
        self.assertEqual(list(objects.update(image=image)), [4])

    def test_errors_have_the_librarys_words(self):
        with self.assertRaisesRegex(ValueError, "unknown tracker 'dbt', did you mean 'dpt'. .known: dpt, "):
            asterism.Tracker("dbt")
        with self.assertRaisesRegex(RuntimeError, "init"):
            asterism.Tracker("kcf").update(self.frames[0])
        with self.assertRaises(ValueError):
            asterism.Tracker("kcf").init(self.frames[0], (1000, 1000, 10, 10))
        with self.assertRaises(ValueError):
            asterism.Tracker("kcf").init(self.frames[0], (10, 10, math.nan, 10))
        with self.assertRaisesRegex(TypeError, r"^Tracker\(\) has no option 'grid': those of the tracker itself are given as options={...}"):
            asterism.Tracker("dpt", grid=3)
        with self.assertRaisesRegex(TypeError, "options: expected a dict or None"):
            asterism.Tracker("dpt", [("grid_rows", 3)])

    @unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
    def test_options(self):
        tracker = self.started("dpt", {"grid_rows": 3, "part": {"model": "mosse"}})
        self.assertEqual(len(tracker.update(self.frames[1]).parts), 6)
        with self.assertRaisesRegex(ValueError, "unknown option 'grid_row'.*'grid_rows'"):
            asterism.Tracker("dpt", {"grid_row": 3})

    @unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
    def test_all_options_of_a_tracker(self):
        options = asterism.tracker_options()
        self.assertEqual((options["grid_rows"], options["part"]["model"]), (2, "kcf"))
        self.assertEqual(options, asterism.Tracker().options())
        self.assertNotIn("tracker", options)
        for name, given in (("dpt_plus", None), ("kcf", {"use_color": True, "redetect": True}), ("kalman", {"of": "coarse"})):
            with self.subTest(name):
                tracker = self.started(name, given)
                self.assertEqual(tracker.options(), asterism.tracker_options(name, given))
                again = self.started(name, tracker.options())
                self.assertEqual(again.options(), tracker.options())
                self.assertEqual(boxes(follow(again, self.frames[1:3])), boxes(follow(tracker, self.frames[1:3])))
        self.assertEqual(asterism.Tracker("dpt+mosse").options()["part"], {"model": "mosse", **asterism.part_options("mosse")})
        self.assertEqual(asterism.tracker_options("dpt", {"grid_rows": 3})["grid_rows"], 3)
        self.assertIn("kcf", asterism.part_names())
        for bad in ("dtp", 'dpt{"grid_row": 3}'):
            with self.assertRaises(ValueError):
                asterism.tracker_options(bad)
        with self.assertRaisesRegex(ValueError, "kcf"):
            asterism.part_options("kfc")

    @unittest.skipUnless(hasattr(asterism, "read_systems"), "built without nlohmann-json")
    def test_options_of_every_kind_of_number(self):
        part = {"model": "kcf", "separate_update": np.bool_(False), "lambda": np.float32(0.5)}
        options = {"grid_rows": np.int64(3), "grid_cols": np.array(2), "overlap": np.float32(0.5), "part": part}
        plain_part = {"model": "kcf", "separate_update": False, "lambda": 0.5}
        plain = {"grid_rows": 3, "grid_cols": 2, "overlap": 0.5, "part": plain_part}
        found, expected = (follow(self.started("dpt", o), self.frames[1:4]) for o in (options, plain))
        self.assertEqual(boxes(found), boxes(expected))
        for bad, error, message in [
            ({"grid_rows": np.float32(2.5)}, ValueError, "grid_rows"),
            ({"grid_rows": np.bool_(True)}, ValueError, "grid_rows"),
            ({"overlap": math.nan}, ValueError, "options: expected finite numbers"),
            ({"overlap": np.float32(math.nan)}, ValueError, ""),
            ({"overlap": np.array([0.5])}, TypeError, "options: expected numbers, bools, names and dicts, found array"),
            ({"overlap": 1j}, TypeError, "options: expected numbers"),
            ({"overlap": 2}, ValueError, r"overlap must be in \[0, 0.99\], is 2"),
        ]:
            with self.subTest(repr(bad)), self.assertRaisesRegex(error, message):
                asterism.Tracker("dpt", bad)

    def test_a_result_is_true_where_the_object_is_not_lost(self):
        tracker = self.started("kcf")
        found, lost = tracker.update(self.frames[1]), tracker.update(np.zeros_like(self.frames[0]))
        self.assertEqual((bool(found), found.lost), (True, False))
        self.assertEqual((bool(lost), lost.lost), (False, True))

    def test_smooths_a_track_after_the_fact(self):
        results = follow(self.started(), self.frames[1:])
        smoothed = asterism.smooth_track(BOX, results, self.frames[0].shape)
        self.assertEqual(len(smoothed), len(results))

        def jitter(some):
            return np.abs(np.diff([BOX, *boxes(some)], 2, axis=0)).sum()

        self.assertLess(jitter(smoothed), jitter(results))
        self.assertEqual([r.confidence for r in smoothed], [r.confidence for r in results])
        self.assertEqual(smoothed[3].covariance.shape, (3, 3))
        self.assertEqual(asterism.smooth_track(BOX, []), [])
        for arguments, reason in (((BOX, results, (0, 3)), "shape"), (((1, 2, -3, 4), results), "width"), (((1, 2, 3), results), "object")):
            with self.assertRaisesRegex(ValueError, reason):
                asterism.smooth_track(*arguments)
        if TRACK:  # the same as asterism-track --smooth
            with tempfile.TemporaryDirectory() as folder:
                for i, frame in enumerate(self.frames):
                    write_png(pathlib.Path(folder) / f"{i:04}.png", frame)
                command = [TRACK, folder, "--box", ",".join(map(str, BOX)), "--tracker", "dpt", "--smooth", "--out", "-"]
                csv = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            expected = [line.split(",")[1:5] for line in csv.splitlines()[2:]]
            self.assertEqual([[f"{number:.4f}" for number in box] for box in boxes(smoothed)], expected)

    def test_goes_on_from_a_saved_state(self):
        tracker = self.started()
        follow(tracker, self.frames[1:5])
        state = tracker.save()
        self.assertIsInstance(state, bytes)
        expected = boxes(follow(tracker, self.frames[5:]))
        later = asterism.Tracker("dpt")
        later.restore(state)
        self.assertEqual(boxes(follow(later, self.frames[5:])), expected)
        with self.assertRaises(RuntimeError):
            later.restore(state[:-1])
        with self.assertRaises(ValueError):
            asterism.Tracker("kcf").restore(state)

    def test_several_objects_are_tracked_as_alone(self):
        several = asterism.MultiTracker(threads=2)
        several.add(7, self.frames[0], BOX)
        several.add(3, self.frames[0], (200, 150, 50, 40), name="kcf")
        self.assertEqual(len(several), 2)
        alone = self.started(asterism.Tracker().name)
        for frame in self.frames[1:]:
            results = several.update(frame)
            self.assertEqual(list(results), [3, 7])
            self.assertEqual(results[7].box, alone.update(frame).box)
        with self.assertRaisesRegex(ValueError, "7"):
            several.add(7, self.frames[0], BOX)
        self.assertTrue(several.remove(3))
        self.assertFalse(several.remove(3))

    def test_a_tracker_is_for_one_thread_at_a_time(self):
        tracker = self.started()
        stop = threading.Event()
        errors = []

        def update():
            while not stop.is_set():
                try:
                    tracker.update(self.frames[0])
                except RuntimeError as error:
                    errors.append(str(error))
                    stop.set()

        threads = [threading.Thread(target=update) for _ in range(2)]
        for thread in threads:
            thread.start()
        stop.wait(30)
        stop.set()
        for thread in threads:
            thread.join()
        self.assertIn("this asterism.Tracker is in use by another thread", errors)


if __name__ == "__main__":
    unittest.main()
