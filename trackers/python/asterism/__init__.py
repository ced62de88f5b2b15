"""Asterism: MAP placement of constellations of parts, part models and visual trackers.

A spring system is solved in place:

    system = asterism.SpringSystem(asterism.Topology.full(4), dim=2)
    system.anchors = anchors            # (4, 2)
    system.anchor_stiffness = 1
    system.set_rest_lengths(anchors)
    system.link_stiffness = 0.5
    x = anchors.copy()
    summary = asterism.solve(system, x)

Trackers (`asterism.Tracker`) and systems in files (`asterism.read_systems`) are there where the build had OpenCV and
nlohmann-json. `asterism.evaluation` reads the reports of asterism-eval.
"""

from . import _asterism, evaluation
from ._asterism import *
from ._asterism import __version__

if hasattr(_asterism, "_parse_systems"):
    from .stored import StoredSystem, parse_systems, read_systems, write_systems
