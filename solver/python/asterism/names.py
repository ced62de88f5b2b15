"""Answers to names that are not ours: the message of an error says what they are called here."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

__all__ = ["no_attribute", "no_option"]


def _plain(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())


# Options of other libraries: the name here, and a remark.
_OPTIONS: dict[str, tuple[str, str]] = {
    **dict.fromkeys(["maxiter", "maxiters", "iterations", "niter", "nitermax", "maxnumiterations", "iter"], ("max_iterations", "")),
    **dict.fromkeys(
        ["eps", "tol", "epsilon", "threshold", "ftol", "gtol", "xtol", "rtol", "functiontolerance", "gradienttolerance", "parametertolerance"],
        ("tolerance", "of the stationarity, which has no unit"),
    ),
    **dict.fromkeys(["randomstate", "rng", "randomseed"], ("seed", "")),
    **dict.fromkeys(["ninit", "restarts", "nrestarts", "ninits"], ("starts", "")),
    **dict.fromkeys(["njobs", "numthreads", "workers", "nthreads"], ("threads", "")),
    **dict.fromkeys(["verbose", "disp", "callback"], ("on_iteration", "a function")),
    **dict.fromkeys(["init", "x0", "pos", "initial", "initialguess"], ("start", "")),
    **dict.fromkeys(["ncomponents", "ndim", "dims", "dimensions"], ("dim", "2 or 3")),
    **dict.fromkeys(["weight", "len"], ("length", "the attribute that is the length of an edge")),
    **dict.fromkeys(["overlap", "nodesize", "nodesizes", "avoidoverlap", "avoidoverlaps"], ("sizes", "the width and the height of each box")),
    **dict.fromkeys(["w", "sampleweight"], ("weights", "")),
    **dict.fromkeys(["npivots", "pivots"], ("partners", "")),
    **dict.fromkeys(["minimizertype", "algorithm", "solver", "mode", "prog"], ("method", "")),
}

# Options of other libraries that have no counterpart.
_REFUSED = {
    "dissimilarity": "the argument is always a matrix of distances; SciPy's cdist computes one from points",
    "metric": "mds is always metric; asterism.MDS has metric=False",
    "normalizedstress": "`stress` of the result is never normalised",
}
_REFUSED_BY_LAYOUT = {
    "k": "the drawing's unit is the length of an edge; multiply the result by a factor",
    "scale": "multiply the result by a factor",
    "center": "add the center to the result",
    "dist": "asterism.mds places points with a given matrix of distances",
}

# Options of other libraries that are two of ours, or that another class has.
_MORE = {
    "fixed": ("anchors", "'anchors' with anchor_weights=np.inf hold nodes"),
    "njobs": ("distances", "mds runs in one thread; asterism.MDS has n_jobs"),
}

# Functions of other libraries.
_FUNCTIONS = {
    **dict.fromkeys(["smacof", "cmdscale", "classicalmds", "multidimensionalscaling"], "mds"),
    **dict.fromkeys(["springlayout", "kamadakawailayout", "fruchtermanreingoldlayout", "graphvizlayout", "draw", "neato", "sfdp"], "layout"),
    **dict.fromkeys(["minimize", "leastsquares", "optimize", "curvefit"], "solve"),
    **dict.fromkeys(["trackercsrt", "trackercsrtcreate", "trackerkcf", "trackerkcfcreate", "trackermil", "trackermilcreate"], "OpenCvTracker"),
    **dict.fromkeys(["maketracker", "trackercreate", "createtracker", "csrt", "dpt", "dptplus", "kcf", "lgt"], "Tracker"),
    **dict.fromkeys(["trilaterate", "trilateration", "multilaterate", "multilateration"], "locate"),
}

# What some builds do not have.
_LEFT_OUT = {
    "OpenCV": (
        *("Tracker", "MultiTracker", "OpenCvTracker", "TrackResult", "tracker_names", "tracker_options"),
        *("part_options", "smooth_track", "suggested_range"),
    ),
    "nlohmann-json": ("StoredSystem", "parse_systems", "read_systems", "write_systems"),
}

# The method that has an option, if not all have it.
_OWNER = {"starts": "multi-start", "seed": "multi-start", "spread": "multi-start", "max_nodes": "branch-and-bound"}

# What is given to solve beside a method's options.
_OF_SOLVE = {"on_iteration": "give solve a function on_iteration", "start": "the start is x, the second argument of solve"}


def no_option(of: str, name: str, known: Sequence[str]) -> str:
    """The message for an option `name` that `of`, such as "mds()", does not have, but those in `known`."""
    plain = _plain(name)
    listed = f" (it has: {', '.join(known)})"
    refused = {**_REFUSED, **(_REFUSED_BY_LAYOUT if "graph" in known else {})}
    if plain in refused:
        return f"{of} has no option '{name}': {refused[plain]}{listed}"
    needed, answer = _MORE.get(plain, ("", ""))
    if needed in known:
        return f"{of} has no option '{name}': {answer}{listed}"
    ours, remark = _OPTIONS.get(plain, ("", ""))
    if plain in map(_plain, _OWNER):
        ours = next(option for option in _OWNER if _plain(option) == plain)
    if ours in known:
        return f"{of} has no option '{name}': here it is '{ours}'" + (f", {remark}" if remark else "") + listed
    same = [option for option in known if _OPTIONS.get(_plain(option), ("", ""))[0] == (ours or name)]
    if same:  # `of` has another library's names, as MDS has
        return f"{of} has no option '{name}': here it is '{same[0]}'{listed}"
    if ours in _OF_SOLVE and "hold_floating" in known:  # the options of a method
        return f"{of} has no option '{name}': {_OF_SOLVE[ours]}{listed}"
    if ours in _OWNER:
        return f"{of} has no option '{name}': '{ours}' is an option of the method '{_OWNER[ours]}'{listed}"
    near = difflib.get_close_matches(name.lower(), known, 1)
    return f"{of} has no option '{name}'" + (f", did you mean '{near[0]}'?" if near else "") + listed


def no_attribute(name: str, known: Sequence[str]) -> str:
    """The message for a name that the package does not have."""
    start = f"module 'asterism' has no attribute '{name}'"
    if name in ("torch", "trax"):
        return f"{start}: it is a module of its own, import asterism.{name}"
    for what, those in _LEFT_OUT.items():
        if name in those:
            return f"{start}: it is left out, as the build had no {what}"
    plain = _plain(name)
    ours = _FUNCTIONS.get(plain) or next((other for other in known if _plain(other) == plain), None)
    if ours in known:
        return f"{start}: here it is '{ours}'"
    near = difflib.get_close_matches(name, known, 1)
    return start + (f", did you mean '{near[0]}'?" if near else "")
