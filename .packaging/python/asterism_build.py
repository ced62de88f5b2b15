"""The back end of `pip install .`: setuptools, whose extension module CMake builds.

CMAKE_ARGS in the environment has further arguments for CMake, such as -DASTERISM_WITH_PARTS=OFF.
"""

import importlib.util
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

from setuptools import Extension, build_meta, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.egg_info import manifest_maker

FOLDER = pathlib.Path(__file__).resolve().parent
SOURCE = FOLDER.parents[1]


class CMakeBuild(build_ext):
    def build_extension(self, extension):
        build = pathlib.Path(self.build_temp).resolve()
        package = pathlib.Path(self.get_ext_fullpath(extension.name)).resolve().parent
        # pip's isolation hides the system's NumPy from the Python that CMake asks.
        environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONNOUSERSITE")}

        def cmake(*arguments):
            subprocess.run(["cmake", *map(str, arguments)], check=True, env=environment)

        unneeded = [f"-DASTERISM_BUILD_{what}=OFF" for what in ("TOOLS", "TESTS", "BENCH", "DOCS")]
        generator = ["-G", "Ninja"] if shutil.which("ninja") else []
        cmake(
            *("-S", SOURCE, "-B", build, *generator, "-DCMAKE_BUILD_TYPE=Release", "-DBUILD_SHARED_LIBS=OFF", *unneeded),
            *(f"-DPython3_EXECUTABLE={sys.executable}", "-DASTERISM_PYTHON_DIR=."),
            *shlex.split(os.environ.get("CMAKE_ARGS", "")),
        )
        if not (build / "solver/python/asterism/__init__.py").exists():
            sys.exit(
                f"asterism: NumPy or the headers of {sys.executable}, or pybind11, were not found "
                "(Debian packages python3-numpy, python3-dev, pybind11-dev)"
            )
        jobs = ["--parallel", self.parallel] if self.parallel else []
        cmake("--build", build, "--target", "asterism_python", *jobs)
        cmake("--install", build, "--component", "Asterism_python", "--prefix", build / "installed")
        shutil.copytree(build / "installed/asterism", package, dirs_exist_ok=True)


def require_wheel():
    """Exits with the package that is missing: setuptools says only that a command is invalid."""
    if not importlib.util.find_spec("wheel") and not importlib.util.find_spec("setuptools.command.bdist_wheel"):
        sys.exit(f"asterism: {sys.executable} has no package wheel, which --no-build-isolation needs (Debian package python3-wheel)")


class Backend(build_meta._BuildMetaBackend):
    """The back end of setuptools, configured here rather than by a script at the root."""

    def prepare_metadata_for_build_wheel(self, *arguments, **named):
        require_wheel()
        return super().prepare_metadata_for_build_wheel(*arguments, **named)

    def build_wheel(self, *arguments, **named):
        require_wheel()
        return super().build_wheel(*arguments, **named)

    def run_setup(self, setup_script="setup.py"):
        manifest_maker.template = os.path.relpath(FOLDER / "MANIFEST.in", SOURCE)
        setup(
            version=re.search(r"^  VERSION (.*)$", (SOURCE / "CMakeLists.txt").read_text(), re.MULTILINE)[1],
            ext_modules=[Extension("asterism._asterism", sources=[])],
            cmdclass={"build_ext": CMakeBuild},
        )


backend = Backend()
