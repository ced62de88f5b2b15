#!/usr/bin/env python3
"""Ctrl-C during each call that may take long: KeyboardInterrupt at once, inputs unchanged, and the process ends."""

import os
import signal
import subprocess
import sys
import unittest

# Each call would take far longer than PATIENCE [s]. `kept` are arrays that must stay as they were.
PATIENCE = 60
GRAPH = """
n = 30000  # links at random, whose factor is nearly dense
ends = random.integers(0, n, (3 * n, 2))
s = asterism.SpringSystem(asterism.Topology.from_links(n, ends[ends[:, 0] != ends[:, 1]]))
x = 10 * random.normal(size=(n, 2))
s.anchors, s.anchor_stiffness, s.rest_length, s.link_stiffness = x, 1, 0.1, 1
kept = [x, s.anchors, s.rest_length]
"""
SMALL = """
s, x = asterism.random_system("lit", 9, 1)
s.rest_length, s.anchor_stiffness = random.uniform(5, 100, s.link_count), 1e-3  # far from a proof
kept = [x, s.anchors, s.rest_length]
"""
POINTS = """
d = random.uniform(1, 2, (60, 60))
d += d.T
kept = [d]
"""
MAPS = """
maps = [random.uniform(0, 1, (30, 30)).astype(np.float32) for _ in range(6)]
joints = [asterism.Joint(k, k + 1, weight=0.01) for k in range(5)]
kept = maps
"""
WIDE = """
maps = [random.uniform(0, 1, (1000, 1000)).astype(np.float32)] * 4
joints = [asterism.Joint(k, k + 1, weight=0.01) for k in range(3)]
kept = maps[:1]
"""
CALLS = {
    "branch and bound": (SMALL, "asterism.solve(s, x, 'branch-and-bound', gap=1e-15, max_nodes=10**9, max_seconds=1e9)"),
    "multi-start": (SMALL, "asterism.solve(s, x, 'multi-start', starts=10**9)"),
    "iterations": (SMALL, "asterism.solve(s, x, 'multi-start', starts=10**9, on_iteration=lambda *_: None)"),
    "mds": (POINTS, "asterism.mds(d, starts=10**9)"),
    "layout": (POINTS, "asterism.layout(d, starts=10**9)"),
    "m_best_placements": (MAPS, "asterism.m_best_placements(maps, joints, count=10**6)"),
    "pictorial_structure": (WIDE, "asterism.pictorial_structure(maps, joints, count=10**9, distance=0)"),
    "scaled_structure": (WIDE, "asterism.scaled_structure([m[None] for m in maps], joints, [1.0], count=10**9, distance=0)"),
    "loopy_structure": (
        WIDE,
        "asterism.loopy_structure(maps, joints + [asterism.Joint(0, 3, (5, 5), 0.1)], tolerance=0, progress=0, max_iterations=10**9)",
    ),
    "locate": (
        "beacons = random.uniform(0, 10, (12, 3))\nranges = random.uniform(0, 10, (10**5, 12))\nkept = [beacons, ranges]",
        "asterism.locate(beacons, ranges, 2.0, cutoff=3, threads=2)",
    ),
    "remove_overlaps": ("x = random.uniform(0, 10, (20000, 2))\nkept = [x]", "asterism.remove_overlaps(x, (1, 1))"),
    "certify": (GRAPH, "asterism.certify(s, x)"),
    "covariance": (GRAPH, "asterism.node_covariances(s, x)"),
    "layout, large": ("g = [(i, i + 1) for i in range(100000)]\nkept = []", "asterism.layout(g, iterations=10**6)"),
    "layout_stress": ("n = 200000\ng = [(i, i + 1) for i in range(n)]\nkept = []\nx = random.normal(size=(n + 1, 2))", "asterism.layout_stress(g, x)"),
}
PROGRAM = """
import sys, numpy as np, asterism
random = np.random.default_rng(1)
{setup}
before = [a.copy() for a in kept]
print("ready", flush=True)
try:
    {call}
except KeyboardInterrupt:
    assert all(np.array_equal(a, b) for a, b in zip(before, kept)), "an input has changed"
    print("interrupted", flush=True)
"""


class InterruptTest(unittest.TestCase):
    def test_every_long_call_hears_ctrl_c(self):
        for name, (setup, call) in CALLS.items():
            with self.subTest(name):
                command = [sys.executable, "-W", "ignore", "-c", PROGRAM.format(setup=setup, call=call)]
                with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
                    try:
                        self.assertEqual(process.stdout.readline(), "ready\n")
                        with self.assertRaises(subprocess.TimeoutExpired):  # it is in the call
                            process.wait(0.5)
                        os.kill(process.pid, signal.SIGINT)
                        out, err = process.communicate(timeout=PATIENCE)
                        self.assertEqual((out, err, process.returncode), ("interrupted\n", "", 0))
                    finally:
                        process.kill()


if __name__ == "__main__":
    unittest.main()
