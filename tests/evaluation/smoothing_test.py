#!/usr/bin/env python3
"""smoothing.py, which runs asterism-track with and without --smooth: smoothing_test.py SCRIPT. Ends with 77 without NumPy."""

import unittest

from script_case import ScriptCase

# Follows an object of 20 x 20 px that moves by 1 px a frame, and shakes by 1 px up and down without --smooth. Notes its first boxes.
PROGRAM = """#!/usr/bin/env python3
import pathlib, sys
arguments = dict(zip(sys.argv[2::2], sys.argv[3::2]))
box = next(a for a in sys.argv if a.startswith("--box="))
with open(pathlib.Path(sys.argv[0]).parent / "boxes", "a") as file:
    file.write(box[6:] + "\\n")
if sys.argv[1].endswith("broken"):
    sys.exit("asterism-track: no frames")
shake = 0 if "--smooth" in sys.argv else 1
rows = [f"{t + 1},{t},{(t % 2) * shake},20,20,1,0,1.0," for t in range(10)]
pathlib.Path(arguments["--out"]).write_text("\\n".join(["frame,x,y,width,height,confidence,lost,milliseconds,probability", *rows]) + "\\n")
"""


class SmoothingTest(ScriptCase):
    def setUp(self):
        super().setUp()
        (self.root / "program").write_text(PROGRAM)
        (self.root / "program").chmod(0o755)
        (self.root / "folds").write_text("0\tbox\n0\tpolygon\n1\tbroken\n")
        boxes = "".join(f"{t},0,20,20\n" for t in range(10))
        polygons = "".join(f"{t},0,{t + 20},0,{t + 20},20,{t},20\n" for t in range(10))
        for name, truth in {"box": boxes, "polygon": polygons, "broken": boxes}.items():
            (self.root / "data" / name).mkdir(parents=True)
            (self.root / "data" / name / "groundtruth.txt").write_text(truth)

    def run_on(self, *options):
        return self.run_script(self.root / "program", self.root / "data", self.root / "out", "--folds", self.root / "folds", *options)

    def test_jitter_and_results(self):
        done = self.run_on("--of", "0", "--trackers", "dpt", "--starts", "2")
        self.assertEqual(done.returncode, 0, done.stderr)
        # |0 - 2 + 0| / 20 in every frame, and nothing in the annotation.
        self.assertEqual(done.stdout.splitlines()[2:], ["| `dpt` | 0.0000 | 0.1000 | 0.0000 | 0.00 (0.00 to 0.00) |"])
        run = (self.root / "out/results/dpt-track/unsupervised/box/box_002.txt").read_text().splitlines()
        self.assertEqual(run[:3], ["1", "1.0000,1.0000,20.0000,20.0000", "2.0000,0.0000,20.0000,20.0000"])
        self.assertTrue((self.root / "out/results/dpt-smooth/unsupervised/polygon/polygon_001.txt").exists())
        # The second start is moved by the first two numbers of std::mt19937(1), 1791095845 and 4282876139.
        starts = [[float(v) for v in line.split(",")] for line in (self.root / "boxes").read_text().split()]
        x, y = 1791095845 / 2**31 - 1, 4282876139 / 2**31 - 1
        self.assertEqual(starts[0], [0, 0, 20, 20])
        self.assertEqual(starts[2], [x, y, 20, 20])
        self.assertEqual(starts[6], [x, y, x + 20, y, x + 20, y + 20, x, y + 20])
        # Runs that are there are kept.
        self.assertEqual(self.run_on("--of", "0", "--trackers", "dpt", "--starts", "2").stdout, done.stdout)
        self.assertEqual(len((self.root / "boxes").read_text().split()), 8)

    def test_errors(self):
        for options, reason in ((["--of", "1"], "asterism-track: no frames"), (["--of", "7"], "has no fold 7")):
            done = self.run_on(*options)
            self.assertEqual(done.returncode, 1)
            self.assertIn(reason, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1)

    def test_damaged_files(self):
        truth = self.root / "data/box/groundtruth.txt"
        for text, reason in (
            ("0,0,20,20\n0,zero,20,20\n", "groundtruth.txt:2: not numbers"),
            ("0,0,20\n", "groundtruth.txt:1: neither"),
            ("", "no annotation"),
        ):
            truth.write_text(text)
            done = self.run_on("--of", "0")
            self.assertEqual(done.returncode, 1)
            self.assertIn(reason, done.stderr)
            self.assertEqual(len(done.stderr.splitlines()), 1)
        truth.write_text("0,0,20,20\n")
        kept = self.root / "out/results/dpt-track/unsupervised/box/box_001.txt"
        kept.parent.mkdir(parents=True)
        kept.write_text("1\n1,2,3\n1,2,3,4\n")
        done = self.run_on("--of", "0", "--trackers", "dpt")
        self.assertEqual(done.returncode, 1)
        self.assertIn("box_001.txt: damaged", done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1)


if __name__ == "__main__":
    unittest.main()
