"""The recipes for vcpkg, Conan and colcon, which are not at hand: read as far as Python and CMake can, they agree with the project. The
source distribution for pip, which setuptools makes."""

import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import types
import unittest
import xml.etree.ElementTree

ROOT = pathlib.Path(__file__).resolve().parents[2]
VCPKG = ROOT / ".packaging/vcpkg"
CONAN = ROOT / ".packaging/conan/conanfile.py"
PROJECT = (ROOT / "CMakeLists.txt").read_text()
VERSION = re.search(r"VERSION ([0-9.]+)\n", PROJECT)[1]
DESCRIPTION = re.search(r'DESCRIPTION "(.*)"', PROJECT)[1]
OPTIONS = set(re.findall(r"^option\((\w+)", PROJECT, re.MULTILINE))
# Without tests, benchmarks and docs.
ROOMS = set(re.findall(r"^ *add_subdirectory\((\w+)\)", PROJECT, re.MULTILINE)) - {"bench", "tests", "docs"}
ROOMS |= set(re.findall(r"^add_subdirectory\((\w+)\)", PROJECT, re.MULTILINE))  # read in any case
INCLUDED = re.findall(r"^include\((\.\S+)\)", PROJECT, re.MULTILINE)

# What vcpkg has, as far as the portfile calls it: it prints the options that the project is configured with.
STUBS = """
function(vcpkg_check_features)
  cmake_parse_arguments(arg "" "OUT_FEATURE_OPTIONS" "FEATURES" ${ARGN})
  set(options "")
  while(arg_FEATURES)
    list(POP_FRONT arg_FEATURES feature option)
    if(feature IN_LIST FEATURES)
      list(APPEND options -D${option}=ON)
    else()
      list(APPEND options -D${option}=OFF)
    endif()
    message(NOTICE "feature ${feature}")
  endwhile()
  set(${arg_OUT_FEATURE_OPTIONS} "${options}" PARENT_SCOPE)
endfunction()
function(vcpkg_cmake_configure)
  cmake_parse_arguments(arg "" "SOURCE_PATH" "OPTIONS" ${ARGN})
  foreach(option IN LISTS arg_OPTIONS)
    message(NOTICE "option ${option}")
  endforeach()
  if(NOT EXISTS ${arg_SOURCE_PATH}/solver/CMakeLists.txt)
    message(FATAL_ERROR "no project in ${arg_SOURCE_PATH}")
  endif()
endfunction()
function(vcpkg_cmake_install)
endfunction()
function(vcpkg_cmake_config_fixup)
endfunction()
function(vcpkg_fixup_pkgconfig)
endfunction()
function(vcpkg_install_copyright)
  cmake_parse_arguments(arg "" "" "FILE_LIST" ${ARGN})
  file(READ ${arg_FILE_LIST} licence)
endfunction()
"""


class Vcpkg(unittest.TestCase):
    def setUp(self):
        self.manifest = json.loads((VCPKG / "vcpkg.json").read_text())

    def portfile(self, features):
        """Options that the project is configured with, and the features that the portfile knows."""
        with tempfile.TemporaryDirectory() as folder:
            script = pathlib.Path(folder) / "run.cmake"
            script.write_text(
                "cmake_minimum_required(VERSION 3.25)\n"
                f"set(FEATURES {' '.join(features)})\nset(PORT asterism)\nset(CURRENT_PACKAGES_DIR {folder}/packages)\n"
                f"{STUBS}\ninclude({VCPKG}/portfile.cmake)\n"
            )
            run = subprocess.run(["cmake", "-P", script], capture_output=True, text=True)
            self.assertEqual(run.returncode, 0, run.stderr)
            self.assertTrue((pathlib.Path(folder) / "packages/share/asterism/usage").exists())
        options = dict(re.findall(r"^option -D(\w+)=(\w+)$", run.stderr, re.MULTILINE))
        return options, re.findall(r"^feature (\S+)$", run.stderr, re.MULTILINE)

    def test_names(self):
        self.assertEqual(self.manifest["name"], "asterism")
        self.assertEqual(self.manifest["version-semver"], VERSION)
        self.assertEqual(self.manifest["description"], DESCRIPTION)

    def test_features(self):
        every = list(self.manifest["features"])
        options, known = self.portfile(every)
        self.assertEqual(sorted(known), sorted(every))
        self.assertLessEqual(set(options), OPTIONS)
        # Each option for which packages are looked for is decided, never left to what a machine has.
        self.assertLessEqual({o for o in OPTIONS if o.startswith("ASTERISM_WITH_")}, set(options))
        none, _ = self.portfile([])
        for option, value in options.items():
            if option.startswith("ASTERISM_WITH_"):
                with_all = "OFF" if option == "ASTERISM_WITH_PETSC" else "ON"  # for which there is no feature
                self.assertEqual((value, none[option]), (with_all, "OFF"))

    def test_features_name_each_other(self):
        for feature in self.manifest["features"].values():
            self.assertTrue(feature["description"])
            for dependency in feature["dependencies"]:
                if isinstance(dependency, dict) and dependency["name"] == "asterism":
                    self.assertLessEqual(set(dependency["features"]), set(self.manifest["features"]))


class Options(types.SimpleNamespace):
    def rm_safe(self, name):
        delattr(self, name)


class Conan(unittest.TestCase):
    def setUp(self):
        """Loads the recipe with what it takes of Conan in place of Conan."""
        self.toolchain = types.SimpleNamespace(cache_variables={}, generate=lambda: None)
        self.copied = []
        modules = {
            "conan": {"ConanFile": object},
            "conan.tools": {},
            "conan.tools.build": {"check_min_cppstd": lambda conanfile, version: self.assertEqual(version, 20)},
            "conan.tools.cmake": {
                "CMake": None,
                "CMakeDeps": lambda conanfile: types.SimpleNamespace(generate=lambda: None),
                "CMakeToolchain": lambda conanfile: self.toolchain,
                "cmake_layout": lambda conanfile: None,
            },
            "conan.tools.files": {"copy": lambda conanfile, pattern, src, dst: self.copied.append((src, pattern))},
        }
        for name, content in modules.items():
            sys.modules[name] = types.ModuleType(name)
            vars(sys.modules[name]).update(content)
            self.addCleanup(sys.modules.pop, name)
        names = {"__name__": "conanfile"}
        exec(compile(CONAN.read_text(), str(CONAN), "exec"), names)
        self.recipe = names["AsterismConan"]

    def make(self, **options):
        conanfile = self.recipe()
        conanfile.options = Options(**{**self.recipe.default_options, **options})
        conanfile.recipe_folder, conanfile.export_sources_folder = str(CONAN.parent), "nowhere"
        conanfile.required = []
        conanfile.requires = lambda reference, **traits: conanfile.required.append(reference.split("/")[0])
        conanfile.configure()
        conanfile.validate()
        conanfile.layout()
        conanfile.requirements()
        conanfile.generate()
        return conanfile

    def test_names(self):
        self.assertEqual(self.recipe.name, "asterism")
        self.assertEqual(self.recipe.version, VERSION)
        self.assertEqual(self.recipe.description, DESCRIPTION)
        self.assertEqual(set(self.recipe.options), set(self.recipe.default_options))

    def test_options(self):
        conanfile = self.make()
        variables = dict(self.toolchain.cache_variables)
        self.assertLessEqual(set(variables), OPTIONS)
        self.assertLessEqual({o for o in OPTIONS if o.startswith("ASTERISM_WITH_")}, set(variables))
        self.assertEqual(conanfile.required, ["eigen"])
        self.assertEqual([name for name, value in variables.items() if value], ["ASTERISM_INSTALL"])

        conanfile = self.make(trackers=True, shared=True)
        self.assertEqual(conanfile.required, ["eigen", "nlohmann_json", "opencv"])
        for option in ("JSON", "PARTS", "TRACKERS"):
            self.assertTrue(self.toolchain.cache_variables[f"ASTERISM_WITH_{option}"])

    def test_sources(self):
        """What is exported is all that the project includes when it is built as a package."""
        self.make().export_sources()
        for folder, pattern in self.copied:
            self.assertTrue(list(pathlib.Path(os.path.normpath(folder)).glob(pattern)), pattern)
        patterns = [pattern for _, pattern in self.copied]
        for room in ROOMS:
            self.assertIn(f"{room}/*", patterns)
        for file in INCLUDED:
            self.assertIn(f"{pathlib.Path(file).parent}/*", patterns)


class Colcon(unittest.TestCase):
    # The packages of Debian 12 that rosdep installs for its names.
    DEBIAN = {
        "cmake": "cmake", "eigen": "libeigen3-dev", "libopencv-dev": "libopencv-dev", "suitesparse": "libsuitesparse-dev", "libceres-dev": "libceres-dev",
        "nlohmann-json-dev": "nlohmann-json3-dev", "cli11": "libcli11-dev", "pybind11-dev": "pybind11-dev", "python3-dev": "python3-dev", "python3-numpy": "python3-numpy",
    }

    def test_names(self):
        package = xml.etree.ElementTree.parse(ROOT / "package.xml").getroot()
        self.assertEqual((package.tag, package.get("format")), ("package", "3"))
        self.assertEqual([package.findtext(name) for name in ("name", "version", "description")], ["asterism", VERSION, DESCRIPTION])
        self.assertTrue((ROOT / package.find("license").get("file")).is_file())
        self.assertEqual(package.findtext("export/build_type"), "cmake")

    def test_dependencies(self):
        """They are the packages that our own script installs for a build, as far as rosdep has a name for them."""
        package = xml.etree.ElementTree.parse(ROOT / "package.xml").getroot()
        named = {self.DEBIAN[each.text] for each in package if each.tag.endswith("depend")}
        script = (ROOT / ".ci/install-packages").read_text()
        tool, build = (re.search(rf"^{name}=\(([^)]*)\)", script, re.MULTILINE)[1].split() for name in ("tool", "build"))
        without_name = {"g++", "make", "ninja-build", "liblbfgs-dev"}
        self.assertEqual(named, {*tool, *build} - without_name - {'"${tool[@]}"'})

    @unittest.skipUnless(importlib.util.find_spec("catkin_pkg"), "catkin_pkg, with which colcon reads it, is not installed")
    def test_colcon_reads_it(self):
        from catkin_pkg.package import parse_package

        self.assertEqual(parse_package(str(ROOT / "package.xml")).get_build_type(), "cmake")


@unittest.skipUnless(importlib.util.find_spec("setuptools"), "setuptools is not installed")
class SourceDistribution(unittest.TestCase):
    def test_files(self):
        """Every file of the rooms and of CMake is in it."""
        with tempfile.TemporaryDirectory() as folder:
            project = pathlib.Path(folder) / "project"
            for room in {*ROOMS, ".packaging/python", *(os.path.dirname(file) for file in INCLUDED)}:
                shutil.copytree(ROOT / room, project / room, ignore=shutil.ignore_patterns("__pycache__"))
            for file in ROOT.iterdir():
                if file.is_file():
                    shutil.copy(file, project)
            wanted = {f.relative_to(project).as_posix() for f in project.rglob("*") if f.is_file() and f.parent != project}
            wanted |= {"CMakeLists.txt", "LICENSE", "README.md", "pyproject.toml"}
            command = f"from asterism_build import backend; backend.build_sdist({folder!r})"
            environment = dict(os.environ, PYTHONPATH=".packaging/python")
            run = subprocess.run([sys.executable, "-c", command], cwd=project, env=environment, capture_output=True, text=True)
            self.assertEqual(run.returncode, 0, run.stderr)
            (archive,) = pathlib.Path(folder).glob("*.tar.gz")
            self.assertEqual(archive.name, f"asterism-{VERSION}.tar.gz")
            with tarfile.open(archive) as files:
                held = {name.partition("/")[2] for name in files.getnames()}
            self.assertEqual(wanted - held, set())


if __name__ == "__main__":
    unittest.main()
