#!/usr/bin/env python3
"""The stubs say what the module has: every public name, and every parameter, both ways."""

import ast
import inspect
import pathlib
import re
import unittest

import asterism
from asterism import _asterism

# Members of every class.
COMMON = {name for name in dir(object)} | {"__module__", "__dict__", "__weakref__"}
OPTIONAL = {"PartState", "TrackResult", "tracker_names", "tracker_options", "smooth_track", "part_names", "part_options", "suggested_range", "Tracker", "MultiTracker", "_parse_systems", "_system_to_json"}


def public(names):
    return {name for name in names if not name.startswith("__")}


def parameters_of_stub(function):
    a = function.args
    names = [argument.arg for argument in a.posonlyargs + a.args + a.kwonlyargs if argument.arg != "self"]
    return names + (["**"] if a.kwarg else [])


def parameters_of_module(function):
    """From the signature that pybind11 puts into the docstring."""
    signature = function.__doc__.splitlines()[0]
    inner = signature[signature.index("(") + 1 : signature.rindex(")")]
    inner = re.sub(r"\[[^\]]*\]", "", inner)
    names = [part.split(":")[0].strip() for part in inner.split(",") if part.strip()]
    return ["**" if name.startswith("**") else name for name in names if name not in ("self", "*args", "*")]


class StubsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        path = pathlib.Path(asterism.__file__).with_name("_asterism.pyi")
        body = ast.parse(path.read_text()).body
        cls.functions = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}
        cls.classes = {node.name: node for node in body if isinstance(node, ast.ClassDef)}
        del cls.classes["_Values"]  # exists only in the stubs

    def test_names(self):
        missing = OPTIONAL - set(dir(_asterism))
        self.assertIn(missing, [set(), OPTIONAL, {n for n in OPTIONAL if n[0] != "_"}, {n for n in OPTIONAL if n[0] == "_"}])
        stubbed = set(self.functions) | set(self.classes)
        self.assertEqual(public(dir(_asterism)), stubbed - missing)

    def test_the_package_shows_them(self):
        shown = {name for name in public(dir(asterism)) if not name.startswith("_")}
        stubbed = {name for name in set(self.functions) | set(self.classes) if name[0] != "_"}
        python = {"bench", "evaluation", "pose", "cameras", "pose_estimate", "pose_files", "pose_fuse", "pose_networks", "pose_stream", "pose_swaps", "stored", "embedding", "Embedding", "evaluate", "layout", "layout_stress", "remove_overlaps", "rules", "mds", "gradients", "inputs", "names", "opencv", "OpenCvTracker", "Sensitivity", "SensitivityStatus", "sensitivity", "torch", "structures", "ranges", "scaling", "MDS", "PositionFix", "PositionMinimum", "PathEstimate", "locate", "locate_path", "Survey", "survey", "Joint", "PictorialResult", "pictorial_structure", "LoopyResult", "loopy_structure", "ScaledResult", "scaled_structure", "m_best_placements", "StoredSystem", "parse_systems", "read_systems", "write_systems"}
        self.assertLessEqual(shown, stubbed | python)
        self.assertGreaterEqual(shown, {name for name in stubbed if hasattr(_asterism, name)} | {"evaluation"})
        self.assertTrue(pathlib.Path(asterism.__file__).with_name("py.typed").exists())

    def test_members(self):
        for name, node in self.classes.items():
            if not hasattr(_asterism, name):
                continue
            if name == "Status":
                stubbed = {item.targets[0].id: item.value.value for item in node.body}
                self.assertEqual({member.name: member.value for member in _asterism.Status}, stubbed)
                continue
            with self.subTest(name):
                stubbed = set()
                for item in node.body:
                    if isinstance(item, ast.FunctionDef):
                        stubbed.add(item.name)
                    elif isinstance(item, ast.AnnAssign):
                        stubbed.add(item.target.id)
                there = set(dir(getattr(_asterism, name)))
                self.assertLessEqual(stubbed - {"__init__"}, there)
                self.assertEqual(public(there) - COMMON, public(stubbed))

    def test_parameters(self):
        checked = 0
        for name, node in self.functions.items():
            if hasattr(_asterism, name):
                self.assertEqual(parameters_of_stub(node), parameters_of_module(getattr(_asterism, name)), name)
                checked += 1
        for name, node in self.classes.items():
            if not hasattr(_asterism, name) or name == "Status":
                continue
            for item in node.body:
                setter = isinstance(item, ast.FunctionDef) and item.decorator_list
                if not isinstance(item, ast.FunctionDef) or (setter and getattr(setter[0], "id", "") != "staticmethod"):
                    continue
                if item.name in ("__len__", "__bool__"):
                    continue
                there = getattr(getattr(_asterism, name), item.name)
                self.assertEqual(parameters_of_stub(item), parameters_of_module(there), f"{name}.{item.name}")
                checked += 1
        self.assertGreater(checked, 20)

    def test_everything_has_a_docstring(self):
        for name in self.functions:
            if hasattr(_asterism, name) and not name.startswith("_"):
                self.assertGreater(len(getattr(_asterism, name).__doc__.splitlines()), 1, name)
        for name in self.classes:
            for member, value in vars(getattr(_asterism, name, object)).items():
                if isinstance(value, property) and name != "Status":
                    self.assertTrue(inspect.getdoc(value), f"{name}.{member}")


if __name__ == "__main__":
    unittest.main()
