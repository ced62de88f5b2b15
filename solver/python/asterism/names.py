"""Answers to names that are not ours: the message of an error says what they are called here."""

from __future__ import annotations

import difflib
import operator
import re
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["no_attribute", "no_option", "shown", "with_value", "wrong_arguments"]


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
    **dict.fromkeys(["delta", "fscale", "lossscale", "lossparameter", "huberdelta"], ("scale", "of the loss")),
    **dict.fromkeys(["robust", "kernel", "robustkernel", "lossfunction"], ("loss", "")),
    **dict.fromkeys(["k", "springconstant", "constant"], ("stiffness", "")),
    **dict.fromkeys(["restlength", "restlengths", "rest", "distances"], ("lengths", "")),
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

# What is in a module of the package.
_OF_POSE = ("fuse", "triangulate", "Camera", "Stream", "read_cameras", "read_detections", "write_points")

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


def shown(value: Any) -> str:
    """A wrong value in a message of one line: its repr, if that is short and names no address, otherwise its type."""
    try:
        text = repr(value)
    except Exception:  # of the value's own
        text = ""
    return text if 0 < len(text) <= 60 and text.isprintable() and " at 0x" not in text else type(value).__name__


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
    dictionary = ": those of the tracker itself are given as options={...}" if "options" in known else ""
    return f"{of} has no option '{name}'" + (f", did you mean '{near[0]}'?" if near else dictionary) + listed


def no_attribute(name: str, known: Sequence[str]) -> str:
    """The message for a name that the package does not have."""
    start = f"module 'asterism' has no attribute '{name}'"
    if name in ("torch", "trax"):
        return f"{start}: it is a module of its own, import asterism.{name}"
    if name in _OF_POSE:
        return f"{start}: key-points over time and cameras are in asterism.pose, such as asterism.pose.fuse"
    for what, those in _LEFT_OUT.items():
        if name in those:
            return f"{start}: it is left out, as the build had no {what}"
    plain = _plain(name)
    ours = _FUNCTIONS.get(plain) or next((other for other in known if _plain(other) == plain), None)
    if ours in known:
        return f"{start}: here it is '{ours}'"
    near = difflib.get_close_matches(name, known, 1)
    return start + (f", did you mean '{near[0]}'?" if near else "")


# What the library's messages call the arrays of a SpringSystem.
_ARRAYS = {
    "anchor": "anchors", "anchor stiffness": "anchor_stiffness", "rest length": "rest_length", "link stiffness": "link_stiffness",
    "rest offset": "rest_offset", "load": "loads", "x of node": "x",
}
_EXPECTED = {"is not finite": "finite numbers", "is negative or not finite": "finite numbers >= 0"}


def with_value(message: str, system: Any, x: Any, options: Mapping[str, Any]) -> str:
    """The library's message with the value that it speaks of: of an option, or of an entry of an array of the system or of x."""
    if (option := re.match(r"option (\w+) ", message)) and option[1] in options:
        return f"{message}, found {options[option[1]]}"
    entry = re.fullmatch(r"([a-z ]+) (\d+) (is .*)", message)
    if entry is None or entry[1] not in _ARRAYS or entry[3] not in _EXPECTED or (system is None and entry[1] != "x of node"):
        return message
    name, index = _ARRAYS[entry[1]], int(entry[2])
    value = (x if name == "x" else getattr(system, name))[index]
    return f"{name}: expected {_EXPECTED[entry[3]]}, found {value.tolist() if hasattr(value, 'tolist') else value} at [{index}]"


# What pybind11 calls the types of parameters, in words.
_KINDS = {"int": "an integer", "float": "a number", "bool": "True or False", "str": "a string"}


def _parts(text: str) -> list[str]:
    """What commas outside of brackets and quotes separate, up to a bracket that was not opened."""
    parts, depth, quote = [""], 0, ""
    for c in text:
        quote = ("" if c == quote else quote) if quote else (c if c in "'\"" else "")
        depth += 0 if quote else (c in "([{<") - (c in ")]}>")
        if depth < 0:
            break
        if c == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += c
    return [part.strip() for part in parts if part.strip()]


def _kinds_of_items(kind: str) -> list[str] | None:
    """Those of Tuple[float, float] and List[float[2]], whose number is known."""
    if kind.startswith("Tuple["):
        return _parts(kind[6:])
    of_length = re.fullmatch(r"List\[(\w+)\[(\d+)\]\]", kind)
    return [of_length[1]] * int(of_length[2]) if of_length else None


def _expected(kind: str) -> str:
    if kind.startswith("Optional["):
        return f"{_expected(kind[9:-1])} or None"
    items = _kinds_of_items(kind)
    if items is None and kind.startswith("List["):
        return f"a list of {kind[5:-1]}"
    return f"{len(items)} numbers" if items else _KINDS.get(kind, kind)


def _fits(value: Any, kind: str) -> bool:
    """Whether pybind11 takes the value; True also where that cannot be said."""
    if kind.startswith("Optional["):
        return value is None or _fits(value, kind[9:-1])
    is_text = isinstance(value, (str, bytes))
    try:
        if kind == "int":
            return operator.index(value) is not None
        if kind == "float":
            return not is_text and float(value) is not None
        if kind.startswith(("List[", "Tuple[")):
            items = list(value)
            kinds = _kinds_of_items(kind) or [kind[5:-1]] * len(items)
            return not is_text and len(items) == len(kinds) and all(map(_fits, items, kinds))
    except Exception:  # whatever the value's own methods raise
        return False
    if kind == "bool":
        return hasattr(value, "__bool__") and not hasattr(value, "__array__")
    if kind == "str":
        return is_text
    return kind == "object" or kind.startswith("numpy.") or kind.rpartition(".")[2] in {base.__name__ for base in type(value).__mro__}


def wrong_arguments(text: str, given: Sequence[Any], named: Mapping[str, Any]) -> Exception:
    """The error for arguments that do not fit, on which pybind11 says `text`: one line, which names the wrong one.

    ValueError for an integer that is out of range, otherwise TypeError.
    """
    function = text.partition("(")[0]
    signature = re.search(r"^ +1\. ([\w.]*)\(", text, re.MULTILINE)
    if signature is None:
        return TypeError(text)
    parts = _parts(text[signature.end() :])
    if signature[1]:  # a constructor, which is shown without self
        function, given = signature[1].rpartition(".")[2], given[1:]
    elif parts and parts[0].startswith("self: ") and given:
        function = f"{type(given[0]).__name__}.{function}"
        if _fits(given[0], parts[0][6:]):
            parts, given = parts[1:], given[1:]
    by_position = next((k for k, part in enumerate(parts) if part.startswith("*")), len(parts))
    known = [re.split(": | = ", part) for part in parts if not part.startswith("*")]
    kinds = {name: kind for name, kind, *_ in known}
    values = {**dict(zip(kinds, given)), **named}
    missing = [repr(name) for name, _, *default in known if not default and name not in values]
    it_has = f" (it has: {', '.join(kinds)})" if kinds else ""
    if len(given) > by_position:
        return TypeError(f"{function}() takes {by_position} argument{'s' * (by_position != 1)} without a name, found {len(given)}{it_has}")
    for name in named:
        if name not in kinds and not any(part.startswith("**") for part in parts):
            return TypeError(no_option(f"{function}()", name, list(kinds)))
        if name in list(kinds)[: len(given)]:
            return TypeError(f"{function}() is given '{name}' twice")
    if missing:
        return TypeError(f"{function}() needs {' and '.join(missing)}{it_has}")
    for name, kind in kinds.items():
        if name in values and not _fits(values[name], kind):
            found = shown(values[name])
            if kind.endswith(".SpringSystem") and type(values[name]).__name__ == "System":
                found += "; a System has methods, such as system.solve(x) and system.solution(x).covariance(node)"
            if kind.endswith(".Topology"):
                found += "; Topology.full(4) links all pairs of four nodes, Topology.from_links(4, [(0, 1)]) those listed"
            return TypeError(f"{name}: expected {_expected(kind)}, found {found}")
    for name, kind in kinds.items():
        if kind == "int" and name in values and not 0 <= operator.index(values[name]) < 2**31:
            return ValueError(f"{name}: {values[name]} is out of range")
    return TypeError(f"{function}(): expected {', '.join(parts)}; found {', '.join(type(value).__name__ for value in values.values())}")
