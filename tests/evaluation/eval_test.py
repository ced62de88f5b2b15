#!/usr/bin/env python3
"""asterism-eval as a user runs it: eval_test.py EXECUTABLE [MPIEXEC]. Standard library alone."""

import csv
import html.parser
import json
import math
import os
import pathlib
import re
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

from synthetic import FRAMES, HEIGHT, WIDTH, make_sequence, png

EXECUTABLE = sys.argv[1]
MPIEXEC = sys.argv[2] if len(sys.argv) > 2 else None


# A TraX tracker that answers the start with the start box, and later frames according to its mode.
TRACKER = """
import os, re, sys, time
mode, number = sys.argv[1], 0
print('@@TRAX:hello "trax.version=3" "trax.image=path;" "trax.region=rectangle;" "trax.channels=color;"', flush=True)
for line in sys.stdin:
    if line.startswith('@@TRAX:quit'):
        break
    arguments = re.findall('"([^"]*)"', line)
    number += 1
    if line.startswith('@@TRAX:initialize'):
        box, number = arguments[1], 0
    if mode == 'dies' and number == 1:
        sys.exit(3)
    if mode == 'wild' and number % 2:
        print('@@TRAX:state "900000,900000,10,10"', flush=True)
        continue
    if mode.startswith('slow:') and number == 5 and not os.path.exists(mode[5:]):
        open(mode[5:], 'w').close()
        time.sleep(60)
    print(f'@@TRAX:state "{box}"', flush=True)
"""


def tracker(name, mode):
    """--external's argument for it."""
    return f"{name}={sys.executable} -c '{TRACKER.replace(chr(39), chr(39) + chr(92) + chr(39) + chr(39))}' {mode}"


def run(*arguments, launcher=(), file_limit=None):
    """file_limit: bytes a file may have; like on a full disk, writing more fails."""
    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))
    return subprocess.run([*launcher, EXECUTABLE, *map(str, arguments)], capture_output=True, text=True, timeout=600,
                          preexec_fn=limit if file_limit else None)


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

    def evaluate(self, *arguments, out=None, data="data", trackers=("--trackers", "kcf"), **how):
        return run("run", self.root / data, *trackers, "--out", out or self.out, *arguments, **how)

    def results(self, out=None):
        """All results but for times, by their paths."""
        folder = (out or self.out) / "results"
        return {str(f.relative_to(folder)): f.read_text() for f in sorted(folder.rglob("*.txt"))}

    def test_layout_is_that_of_the_vot_toolkit(self):
        done = self.evaluate("--starts", 2)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("12 runs made, 0 stored before", done.stderr)
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

    def test_images_that_are_compressed_again(self):
        for quality, arguments in ((0, ()), (5, ("--jpeg", 5))):
            out = self.out.with_name(f"jpeg{quality}")
            self.assertEqual(self.evaluate("--sequences", "first", *arguments, out=out).returncode, 0)
            self.assertEqual(run("report", out).returncode, 0)
        self.assertNotEqual(self.results(self.out.with_name("jpeg0")), self.results(self.out.with_name("jpeg5")))

    def test_what_is_there_is_not_run_again(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        times = {f: f.read_text() for f in self.out.rglob("*.value")}
        again = self.evaluate("--trackers", "kcf", "--starts", 2)
        self.assertIn("10 runs made, 2 stored before", again.stderr)
        for file, text in times.items():
            self.assertEqual(file.read_text(), text)

    def test_interruption_loses_and_repeats_nothing(self):
        whole = self.out.with_name("whole")
        self.assertEqual(self.evaluate("--starts", 8, "--trackers", "dpt", out=whole).returncode, 0)
        command = [EXECUTABLE, "run", self.root / "data", "--trackers", "kcf,dpt", "--starts", "8", "--workers", "2",
                   "--out", self.out]
        stopped = 0
        pause = 0.3  # grows: on a slow machine nothing is complete at first
        for _ in range(30):
            process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
            time.sleep(pause)
            process.send_signal(signal.SIGTERM)
            message = process.communicate(timeout=60)[1]
            if process.returncode == 0 and stopped == 0:  # it finished: try again with less time
                shutil.rmtree(self.out)
                pause /= 2
                continue
            if process.returncode == 0:
                break
            pause *= 1.2
            if process.returncode == -signal.SIGTERM and not message:
                continue  # it had not started
            self.assertEqual(process.returncode, 128 + signal.SIGTERM, message)
            self.assertIn("interrupted", message)
            self.assertFalse(list(self.out.rglob(".*")), "left half a file")
            stopped += 1
            if stopped == 5 or self.results() == self.results(whole):
                break
        self.assertGreater(stopped, 0)
        self.assertEqual(run(*command[1:]).returncode, 0)
        self.assertEqual(self.results(), self.results(whole))

    def test_a_killed_run_loses_nothing(self):
        whole = self.out.with_name("whole")
        self.assertEqual(self.evaluate("--starts", 8, out=whole).returncode, 0)
        command = [EXECUTABLE, "run", self.root / "data", "--trackers", "kcf", "--starts", "8", "--out", self.out]
        for pause in (0.2, 0.5, 1):
            process = subprocess.Popen(list(map(str, command)), stderr=subprocess.DEVNULL)
            time.sleep(pause)
            process.kill()
            process.wait()
            for name, text in self.results().items():
                if not pathlib.Path(name).name.startswith("."):
                    self.assertEqual(text, self.results(whole)[name], name)
        self.assertEqual(run(*command[1:]).returncode, 0)
        self.assertEqual(self.results(), self.results(whole))

    def test_two_processes_may_share_a_folder(self):
        whole = self.out.with_name("whole")
        self.assertEqual(self.evaluate("--starts", 4, out=whole).returncode, 0)
        command = [EXECUTABLE, "run", self.root / "data", "--trackers", "kcf", "--starts", "4", "--out", self.out]
        processes = [subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True) for _ in range(2)]
        for process in processes:
            message = process.communicate(timeout=300)[1]
            self.assertEqual(process.returncode, 0, message)
        self.assertEqual(self.results(), self.results(whole))
        self.assertFalse(list(self.out.rglob(".*")), "left half a file")

    def test_two_processes_may_add_trackers(self):
        commands = [[EXECUTABLE, "run", self.root / "data", "--trackers", name, "--out", self.out]
                    for name in ("kcf", "coarse", "dpt", "dpt_loc")]
        processes = [subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
                     for command in commands]
        for process in processes:
            message = process.communicate(timeout=300)[1]
            self.assertEqual(process.returncode, 0, message)
        campaign = json.loads((self.out / "campaign.json").read_text())
        self.assertEqual(list(campaign["trackers"]), ["coarse", "dpt", "dpt_loc", "kcf"])
        self.assertEqual(len(campaign["record"]), 4)

    def test_a_full_disk_is_named_and_what_is_whole_stays(self):
        whole = self.out.with_name("whole")
        self.assertEqual(self.evaluate(out=whole).returncode, 0)
        room = (whole / "campaign.json").stat().st_size
        for limit in (room // 2, room, 10 * room):  # too small for the campaign, for the results, and large enough
            done = self.evaluate(file_limit=limit)
            if limit == 10 * room:
                self.assertEqual(done.returncode, 0, done.stderr)
                break
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertEqual(done.stderr.splitlines()[-1].count("File too large"), 1, done.stderr)
            self.assertFalse(list(self.out.rglob(".*")), "left half a file")
        self.assertEqual(self.results(), self.results(whole))

    def test_results_that_would_not_fit_together_are_refused(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        before = (self.out / "campaign.json").read_text()
        for arguments, words in [(("--boxes",), "boxes"), (("--seed", 2), "seed"), (("--overlap", "exact"), "overlap"),
                                 (("--bits", 8), "range"), (("--jpeg", 85), "jpeg")]:
            refused = self.evaluate(*arguments)
            self.assertEqual(refused.returncode, 1)
            self.assertIn(words, refused.stderr)
        make_sequence(self.root / "moved" / "first", 9, frames=10)
        refused = self.evaluate(data="moved")
        self.assertEqual(refused.returncode, 1)
        self.assertIn("sequence first", refused.stderr)
        self.assertEqual((self.out / "campaign.json").read_text(), before)

    def test_sequences_that_cannot_be_read_have_no_score(self):
        data = self.out.with_name("data")
        for name in ("first", "second"):
            shutil.copytree(self.root / "data" / name, data / name)
        images = sorted((data / "first/color").iterdir())
        whole = {image: image.read_bytes() for image in images}
        alone = self.out.with_name("alone")
        self.assertEqual(self.evaluate("--sequences", "second", out=alone).returncode, 0)
        self.assertEqual(run("report", alone).returncode, 0)
        wanted = json.loads((alone / "report/report.json").read_text())["trackers"][0]
        # The first image, where a track starts, one in the middle, and all; cut short, empty, and no image.
        for number, (damaged, content) in enumerate([(images[:1], 5000), (images[20:21], 0), (images, 3000),
                                                     (images[30:31], None)]):
            for image in images:
                image.write_bytes(whole[image])
            for image in damaged:
                image.write_bytes(b"no image" if content is None else whole[image][:content])
            out = self.out.with_name(f"out{number}")
            done = run("run", data, "--trackers", "kcf", "--out", out)
            self.assertEqual(done.returncode, 0, done.stderr)
            line = f"first cannot be read and has no score: {damaged[0]}: "
            self.assertIn(line, done.stderr)
            self.assertFalse(list(out.glob("results/kcf/*/first/*.txt")))
            report = run("report", out)
            self.assertEqual(report.returncode, 0, report.stderr)
            self.assertIn(line, report.stderr)
            self.assertIn("first cannot be read and has no score", (out / "report/report.html").read_text())
            scores = json.loads((out / "report/report.json").read_text())["trackers"][0]
            for measures in ("vot", "otb", "sequences"):
                self.assertEqual(scores[measures], wanted[measures])
            self.assertIn("first cannot be read", run("report", out, "--sequences", "first").stderr + line)
            self.assertIn(line, run("export-frames", out, "--out", out / "frames.csv").stderr)
        # Fetched again, it is run and scored.
        for image in images:
            image.write_bytes(whole[image])
        done = run("run", data, "--trackers", "kcf", "--out", out)
        self.assertIn("2 runs made, 2 stored before", done.stderr)
        self.assertEqual(run("report", out).stderr, f"{out}/report/report.html has plots and intervals\n")
        scores = json.loads((out / "report/report.json").read_text())["trackers"][0]
        self.assertEqual(set(scores["sequences"]), {"first", "second"})

    def test_without_any_sequence_that_can_be_read_the_run_fails(self):
        make_sequence(self.root / "damaged" / "first", 9, frames=10)
        image = self.root / "damaged" / "first" / "color" / "00000004.png"
        image.write_bytes(image.read_bytes()[:5000])
        done = self.evaluate("--range", "0,200", data="damaged")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn(f"{image}: a damaged image", done.stderr)
        self.assertEqual(json.loads((self.out / "campaign.json").read_text())["options"]["range"], [0, 200])
        done = run("report", self.out)
        self.assertEqual(done.returncode, 1)
        self.assertIn(f"no sequence could be read: {image}", done.stderr)
        image.write_bytes(b"no image")
        done = self.evaluate("--range", "0,200", data="damaged", trackers=("--trackers", "coarse"))
        self.assertEqual(done.returncode, 1)
        self.assertIn(f"{image}: not an image of a known format", done.stderr)

    def test_short_sequences_have_no_figures_without_frames(self):
        data = self.out.with_name("data")
        make_sequence(data / "short", 3, frames=8)
        shutil.copytree(self.root / "data/first", data / "first")
        done = run("run", data, "--trackers", "kcf", "--protocol", "vot,otb,tre", "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        line = "short: no run of protocol tre, which needs 20 frames"
        self.assertIn(line, done.stderr)
        done = run("report", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(line, done.stderr)
        # The first ten frames from a start on do not count for accuracy.
        scores = json.loads((self.out / "report/report.json").read_text())["trackers"][0]["sequences"]
        self.assertIsNone(scores["short"]["A"])
        self.assertEqual(scores["short"]["F"], 0)
        self.assertGreater(scores["short"]["AO"], 0.5)
        self.assertGreater(scores["first"]["A"], 0.5)
        # A data set of such sequences alone has no accuracy, rather than 0.
        shutil.rmtree(data / "first")
        make_sequence(data / "other", 4, frames=8)
        out = self.out.with_name("alone")
        for arguments in (("run", data, "--trackers", "kcf", "--protocol", "vot", "--out", out), ("report", out)):
            done = run(*arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
        head, values = (line.split() for line in done.stdout.splitlines())
        self.assertNotIn("A", head)
        self.assertEqual(values[head.index("F")], "0.00")

    def test_frames_are_exported_for_trackers_with_confidences(self):
        both = ("--trackers", "kcf", "--external", tracker("stays", "stays"))
        done = self.evaluate("--sequences", "first", "--protocol", "otb", trackers=both)
        self.assertEqual(done.returncode, 0, done.stderr)
        frames = self.out / "frames.csv"
        refused = run("export-frames", self.out, "--out", frames)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("the tracker gives none: leave it out by --trackers", refused.stderr)
        self.assertNotIn("--rerun", refused.stderr)
        self.assertEqual(run("export-frames", self.out, "--out", frames, "--trackers", "kcf").returncode, 0)
        self.assertEqual(len(frames.read_text().splitlines()), FRAMES)
        for file in self.out.rglob("*_confidence.value"):
            file.unlink()
        refused = run("export-frames", self.out, "--out", frames, "--trackers", "kcf")
        self.assertIn("make it again with --rerun kcf", refused.stderr)

    def test_a_tracker_that_dies_costs_its_run_alone(self):
        done = self.evaluate("--external", tracker("dies", "dies"))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("trackers threw in 6", done.stderr)
        log = (self.out / "results/dies/baseline/first/first_001_errors.log").read_text()
        self.assertTrue(log.startswith("frame 2: "), log)
        lines = self.results()["dies/baseline/first/first_001.txt"].split()
        self.assertEqual(lines[:8], ["1", "2", "0", "0", "0", "0", "1", "2"])
        self.assertIn("kcf/baseline/third/third_001.txt", self.results())

    def test_a_tracker_that_cannot_be_used_ends_the_run(self):
        for command, words in (("python3 /nonexist.py", "exit code 2"), ("exit 3", "exit code 3"),
                               ("echo ready", "exit code 0 before its first answer; the command has to speak TraX"),
                               ("/no/such/program", "exit code 127"), ("echo ready; exec cat >/dev/null", "0.5 s"),
                               ("sleep 60", "0.5 s"), ("echo '@@TRAX:quit'", "quits"),
                               ("echo '@@TRAX:hello \"trax.version=9\"'", "unknown version")):
            begin = time.monotonic()
            done = self.evaluate("--external", f"my={command}", "--timeout", 0.5, "--sequences", "first",
                                 trackers=())
            self.assertEqual(done.returncode, 1, command)
            self.assertIn(f"tracker '{command}': ", done.stderr.splitlines()[-1])
            self.assertIn(words, done.stderr.splitlines()[-1])
            self.assertIn("before its first answer", done.stderr.splitlines()[-1])
            self.assertLess(time.monotonic() - begin, 20)
            self.assertFalse((self.out / "results/my").exists(), command)
        # With its command corrected it can use the same folder.
        done = self.evaluate("--external", tracker("my", "stays"), "--sequences", "first", trackers=())
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("2 runs made, 0 stored before", done.stderr)
        refused = self.evaluate("--external", "my=other", "--sequences", "first", trackers=())
        self.assertIn("choose another folder or --rerun my", refused.stderr)

    def test_slow_trackers_have_time_and_another_try(self):
        marker = self.out.with_name("marker")
        arguments = ("--external", tracker("slow", f"slow:{marker}"), "--sequences", "first", "--protocol", "otb",
                     "--timeout", 1)
        done = self.evaluate(*arguments, trackers=())
        self.assertIn("trackers threw in 1", done.stderr)
        log = self.out / "results/slow/unsupervised/first/first_001_errors.log"
        self.assertIn("does not reply in 1 s", log.read_text())
        marker.unlink()
        again = self.evaluate(*arguments, "--rerun", "slow", "--retries", 1, trackers=())
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn("1 run made, 0 stored before; asterism-eval report", again.stderr)
        self.assertFalse(log.exists())
        self.assertIn("--rerun other", self.evaluate("--rerun", "other").stderr)

    def test_wild_regions_cost_no_time(self):
        begin = time.monotonic()
        done = self.evaluate("--external", tracker("wild", "wild"), "--sequences", "first", trackers=())
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = ["1"] + ["0,0,1000000,1000000", "-5e5,-5e5,1e6,1e6", "1e300,1e300,1e300,1e300",
                         "-1000000,-1000000,1000000,-900000,0,1000000", "900000,900000,10,10"] * 8
        folder = self.out / "results/astray/baseline/first"
        folder.mkdir(parents=True)
        (folder / "first_001.txt").write_text("\n".join(lines[:FRAMES]) + "\n")
        done = run("report", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(time.monotonic() - begin, 120)

    def test_report_ends_at_the_first_signal(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        rng = random.Random(1)  # polygons that take seconds to compare
        lines = [",".join(f"{rng.random() * 2e5:.1f}" for _ in range(20000)) for _ in range(FRAMES - 1)]
        folder = self.out / "results/tangled/baseline/first"
        folder.mkdir(parents=True)
        (folder / "first_001.txt").write_text("\n".join(["1", *lines]) + "\n")
        for signum in (signal.SIGTERM, signal.SIGINT):
            report = subprocess.Popen([EXECUTABLE, "report", self.out], stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL)
            time.sleep(1)
            self.assertIsNone(report.poll(), "it has ended already")
            report.send_signal(signum)
            self.assertEqual(report.wait(timeout=20), -signum)

    def test_sequences_that_cannot_be_read_are_left_out_with_a_line(self):
        data = self.out.with_name("data")
        shutil.copytree(self.root / "data/first", data / "first")
        shutil.copytree(self.root / "data/first", data / os.fsdecode(b"s\xff"))
        (data / "first/occlusion.tag").write_text("1\n" * 5)
        (data / "third").mkdir()
        (data / "third/groundtruth.txt").write_text("1,1,10,20,30,40\n2,1,11,20,30,40\n")
        (data / "CLIP.MP4").write_bytes(b"")
        done = run("run", data, "--trackers", "kcf", "--protocol", "otb", "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        for words in ("s\\xFF: the name is not UTF-8", "lines of MOTChallenge", "CLIP.MP4: a video without CLIP.txt",
                      "5 values, but 40 frames", "1 run made"):
            self.assertIn(words, done.stderr)
        self.assertEqual(run("report", self.out).returncode, 0)
        self.assertIn("lines of MOTChallenge", (self.out / "report/report.html").read_text())
        refused = subprocess.run([os.fsencode(EXECUTABLE), b"run", os.fsencode(data) + b"/s\xff", b"--trackers", b"kcf",
                                  b"--out", os.fsencode(self.out)], capture_output=True)
        self.assertEqual(refused.returncode, 1)
        self.assertIn(b"s\\xFF: the path is not UTF-8", refused.stderr)

    def test_first_boxes_alone_are_no_overlap_of_zero(self):
        data = self.out.with_name("data")
        for name in ("first", "GOT-10k_Test_000001"):
            shutil.copytree(self.root / "data/first", data / name)
        (data / "GOT-10k_Test_000001/groundtruth.txt").write_text("30,40,32,32\n")
        for image in (data / "GOT-10k_Test_000001/color").iterdir():
            image.rename(data / "GOT-10k_Test_000001" / image.name)
        (data / "GOT-10k_Test_000001/color").rmdir()
        protocols = ("--protocol", "vot,otb,tre,sre,multistart")
        self.assertEqual(run("run", data, "--trackers", "kcf", *protocols, "--out", self.out).returncode, 0)
        alone = self.out.with_name("alone")
        self.assertEqual(run("run", data, "--trackers", "kcf", *protocols, "--sequences", "first", "--out",
                             alone).returncode, 0)
        both, one = run("report", self.out), run("report", alone)
        self.assertEqual(both.returncode, 0, both.stderr)
        without_speed = [[line.split()[:7] + line.split()[8:] for line in done.stdout.splitlines()]
                         for done in (both, one)]
        self.assertEqual(without_speed[0], without_speed[1])
        self.assertIn("GOT-10k_Test_000001: no ground truth after the first box", both.stderr)
        report = json.loads((self.out / "report/report.json").read_text())
        scores = report["trackers"][0]["sequences"]["GOT-10k_Test_000001"]
        self.assertEqual((scores["A"], scores["F"], scores["AO"]), (None, None, None))
        # A test set alone cannot be scored; its results go to a server.
        third = self.out.with_name("test")
        self.assertEqual(run("run", data, "--trackers", "kcf", "--protocol", "otb", "--starts", 2, "--sequences",
                             "GOT-10k_Test_000001", "--out", third).returncode, 0)
        nothing = run("report", third)
        self.assertEqual(nothing.returncode, 1)
        self.assertIn("export-got10k", nothing.stderr)
        export = self.out.with_name("export")
        done = run("export-got10k", third, "--out", export)
        self.assertEqual(done.returncode, 0, done.stderr)
        name = "GOT-10k_Test_000001"
        files = sorted(str(f.relative_to(export)) for f in export.rglob("*") if f.is_file())
        self.assertEqual(files, [f"kcf/{name}/{name}_{part}.txt" for part in ("001", "002", "time")])
        boxes = (export / files[0]).read_text().splitlines()
        self.assertEqual(len(boxes), FRAMES)
        self.assertEqual(boxes[0], "30.000,40.000,32.000,32.000")
        self.assertTrue(all(re.fullmatch(r"(-?\d+\.\d{3},?){4}", box) for box in boxes))
        times = (export / files[2]).read_text().splitlines()
        self.assertEqual(len(times), FRAMES)
        self.assertTrue(all(len(line.split(",")) == 2 and float(line.split(",")[0]) > 0 for line in times))
        self.assertIn("no tracker other", run("export-got10k", third, "--out", export, "--trackers", "other").stderr)

    def test_problems_are_one_line(self):
        for arguments, words in [
            (("run", self.root / "nothing", "--trackers", "kcf", "--out", self.out), "nothing"),
            (("run", self.root / "data", "--trackers", "kfc", "--out", self.out), "unknown tracker"),
            (("run", self.root / "data", "--out", self.out), "no tracker"),
            (("run", self.root / "data", "--trackers", "kcf", "--protocol", "vott", "--out", self.out), "vott"),
            (("run", self.root / "data", "--external", "a/b=true", "--out", self.out), "a/b"),
            (("run", self.root / "data", "--external", "true", "--out", self.out), "NAME=COMMAND"),
            (("run", self.root / "data", "--trackers", "kcf", "--out", "/proc/none"), "/proc/none"),
            (("run", self.root / "data", "--trackers", "kcf", "--out", __file__), "eval_test.py is a file, not a folder"),
            (("run", self.root / "data", "--trackers", "kcf", "--sequences", "nowhere", "--out", self.out), "no sequence 'nowhere'\n"),
            (("run", self.root / "data", "--trackers", "kcf", "--jitter", "nan", "--out", self.out), "--jitter"),
            ((), "subcommand"),
        ]:
            result = run(*arguments)
            self.assertNotEqual(result.returncode, 0, arguments)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            self.assertIn(words, result.stderr)
            self.assertFalse((self.out / "results").exists())

    def test_damaged_campaigns_are_named(self):
        self.assertEqual(self.evaluate("--sequences", "first").returncode, 0)
        whole = json.loads((self.out / "campaign.json").read_text())

        def changed(*path, to):
            text = json.loads(json.dumps(whole))
            place = text
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = to
            return json.dumps(text)

        deep = 100_000
        damaged = ["{", "[]", '{"dataset": 3}', "", "null", "[" * deep, "[" * deep + "]" * deep,
                   '{"a":' * deep + "1" + "}" * deep, changed("record", to=json.loads("[" * 80 + "]" * 80)),
                   json.dumps(whole)[:-1], json.dumps(whole) + "x"]
        for key, values in {"starts": (0, -1, 1000, 2000000000, 1e300, 1.5, "3", None, [1]),
                            "jitter": (-1, 1001, 1e300, "1", None), "seed": (-1, 2 ** 32, 1e300, 0.5, "x"), "jpeg": (0, 101, "85", 8.5),
                            "overlap": ("wrong", 3, None), "bounded": (1, "yes", None), "boxes": (0, [])}.items():
            damaged += [changed("options", key, to=value) for value in values]
        for key, values in {"dataset": (3, None), "layout": ("wrong", 1), "protocols": (["wrong"], 3, [3], {}),
                            "trackers": ({"../../etc": "kcf"}, {"": "kcf"}, {"a/b": "kcf"}, {"..": "kcf"}, {"x": 3}, [3]),
                            "sequences": ([], 3, None), "options": ([], 3),
                            "record": (3, {}, [3], [{"workers": -1}], [{"workers": 2.5}], [{"processes": 1e300}],
                                       [{"workers": "2"}], [{"command": 3}], [{"started": []}], [{"machine": 3}],
                                       [{"notes": [3]}], [{"notes": {"a": {}}}])}.items():
            damaged += [changed(key, to=value) for value in values]
        # Both commands read it by the same function; processes take a third of a second to start.
        for number, text in enumerate(damaged):
            (self.out / "campaign.json").write_text(text)
            result = self.evaluate() if number % 2 else run("report", self.out)
            self.assertEqual(result.returncode, 1, text[:300] + result.stderr)
            self.assertIn("campaign.json", result.stderr, text[:300])
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            self.assertLess(len(result.stderr), 1000)

    @unittest.skipIf(MPIEXEC is None, "built without MPI")
    def test_processes_share_the_runs(self):
        self.assertEqual(self.evaluate("--starts", 2).returncode, 0)
        other = self.out.with_name("other")
        shared = self.evaluate("--starts", 2, out=other, launcher=[MPIEXEC, "--allow-run-as-root", "--oversubscribe",
                                                                   "-n", "3"])
        self.assertEqual(shared.returncode, 0, shared.stderr)
        self.assertEqual(self.results(), self.results(other))


class Page(html.parser.HTMLParser):
    """Whether elements are closed in order, and what they refer to."""
    VOID = {"meta", "img", "br", "link", "hr"}

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.names, self.problems = [], [], set(), []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href", "data")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.names.add(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.problems.append((tag, self.getpos()))


def box_overlap(a, b):
    width = max(0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]))
    height = max(0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]))
    return width * height / (a[2] * a[3] + b[2] * b[3] - width * height)


class Report(unittest.TestCase):
    LENGTHS = {"first": 40, "second": 40, "third": 30}
    LOW, HIGH = 10, 25

    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.scratch.name)
        for seed, (name, length) in enumerate(cls.LENGTHS.items()):
            make_sequence(cls.root / "data" / name, seed + 1, length)
        (cls.root / "data/first/occlusion.tag").write_text("0\n" * 20 + "1\n" * 20)
        cls.out = cls.root / "out"
        done = run("run", cls.root / "data", "--trackers", "kcf,dpt", "--external", tracker("dies", "dies"), "--starts", 2,
                   "--overlap", "exact", "--protocol", "vot,otb,tre,sre,multistart", "--out", cls.out)
        assert done.returncode == 0, done.stderr
        # A tracker drawn by hand: it fails in frame 16 of the first sequence.
        for name, length in cls.LENGTHS.items():
            folder = cls.out / "results/drawn/baseline" / name
            folder.mkdir(parents=True)
            lines = [f"{30 + t},{40 + t // 3},32,{16 if t % 2 else 32}" for t in range(length)]
            lines[0] = "1"
            if name == "first":
                lines[15:21] = ["2", "0", "0", "0", "0", "1"]
            (folder / f"{name}_001.txt").write_text("\n".join(lines) + "\n")
        cls.done = run("report", cls.out, "--interval", f"{cls.LOW}:{cls.HIGH}", "--paper")
        assert cls.done.returncode == 0, cls.done.stderr
        cls.folder = cls.out / "report"
        cls.page = (cls.folder / "report.html").read_text()
        cls.json = json.loads((cls.folder / "report.json").read_text())
        cls.trackers = {tracker["name"]: tracker for tracker in cls.json["trackers"]}

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def rows(self, name):
        with open(self.folder / name, newline="") as file:
            return list(csv.DictReader(file))

    def truth(self, name):
        lines = (self.root / "data" / name / "groundtruth.txt").read_text().split()
        return [tuple(map(float, line.split(","))) for line in lines]

    def runs(self, tracker, experiment, name):
        """Overlaps and codes of each run: a number in [0, 1], or "1", "2", "0"."""
        result = []
        for file in sorted((self.out / "results" / tracker / experiment / name).glob(f"{name}_???.txt")):
            lines = file.read_text().split()
            result.append([line if "," not in line else box_overlap(tuple(map(float, line.split(","))), truth)
                           for line, truth in zip(lines, self.truth(name), strict=True)])
        return result

    def test_page_is_whole_and_refers_to_nothing_outside(self):
        page = Page(self.page)
        self.assertEqual((page.problems, page.open), ([], []))
        self.assertNotIn("script", page.names)
        self.assertGreater(sum(r.startswith("data:image/jpeg;base64,") for r in page.references), 2)
        self.assertEqual([r for r in page.references if not r.startswith("data:")], [])
        self.assertNotIn("url(", self.page)
        self.assertNotIn("@import", self.page)
        self.assertEqual(set(re.findall(r"https?://[^\"<\s]*", self.page)), {"http://www.w3.org/2000/svg"})
        for text in ("kcf", "dies threw in", "drawn: results of another origin", "Not significant in EAO", "(printed)",
                     "not measured here", f"{self.LOW} to {self.HIGH} frames", "exact", "occlusion"):
            self.assertIn(text, self.page)

    def test_charts_are_well_formed(self):
        charts = re.findall(r"<svg.*?</svg>", self.page, re.DOTALL)
        self.assertGreater(len(charts), 14)
        titles = [xml.etree.ElementTree.fromstring(chart).get("aria-label") for chart in charts]
        for title in ("AR plot (legacy toolkit)", "AR ranks on all frames", "AR ranks, mean over attributes (VOT2014)",
                      "EAO ranking (legacy toolkit)", "Success: one pass (OPE)", "Frames per second", "third"):
            self.assertIn(title, titles)
        self.assertFalse(re.search(r"\b(nan|inf)\b", " ".join(charts)))

    def test_charts_are_files_too(self):
        files = {f.name: xml.etree.ElementTree.parse(f).getroot() for f in (self.folder / "charts").iterdir()}
        for name in ("ar-plot-legacy-toolkit.svg", "success-one-pass-ope.svg", "frames-per-second.svg"):
            self.assertIn(".plot", files[name].find("{http://www.w3.org/2000/svg}style").text)
        self.assertNotIn("third.svg", files)  # only for a sequence

    def test_csv_says_what_json_says(self):
        summary = self.rows("summary.csv")
        self.assertEqual([row["tracker"] for row in summary], list(self.trackers))
        for row in summary:
            tracker = self.trackers[row["tracker"]]
            for measure in ("EAO", "A", "F"):
                self.assertEqual(float(row[measure]), tracker["vot"][measure])
                self.assertEqual([float(row[measure + " low"]), float(row[measure + " high"])],
                                 tracker["intervals"][measure])
            if "otb" in tracker:
                self.assertEqual(float(row["AUC"]), tracker["otb"]["AUC"])
                self.assertEqual(float(row["MS EAO"]), tracker["multistart"]["EAO"])
            else:
                self.assertEqual(row["AUC"], "")
        for row in self.rows("sequences.csv"):
            scores = self.trackers[row["tracker"]]["sequences"][row["sequence"]]
            for measure in ("A", "AO"):
                self.assertEqual(row[measure], "" if scores[measure] is None else repr(scores[measure]))
        for row in self.rows("attributes.csv"):
            self.assertEqual(float(row["F"]), self.trackers[row["tracker"]]["vot"]["attributes"][row["attribute"]]["F"])
        differences = [[d["measure"], d["a"], d["b"], d["value"]] for d in self.json["differences"]]
        self.assertEqual([[r["measure"], r["a"], r["b"], float(r["value"])] for r in self.rows("differences.csv")],
                         differences)
        self.assertEqual(len(differences), 3 * 6 + 3)
        self.assertFalse(any(d["significant"] for d in self.json["differences"]), "of three sequences")
        curve = [float(row["y"]) for row in self.rows("curves.csv")
                 if (row["tracker"], row["curve"]) == ("kcf", "otb success")]
        self.assertEqual(curve, self.trackers["kcf"]["otb"]["success"])

    def test_supervised_figures_are_those_of_the_stored_results(self):
        for tracker, scores in self.trackers.items():
            accuracies, failures = [], 0
            totals, weights = [0] * 41, [0] * 41  # for each length
            for name, length in self.LENGTHS.items():
                runs = self.runs(tracker, "baseline", name)
                counted = [[] for _ in range(length)]
                for codes in runs:
                    start = -10
                    for t, value in enumerate(codes):
                        start = t if value == "1" else start
                        if isinstance(value, float) and t >= start + 10:
                            counted[t].append(value)
                    failures += codes.count("2") / len(runs)
                    starts = [0] + [t for t, value in enumerate(codes) if value == "1" and t > 0]
                    for begin, end in zip(starts, starts[1:] + [None]):
                        part = codes[begin:] if end is None else codes[begin:end + 1]
                        values = [value if isinstance(value, float) else 0 for value in part]
                        if end is not None:
                            values += [0] * 40
                        for n in range(2, min(len(values), 40) + 1):
                            totals[n] += sum(values[1:n]) / (n - 1) / len(runs)
                            weights[n] += 1 / len(runs)
                accuracies += [sum(values) / len(values) for values in counted if values]
            accuracy = sum(accuracies) / len(accuracies) if accuracies else 0
            self.assertAlmostEqual(scores["vot"]["A"], accuracy, 9, tracker)
            self.assertAlmostEqual(scores["vot"]["F"], failures, 9, tracker)
            self.assertAlmostEqual(scores["vot"]["AR"], math.exp(-30 * failures / sum(self.LENGTHS.values())), 9)
            curve = [totals[n] / weights[n] for n in range(self.LOW, self.HIGH + 1)]
            self.assertAlmostEqual(scores["vot"]["EAO"], sum(curve) / len(curve), 9, tracker)
        self.assertEqual(self.trackers["drawn"]["vot"]["F"], 1)
        self.assertEqual(self.trackers["dies"]["vot"]["A"], 0)

    def test_one_pass_figures_are_those_of_the_stored_results(self):
        for tracker, scores in self.trackers.items():
            if tracker == "drawn":
                self.assertNotIn("otb", scores)
                continue
            overlap = area = 0
            for name in self.LENGTHS:
                truth = self.truth(name)[0]
                values, first = [], []
                for file in sorted((self.out / "results" / tracker / "unsupervised" / name).glob(f"{name}_???.txt")):
                    box = truth  # invalid boxes repeat the previous one
                    lines = file.read_text().split()
                    alive = lines[0] != "2"  # from an error on, nothing is found
                    first.append(int(alive))
                    for line, now in list(zip(lines, self.truth(name)))[1:]:
                        box = tuple(map(float, line.split(","))) if "," in line else box
                        alive = alive and line != "2"
                        values.append(box_overlap(box, now) if alive else 0)
                overlap += sum(values) / len(values) / 3
                area += sum(math.ceil(20 * value - 1e-9) / 21 for value in values + first) / len(values + first) / 3
            self.assertAlmostEqual(scores["otb"]["AO"], overlap, 9, tracker)
            self.assertAlmostEqual(scores["otb"]["AUC"], area, 9, tracker)

    def test_report_is_the_same_again(self):
        again = self.root / "again"
        done = run("report", self.out, "--interval", f"{self.LOW}:{self.HIGH}", "--paper", "--out", again)
        self.assertEqual(done.stdout, self.done.stdout)
        def contents(folder):
            return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}
        self.assertEqual(contents(again), contents(self.folder))

    def test_table_on_standard_output(self):
        lines = self.done.stdout.splitlines()
        self.assertEqual(lines[0].split()[:5], ["tracker", "EAO", "A", "F", "AO"])
        self.assertEqual([line.split()[0] for line in lines[1:]], list(self.trackers))

    def test_baseline(self):
        done = run("report", self.out, "--baseline", "dpt", "--out", self.root / "baseline")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("Tracker minus dpt", (self.root / "baseline/report.html").read_text())

    def test_problems_are_one_line(self):
        moved = self.root / "moved"
        for arguments, words in [
            ((self.root / "nothing",), "campaign.json"),
            ((self.out, "--interval", "20"), "LOW:HIGH"),
            ((self.out, "--interval", "20:10"), "LOW:HIGH"),
            ((self.out, "--baseline", "none", "--out", moved), "none"),
            ((self.out, "--dataset", self.root / "nothing"), "nothing"),
            ((self.out, "--out", "/proc/none"), "/proc/none"),
            ((), "DIR"),
        ]:
            result = run("report", *arguments)
            self.assertNotEqual(result.returncode, 0, arguments)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            self.assertIn(words, result.stderr)
            self.assertEqual(result.stdout, "")
        self.assertFalse(moved.exists())
        file = self.out / "results/kcf/sre/second/second_004.txt"
        text = file.read_text()
        for damage, words in [(None, "--protocol sre"), ("x\n", ":1: "), ("1\n", "but 1 frame")]:
            file.unlink() if damage is None else file.write_text(damage)
            result = run("report", self.out, "--out", moved)
            self.assertEqual(result.returncode, 1)
            self.assertIn(file.stem, result.stderr)
            self.assertIn(words, result.stderr)
            self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
            file.write_text(text)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
