"""Asterism: MAP placement of constellations of parts, part models and visual trackers.

A spring system is solved in place:

    system = asterism.SpringSystem(asterism.Topology.full(4), dim=2)
    system.anchors = anchors            # (4, 2)
    system.anchor_stiffness = 1
    system.set_rest_lengths(anchors)
    system.link_stiffness = 0.5
    x = anchors.copy()
    summary = asterism.solve(system, x)

`asterism.System` has terms of all kinds: robust or anisotropic anchors, ropes, angles, loads, functions of your own.

Points with given distances are found by `asterism.mds`, and by the estimator `asterism.MDS`; graphs are drawn by `asterism.layout`, and parts with maps of costs are
placed by `asterism.pictorial_structure`, `scaled_structure`, `loopy_structure` and `m_best_placements`. `asterism.locate` finds positions from ranges, `asterism.survey` those of devices from the ranges between them, and `asterism.pose` the
paths of key-points over time and several cameras. Gradients of a function of the solution are found by `asterism.sensitivity`;
`asterism.torch` is a layer of PyTorch. Trackers
(`asterism.Tracker`) and systems in files (`asterism.read_systems`) are there where the build had OpenCV and nlohmann-json.
`asterism.evaluate` evaluates a tracker of your own by asterism-eval, `asterism.evaluation` reads its reports, and `asterism.bench` compares
a solver of your own with the library's.
"""


def _why_missing():
    """An error message if no file of the compiled module is for this interpreter; None if there is one, which is broken then."""
    import re
    import sys
    from importlib.machinery import EXTENSION_SUFFIXES
    from pathlib import Path

    folder = Path(__file__).resolve().parent
    names = sorted(path.name for path in folder.glob("_asterism.*so"))
    if any(name == "_asterism" + suffix for name in names for suffix in EXTENSION_SUFFIXES):
        return None
    tags = [re.match(r"_asterism\.(cpython|pypy)-?(\d)(\d+t?)\b", name) for name in names]
    built_for = sorted({f"{'CPython' if tag[1] == 'cpython' else 'PyPy'} {tag[2]}.{tag[3]}" for tag in tags if tag})
    here = f"Python {sys.version.split()[0]} ({sys.executable}), which loads _asterism{EXTENSION_SUFFIXES[0]}"
    if not names:
        return f"asterism: its compiled module is not in {folder}; build the target asterism_python for {here}"
    return (
        f"asterism: its compiled module was built for {' and '.join(built_for) or 'another Python'} ({', '.join(names)}), and "
        f"this is {here}; run the Python that it was built for, or build it for this one (-DPython3_EXECUTABLE={sys.executable})"
    )


try:
    from . import _asterism
except ImportError as error:
    if (reason := _why_missing()) is None:
        raise
    raise ImportError(reason) from error
from . import bench, evaluation, pose
from ._asterism import *
from ._asterism import __version__
from .embedding import Embedding, layout, layout_stress, mds
from .evaluation import evaluate
from .gradients import Sensitivity, SensitivityStatus, sensitivity
from .ranges import PathEstimate, PositionFix, PositionMinimum, locate, locate_path
from .rules import remove_overlaps
from .scaling import MDS
from .survey import Survey, survey
from .structures import (
    Joint, LoopyResult, PictorialResult, ScaledResult, loopy_structure, m_best_placements, pictorial_structure, scaled_structure,
)

# What help(asterism) lists.
__all__ = [
    "bench", "evaluation", "pose", "Embedding", "Joint", "LoopyResult", "MDS", "PathEstimate", "PictorialResult", "PositionFix", "PositionMinimum", "ScaledResult", "Sensitivity", "SensitivityStatus", "Survey", "evaluate", "layout", "layout_stress", "locate", "locate_path", "loopy_structure", "m_best_placements", "mds", "pictorial_structure",
    "remove_overlaps", "scaled_structure", "sensitivity", "survey",
    *(name for name in dir(_asterism) if not name.startswith("_")),
]
if hasattr(_asterism, "Tracker"):
    from .opencv import OpenCvTracker

    __all__ += ["OpenCvTracker"]
if hasattr(_asterism, "_parse_systems"):
    from .stored import StoredSystem, parse_systems, read_systems, write_systems

    __all__ += ["StoredSystem", "parse_systems", "read_systems", "write_systems"]


def __getattr__(name):
    """Answers a name that is not here, also one of another library, with the nearest one."""
    if name.startswith("_"):
        raise AttributeError(f"module 'asterism' has no attribute '{name}'")
    from .names import no_attribute

    raise AttributeError(no_attribute(name, __all__))


def _no_topology(self, *arguments, **named):  # pybind11 says only that there is no constructor
    raise TypeError("asterism.Topology: use Topology.full(nodes) for all pairs, or Topology.from_links(nodes, pairs), .star or .k_nearest")


_asterism.Topology.__init__ = _no_topology
