"""`pip wheel .` makes a wheel that works: wheel_test.py [CMAKE BUILD].

With CMAKE and BUILD, a program in the place of cmake installs what BUILD has, which takes seconds instead of minutes. Without them the
module is compiled, without trackers. Skipped (77) if pip, setuptools or wheel is missing.
"""

import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
STAND_IN = """#!{python}
# What the back end asks of cmake: -S SOURCE -B BUILD .., --build BUILD .., --install BUILD .. --prefix PREFIX.
import pathlib, shutil, subprocess, sys
if sys.argv[1] == "-S":
    found = pathlib.Path(sys.argv[4], "solver/python/asterism/__init__.py")
    found.parent.mkdir(parents=True)
    found.touch()
elif sys.argv[1] == "--install":
    prefix = pathlib.Path(sys.argv[sys.argv.index("--prefix") + 1])
    subprocess.run([{cmake!r}, "--install", {build!r}, "--component", "Asterism_python", "--prefix", prefix / "whole"], check=True)
    (module,) = (prefix / "whole").rglob("_asterism.*.so")
    shutil.move(module.parent, prefix / "asterism")
"""
USE = """
import asterism, numpy
x = numpy.array([[0.0, 0], [4, 0]])
system = asterism.SpringSystem(asterism.Topology.full(2))
system.anchors, system.anchor_stiffness, system.rest_length, system.link_stiffness = x, 1, 2, 0.5
assert asterism.solve(system, x).usable
print(x[1, 0] - x[0, 0], asterism.__file__)  # k (4 - d) / 2 = k_12 (d - 2): d = 3
"""

missing = [name for name in ("pip", "setuptools", "wheel") if not importlib.util.find_spec(name)]
if missing:
    print("not installed:", *missing)
    sys.exit(77)

# What `pip wheel` says where the package wheel is missing.
HIDDEN = """
import importlib.util, sys
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name in ("wheel", "setuptools.command.bdist_wheel") else find(name, *rest)
import asterism_build
asterism_build.require_wheel()
"""
hidden = subprocess.run([sys.executable, "-c", HIDDEN], cwd=ROOT / ".packaging/python", capture_output=True, text=True)
assert hidden.returncode == 1 and "has no package wheel" in hidden.stderr.splitlines()[-1], hidden.stderr

with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    project = folder / "project"  # pip writes into the project
    for part in (".cmake", ".packaging", "solver", "parts", "trackers"):
        shutil.copytree(ROOT / part, project / part, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ROOT.iterdir():
        if file.is_file():
            shutil.copy(file, project)
    environment = dict(os.environ, CMAKE_ARGS="-DASTERISM_WITH_PARTS=OFF -DASTERISM_WITH_CERES=OFF -DASTERISM_WITH_LIBLBFGS=OFF")
    if len(sys.argv) > 1:
        stand_in = folder / "bin" / "cmake"
        stand_in.parent.mkdir()
        stand_in.write_text(STAND_IN.format(python=sys.executable, cmake=sys.argv[1], build=sys.argv[2]))
        stand_in.chmod(0o755)
        environment["PATH"] = os.pathsep.join([str(stand_in.parent), os.environ["PATH"]])
    wheel = [sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps", "--no-index", "--wheel-dir", folder, project]
    made = subprocess.run(wheel, env=environment, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr
    (archive,) = folder.glob("asterism-*.whl")
    assert "none-any" not in archive.name, f"{archive.name}: the module is of this platform"
    with zipfile.ZipFile(archive) as files:
        held = {pathlib.PurePath(each).name for each in files.namelist() if each.startswith("asterism/")}
        files.extractall(folder / "installed")
    wanted = {path.name for path in (ROOT / "solver/python/asterism").iterdir() if path.is_file()}
    assert wanted <= held, wanted - held
    assert [each for each in held - wanted if not each.startswith("_asterism.")] == [], held - wanted
    environment = dict(os.environ, PYTHONPATH=str(folder / "installed"))
    used = subprocess.run([sys.executable, "-c", USE], env=environment, cwd="/", check=True, capture_output=True, text=True)
    distance, file = used.stdout.split()
    assert abs(float(distance) - 3) < 1e-6, distance
    assert pathlib.Path(file) == folder / "installed/asterism/__init__.py", file
