"""Runs a tracker that you wrote in Python in an evaluation, through the TraX protocol: by asterism-eval or the toolkit of VOT.

    class Still:                          # in my_tracker.py
        def init(self, image, box):       # image (height, width, 3), uint8, in the order blue, green, red, or (height, width)
            self.box = box                # (x, y, width, height) [px]

        def update(self, image):
            return self.box

    asterism-eval run SEQUENCES --external still=python:my_tracker:Still --out results

In the toolkit of VOT, the tracker's command is `python3 -m asterism.trax my_tracker:Still`.

`update` returns the box (x, y, width, height); or None if it does not see the object; or, as OpenCV's trackers, (True or False, box);
or an object with the attribute `box` and, if it has them, `confidence` and `lost`, such as an asterism.TrackResult. The object is
evaluated by its box also if it is `lost`. Every start makes a new tracker, by calling what stands behind the colon without arguments.
What `init` and `update` raise ends the session, is told to the client and printed to standard error. All that is printed goes to
standard error, too.
"""

from __future__ import annotations

import base64
import importlib
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from .names import shown

__all__ = ["main", "serve"]

_TOKEN = re.compile(r' +"([^"\\]*(?:\\.[^"\\]*)*)"')  # runs, not single letters: an image has a million
_PROPERTY = re.compile(r"[A-Za-z0-9._]{1,64}=")
_FORMATS = {"rgb": (np.uint8, 3), "gray8": (np.uint8, 1), "gray16": (np.uint16, 1)}


def _line(kind: str, *arguments: str) -> bytes:
    def escaped(text: str) -> str:
        return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")

    return ("@@TRAX:" + kind + "".join(f' "{escaped(each)}"' for each in arguments) + "\n").encode()


def _parsed(line: str) -> tuple[str, list[str]]:
    """A message's kind and its arguments, without its properties."""
    kind, rest = re.fullmatch(r"@@TRAX:([a-z]+)(.*)", line.rstrip("\r\n")).groups()  # type: ignore[union-attr]
    arguments = [re.sub(r"\\(.)", lambda m: "\n" if m[1] == "n" else m[1], each) if "\\" in each else each for each in _TOKEN.findall(rest)]
    return kind, [each for each in arguments if not _PROPERTY.match(each)]


def _image(text: str) -> npt.NDArray[Any]:
    """The pixels of image:WIDTH;HEIGHT;FORMAT;BASE64."""
    try:
        width, height, kind, data = text.removeprefix("image:").split(";", 3)
        dtype, channels = _FORMATS[kind]
        pixels = np.frombuffer(base64.b64decode(data), dtype).reshape(int(height), int(width), channels)
    except (KeyError, ValueError):
        raise ValueError(f"expected an image as image:WIDTH;HEIGHT;FORMAT;BASE64, found {text[:40]!r}") from None
    return np.ascontiguousarray(pixels[:, :, ::-1]) if channels == 3 else pixels[:, :, 0].copy()


def _box(values: Any) -> str:
    box = np.asarray(values, dtype=float)
    if box.shape != (4,):
        raise ValueError(f"update: expected a box (x, y, width, height), found {shown(values)}")
    return ",".join(repr(float(each)) for each in box)


def _state(found: Any) -> bytes:
    """The message for what `update` returned."""
    properties = []
    if hasattr(found, "box"):
        for name in ("confidence", "lost"):
            if (value := getattr(found, name, None)) is not None:
                properties.append(f"{name}={float(value) if name == 'confidence' else int(value)}")
        found = found.box
    elif isinstance(found, tuple) and len(found) == 2:
        found = found[1] if found[0] else None
    return _line("state", "0" if found is None else _box(found), *properties)  # one number: no object is seen


def serve(make: Callable[[], Any], source: BinaryIO, sink: BinaryIO, name: str = "python") -> None:
    """Runs trackers for a client that reads `sink` and writes `source`, until it says quit.

    make: called without arguments for every start, it gives an object with init(image, box) and update(image). What they raise is told
    to the client and raised.
    """

    def say(message: bytes) -> None:
        sink.write(message)
        sink.flush()

    say(_line("hello", "trax.version=1", f"trax.name={name}", "trax.family=python", "trax.region=rectangle", "trax.image=memory"))
    tracker = None
    try:
        for line in source:
            if not line.startswith(b"@@TRAX:"):
                continue
            kind, arguments = _parsed(line.decode())
            if kind == "quit":
                return
            if kind == "initialize" and len(arguments) == 2:
                tracker = make()
                region = [float(value) for value in arguments[1].split(",")]
                tracker.init(_image(arguments[0]), tuple(region))
                say(_state(region))
            elif kind == "frame" and len(arguments) == 1 and tracker is not None:
                say(_state(tracker.update(_image(arguments[0]))))
            else:
                raise ValueError(f"a message '{kind}' with {len(arguments)} arguments is not expected here")
        raise ConnectionError("the client closed the connection without a quit")
    except BaseException as error:
        try:
            say(_line("quit", f"trax.reason={type(error).__name__}: {error}"))
        except OSError:  # the client is gone
            pass
        raise


def _found(spec: str) -> Callable[[], Any]:
    """The object named behind the colon of MODULE:NAME, or of FILE.py:NAME."""
    module, colon, name = spec.rpartition(":")
    if not colon or not module or not name:
        raise ValueError(f"expected MODULE:CLASS, found '{spec}'")
    if module.endswith(".py"):
        if not os.path.isfile(module):
            raise ValueError(f"{module}: no such file")
        of_file = importlib.util.spec_from_file_location("tracker_of_file", module)
        assert of_file is not None and of_file.loader is not None
        holder = importlib.util.module_from_spec(of_file)
        sys.modules["tracker_of_file"] = holder
        of_file.loader.exec_module(holder)
    else:
        holder = importlib.import_module(module)
    if not callable(found := getattr(holder, name, None)):
        raise ValueError(f"{module} has no class '{name}'")
    for method in ("init(image, box)", "update(image)"):
        if isinstance(found, type) and not callable(getattr(found, method.partition("(")[0], None)):
            raise ValueError(f"{module}: the class {name} has no {method}")
    return found


def main(arguments: list[str]) -> int:
    """python3 -m asterism.trax MODULE:CLASS; the exit code is 1 after an error, and 2 for wrong arguments."""
    if len(arguments) != 1 or arguments[0] in ("-h", "--help"):
        print(__doc__, file=sys.stderr)
        return 0 if len(arguments) == 1 else 2
    # Only messages may go to standard output.
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        make = _found(arguments[0])
    except (ImportError, ValueError) as error:
        print(f"asterism.trax: {error}", file=sys.stderr)
        return 2
    try:
        serve(make, sys.stdin.buffer, sink, arguments[0])
    except Exception:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
