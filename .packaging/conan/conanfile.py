"""Conan 2 recipe of the tree which it is in: conan create .packaging/conan -o 'asterism/*:trackers=True'"""

import os

from conan import ConanFile
from conan.tools.build import check_min_cppstd
from conan.tools.cmake import CMake, CMakeDeps, CMakeToolchain, cmake_layout
from conan.tools.files import copy


class AsterismConan(ConanFile):
    name = "asterism"
    version = "0.1.0"
    description = "MAP inference of deformable-parts constellations, part models and visual trackers"
    license = "Apache-2.0"
    package_type = "library"
    settings = "os", "arch", "compiler", "build_type"
    options = {
        "shared": [True, False],
        "fPIC": [True, False],
        "json": [True, False],
        "parts": [True, False],
        "trackers": [True, False],
    }
    default_options = {"shared": False, "fPIC": True, "json": False, "parts": False, "trackers": False}

    def export_sources(self):
        tree = os.path.join(self.recipe_folder, "..", "..")
        for pattern in ("CMakeLists.txt", "LICENSE", ".cmake/*", "solver/*", "parts/*", "trackers/*"):
            copy(self, pattern, src=tree, dst=self.export_sources_folder)

    def configure(self):
        if self.options.trackers:  # which are made of parts, by descriptions in JSON
            self.options.parts = True
            self.options.json = True
        if self.options.shared:
            self.options.rm_safe("fPIC")

    def validate(self):
        check_min_cppstd(self, 20)

    def layout(self):
        cmake_layout(self)

    def requirements(self):
        self.requires("eigen/3.4.0", transitive_headers=True)
        if self.options.json:
            self.requires("nlohmann_json/[>=3.9 <4]")
        if self.options.parts:
            self.requires("opencv/[>=4.5 <5]", transitive_headers=True, transitive_libs=True)

    def generate(self):
        toolchain = CMakeToolchain(self)
        toolchain.cache_variables["ASTERISM_INSTALL"] = True
        for absent in ("CHOLMOD", "CERES", "LIBLBFGS", "PETSC"):
            toolchain.cache_variables[f"ASTERISM_WITH_{absent}"] = False
        for option in ("json", "parts", "trackers"):
            toolchain.cache_variables[f"ASTERISM_WITH_{option.upper()}"] = bool(getattr(self.options, option))
        for absent in ("TOOLS", "PYTHON", "TESTS", "BENCH", "DOCS"):
            toolchain.cache_variables[f"ASTERISM_BUILD_{absent}"] = False
        toolchain.generate()
        CMakeDeps(self).generate()

    def build(self):
        cmake = CMake(self)
        cmake.configure()
        cmake.build()

    def package(self):
        copy(self, "LICENSE", src=self.source_folder, dst=os.path.join(self.package_folder, "licenses"))
        CMake(self).install()

    def package_info(self):
        # The package's own CMake files: components are asked for as everywhere.
        self.cpp_info.set_property("cmake_find_mode", "none")
        self.cpp_info.builddirs.append(os.path.join("lib", "cmake", "Asterism"))
