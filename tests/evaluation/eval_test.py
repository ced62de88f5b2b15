#!/usr/bin/env python3
"""asterism-eval as a user runs it: eval_test.py EXECUTABLE [MPIEXEC]. Standard library alone."""

import json
import pathlib
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

EXECUTABLE = sys.argv[1]
MPIEXEC = sys.argv[2] if len(sys.argv) > 2 else None
WIDTH, HEIGHT, FRAMES = 160, 120, 40


def png(path, pixels):
    """pixels: rows of bytes, three a pixel."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    raw = b"".join(b"\0" + row for row in pixels)
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw, 1)) +
                     chunk(b"IEND", b""))


def make_sequence(folder, seed, frames=FRAMES):
    """A textured square that moves over a dark texture."""
    rng = random.Random(seed)
    background = [bytes(rng.randrange(80) for _ in range(3 * WIDTH)) for _ in range(HEIGHT)]
    blocks = [[bytes(rng.randrange(100, 256) for _ in range(3)) for _ in range(8)] for _ in range(8)]
    (folder / "color").mkdir(parents=True)
    truth = []
    for t in range(frames):
        x, y = 30 + t, 40 + t // 3
        rows = list(background)
        for r in range(32):
            row = b"".join(blocks[r // 4][c // 4] for c in range(32))
            rows[y + r] = rows[y + r][:3 * x] + row + rows[y + r][3 * (x + 32):]
        png(folder / "color" / f"{t + 1:08}.png", rows)
        truth.append(f"{x},{y},32,32")
    (folder / "groundtruth.txt").write_text("\n".join(truth) + "\n")


def run(*arguments, launcher=()):
    return subprocess.run([*launcher, EXECUTABLE, *map(str, arguments)], capture_output=True, text=True, timeout=600)


class Evaluation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.scratch.name)
        for name, seed in (("first", 1), ("second", 2), ("third", 3)):
            make_sequence(cls.root / "data" / name, seed)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.out = pathlib.Path(scratch.name) / "out"

    def evaluate(self, *arguments, out=None, data="data", trackers=("--trackers", "kcf"), launcher=()):
        return run("run", self.root / data, *trackers, "--out", out or self.out, *arguments, launcher=launcher)

    def results(self, out=None):
        """All results but for times, by their paths."""
        folder = (out or self.out) / "results"
        return {str(f.relative_to(folder)): f.read_text() for f in sorted(folder.rglob("*.txt"))}

    def test_layout_is_that_of_the_vot_toolkit(self):
        done = self.evaluate("--starts", 2)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("12 runs made, 0 were there", done.stderr)
        names = set(self.results())
        self.assertIn("kcf/baseline/first/first_001.txt", names)
        self.assertIn("kcf/unsupervised/third/third_002.txt", names)
        self.assertEqual(len(names), 12)
        lines = self.results()["kcf/baseline/second/second_001.txt"].splitlines()
        self.assertEqual(len(lines), FRAMES)
        self.assertEqual(lines[0], "1")
        self.assertEqual(len(lines[1].split(",")), 4)
        times = (self.out / "results/kcf/baseline/second/second_001_time.value").read_text().splitlines()
        self.assertEqual(len(times), FRAMES)
        self.assertTrue(all(float(t) > 0 for t in times))

    def test_workers_and_order_do_not_matter(self):
        self.assertEqual(self.evaluate("--workers", 1, "--protocol", "vot,otb,tre,sre,multistart").returncode, 0)
        other = self.out.with_name("other")
        self.assertEqual(self.evaluate("--workers", 5, "--protocol", "multistart,sre,tre,otb,vot",
                                       out=other).returncode, 0)
        self.assertGreater(len(self.results()), 3 * (1 + 1 + 12))
        self.assertEqual(self.results(), self.results(other))

    def test_what_is_there_is_not_run_again(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        times = {f: f.read_text() for f in self.out.rglob("*.value")}
        again = self.evaluate("--trackers", "kcf", "--starts", 2)
        self.assertIn("10 runs made, 2 were there", again.stderr)
        for file, text in times.items():
            self.assertEqual(file.read_text(), text)

    def test_interruption_loses_and_repeats_nothing(self):
        whole = self.out.with_name("whole")
        self.assertEqual(self.evaluate("--starts", 8, "--trackers", "dpt", out=whole).returncode, 0)
        command = [EXECUTABLE, "run", self.root / "data", "--trackers", "kcf,dpt", "--starts", "8", "--workers", "2",
                   "--out", self.out]
        stopped = 0
        pause = 0.3  # longer each time: on a slow machine nothing is whole at first
        while stopped < 5 and pause < 60:
            process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
            time.sleep(pause)
            pause *= 1.2
            process.send_signal(signal.SIGTERM)
            message = process.communicate(timeout=60)[1]
            if process.returncode == 0 or (process.returncode == -signal.SIGTERM and not message):
                continue  # it had ended, or not begun
            self.assertEqual(process.returncode, 128 + signal.SIGTERM, message)
            self.assertIn("interrupted", message)
            self.assertFalse(list(self.out.rglob(".*")), "left half a file")
            stopped += 1
            if self.results() == self.results(whole):
                break
        self.assertGreater(stopped, 0)
        self.assertEqual(run(*command[1:]).returncode, 0)
        self.assertEqual(self.results(), self.results(whole))

    def test_results_that_would_not_fit_together_are_refused(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        before = (self.out / "campaign.json").read_text()
        for arguments, words in [(("--boxes",), "boxes"), (("--seed", 2), "seed"), (("--overlap", "exact"), "overlap")]:
            refused = self.evaluate(*arguments)
            self.assertEqual(refused.returncode, 1)
            self.assertIn(words, refused.stderr)
        make_sequence(self.root / "moved" / "first", 9, frames=10)
        refused = self.evaluate(data="moved")
        self.assertEqual(refused.returncode, 1)
        self.assertIn("sequence first", refused.stderr)
        self.assertEqual((self.out / "campaign.json").read_text(), before)

    def test_a_tracker_that_dies_costs_its_run_alone(self):
        command = "dies=exit 3"
        done = self.evaluate("--external", command)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("trackers threw in 6", done.stderr)
        log = (self.out / "results/dies/baseline/first/first_001_errors.log").read_text()
        self.assertTrue(log.startswith("frame 1: "), log)
        lines = self.results()["dies/baseline/first/first_001.txt"].split()
        self.assertEqual(lines[:6], ["2", "0", "0", "0", "0", "2"])
        self.assertIn("kcf/baseline/third/third_001.txt", self.results())

    def test_problems_are_one_line(self):
        for arguments, words in [
            (("run", self.root / "nothing", "--trackers", "kcf", "--out", self.out), "nothing"),
            (("run", self.root / "data", "--trackers", "kfc", "--out", self.out), "unknown tracker"),
            (("run", self.root / "data", "--out", self.out), "no tracker"),
            (("run", self.root / "data", "--trackers", "kcf", "--protocol", "vott", "--out", self.out), "vott"),
            (("run", self.root / "data", "--external", "a/b=true", "--out", self.out), "a/b"),
            (("run", self.root / "data", "--external", "true", "--out", self.out), "NAME=COMMAND"),
            (("run", self.root / "data", "--trackers", "kcf", "--out", "/proc/none"), "/proc/none"),
            ((), "subcommand"),
        ]:
            result = run(*arguments)
            self.assertNotEqual(result.returncode, 0, arguments)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            self.assertIn(words, result.stderr)
            self.assertFalse((self.out / "results").exists())

    def test_damaged_campaigns_are_named(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        for text in ("{", "[]", '{"dataset": 3}'):
            (self.out / "campaign.json").write_text(text)
            result = self.evaluate()
            self.assertEqual(result.returncode, 1)
            self.assertIn("campaign.json", result.stderr)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)

    @unittest.skipIf(MPIEXEC is None, "built without MPI")
    def test_processes_share_the_runs(self):
        self.assertEqual(self.evaluate("--starts", 2).returncode, 0)
        other = self.out.with_name("other")
        shared = self.evaluate("--starts", 2, out=other, launcher=[MPIEXEC, "--allow-run-as-root", "--oversubscribe",
                                                                   "-n", "3"])
        self.assertEqual(shared.returncode, 0, shared.stderr)
        self.assertEqual(self.results(), self.results(other))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
