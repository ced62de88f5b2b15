#!/usr/bin/env python3
"""The installed package is whole: install_test.py CMAKE BUILD FOLDER."""

import os
import pathlib
import subprocess
import sys
import tempfile

cmake, build, folder = sys.argv[1:]
with tempfile.TemporaryDirectory() as prefix:
    for component in ("Asterism_python", "Asterism_runtime"):  # the latter holds the shared libraries, if any
        command = [cmake, "--install", build, "--component", component, "--prefix", prefix]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    package = pathlib.Path(prefix, folder, "asterism")
    installed = {path.name for path in package.iterdir() if path.suffix != ".so"}
    assert installed == {"__init__.py", "_asterism.pyi", "bench.py", "cameras.py", "embedding.py", "evaluation.py", "gradients.py", "inputs.py", "names.py", "opencv.py", "pose.py", "pose_estimate.py", "pose_files.py", "pose_fuse.py", "pose_networks.py", "pose_stream.py", "pose_swaps.py", "pose_tool.py", "py.typed", "ranges.py", "rules.py", "scaling.py", "stored.py", "structures.py", "survey.py", "torch.py", "trax.py"}, installed
    (module,) = package.glob("_asterism.*.so")
    assert build.encode() not in module.read_bytes(), "the module knows where it was built"
    program = """
import asterism, numpy
x = numpy.array([[0.0, 0], [4, 0]])
system = asterism.SpringSystem(asterism.Topology.full(2))
system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = x, 1, 2, 0.5
assert asterism.solve(system, x).usable
print(x[1, 0] - x[0, 0])  # k (4 - d) / 2 = k_12 (d - 2): d = 3
print(asterism.__file__)
"""
    run = subprocess.run(
        [sys.executable, "-c", program],
        env=dict(os.environ, PYTHONPATH=str(package.parent)),
        cwd="/",
        check=True,
        capture_output=True,
        text=True,
    )
    distance, file = run.stdout.split()
    assert abs(float(distance) - 3) < 1e-6, distance
    assert file == str(package / "__init__.py"), file
