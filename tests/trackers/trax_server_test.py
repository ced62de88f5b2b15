"""asterism-trax, driven by a client written from the protocol's documentation alone."""

import base64
import os
import pathlib
import re
import socket
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

SERVER = sys.argv.pop() if len(sys.argv) > 1 else "asterism-trax"
TIMEOUT = 60  # seconds, for a session
WIDTH, HEIGHT, FRAMES = 160, 120, 6


def draw(frame):
    """RGB pixels: texture in a square that moves by (3, 2) over flat ground; and the square's box."""
    left, top, side = 40 + 3 * frame, 30 + 2 * frame, 32
    pixels = bytearray(b"\x30\x28\x20" * (WIDTH * HEIGHT))
    for y in range(side):
        for x in range(side):
            at = 3 * ((top + y) * WIDTH + left + x)
            pixels[at : at + 3] = (
                80 + (x // 4 * 37 + y // 4 * 53) % 160,
                80 + (x // 6 * 71 + y // 5 * 29) % 160,
                80 + (x // 5 * 13 + y // 7 * 97) % 160,
            )
    return bytes(pixels), (left, top, side, side)


def png(pixels):
    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"".join(b"\0" + pixels[3 * WIDTH * y : 3 * WIDTH * (y + 1)] for y in range(HEIGHT))
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def escape(text):
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def line(kind, *arguments):
    return "@@TRAX:" + kind + "".join(f' "{escape(a)}"' for a in arguments) + "\n"


def parse(text):
    """A message's kind, its arguments and its properties."""
    kind, rest = re.fullmatch(r"@@TRAX:([a-z]+)(.*)\n", text).groups()
    arguments, properties = [], {}
    for token in re.findall(r' "((?:[^"\\]|\\["\\n])*)"', rest):
        token = re.sub(r"\\(.)", lambda m: "\n" if m[1] == "n" else m[1], token)
        key = re.match(r"([A-Za-z0-9._]{1,64})=", token)
        if key:
            properties[key[1]] = token[key.end() :]
        else:
            arguments.append(token)
    return kind, arguments, properties


def overlap(a, b):
    width = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    height = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    common = max(width, 0) * max(height, 0)
    return common / (a[2] * a[3] + b[2] * b[3] - common)


def corners(x, y, w, h):
    return x, y, x + w, y, x + w, y + h, x, y + h


def rounded(numbers):
    return [round(v, 6) for v in numbers]


class Session:
    """The server as a child process, on its standard streams or on a socket."""

    def __init__(self, *arguments, tracker="kcf", through_socket=False):
        environment = {k: v for k, v in os.environ.items() if not k.startswith("TRAX")}
        command = [SERVER, "--tracker", tracker, *arguments]
        if not through_socket:
            streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        else:
            listener = socket.create_server(("127.0.0.1", 0))
            listener.settimeout(TIMEOUT)
            environment["TRAX_SOCKET"] = str(listener.getsockname()[1])
            streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, **streams)
        if not through_socket:
            self.to, self.back = self.process.stdin, self.process.stdout
        else:
            with listener:
                self.connection = listener.accept()[0]
            self.connection.settimeout(TIMEOUT)
            self.to, self.back = self.connection.makefile("w"), self.connection.makefile("r")

    def say(self, *message):
        self.to.write(line(*message))
        self.to.flush()

    def hear(self):
        return parse(self.back.readline())

    def state(self):
        kind, arguments, properties = self.hear()
        assert kind == "state" and len(arguments) == 1, (kind, arguments, properties)
        return [float(v) for v in arguments[0].split(",")], properties

    def end(self):
        """Exit code and standard error."""
        self.to.close()
        if self.back is not self.process.stdout:
            self.connection.close()
        self.back.close()
        errors = self.process.stderr.read()
        self.process.stderr.close()
        return self.process.wait(TIMEOUT), errors


class Server(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.boxes, cls.images = [], {"path": [], "plain path": [], "memory": [], "data": []}
        for i in range(FRAMES):
            pixels, box = draw(i)
            path = pathlib.Path(cls.folder.name).absolute() / f"frame {i}=.png"
            path.write_bytes(png(pixels))
            cls.boxes.append(box)
            cls.images["path"].append(f"file://{path}")
            cls.images["plain path"].append(str(path))
            cls.images["memory"].append(f"image:{WIDTH};{HEIGHT};rgb;" + base64.b64encode(pixels).decode())
            cls.images["data"].append("data:image/png;base64;" + base64.b64encode(png(pixels)).decode())

    def region(self, polygon=False):
        return ",".join(map(str, corners(*self.boxes[0]) if polygon else self.boxes[0]))

    def track(self, session, images, version, polygon=False):
        """Follows the square to the end; the answers, which are in the start's form, as boxes."""
        states = []
        for i, image in enumerate(images):
            if i == 0 and version < 4:
                session.say("initialize", image, self.region(polygon))
            elif i == 0:
                session.say("initialize")
                session.say("initialize", self.region(polygon))
                session.say("frame", image)
            else:
                session.say("frame", image, "number=1")
            box, properties = session.state()
            if polygon:  # the tracker does not rotate
                points, box = box, [box[0], box[1], box[4] - box[0], box[5] - box[1]]
                self.assertEqual(rounded(points), rounded(corners(*box)))
            self.assertEqual(len(box), 4)
            self.assertGreater(overlap(box, self.boxes[i]), 0.999 if i == 0 else 0.6, f"frame {i}")
            self.assertTrue(0 <= float(properties["confidence"]) <= 1)
            states.append((rounded(box), properties))
        return states

    def test_all_versions_and_encodings_give_one_track(self):
        tracks = []
        for version in (1, 2, 3, 4):
            session = Session("--trax-version", str(version), through_socket=version % 2 == 0)
            kind, arguments, hello = session.hear()
            self.assertEqual((kind, arguments), ("hello", []))
            self.assertEqual(hello["trax.version"], str(version))
            self.assertEqual(hello["trax.name"], "kcf")
            self.assertLessEqual({"path", "memory", "buffer"}, set(hello["trax.image"].split(";")))
            self.assertLessEqual({"rectangle", "polygon"}, set(hello["trax.region"].split(";")))
            for images in self.images.values():
                for polygon in (False, True):
                    tracks.append(self.track(session, images, version, polygon))
            session.say("quit")
            self.assertEqual(session.end(), (0, ""))
        self.assertEqual(tracks, [tracks[0]] * len(tracks))

    def test_parts_are_within_the_box(self):
        session = Session(tracker="dpt")
        session.hear()
        for box, properties in self.track(session, self.images["path"], 3)[1:]:
            parts = [[float(v) for v in part.split(",")] for part in properties["parts"].split(";")]
            self.assertEqual(len(parts), 4)
            for x, y in parts:
                self.assertTrue(box[0] < x < box[0] + box[2] and box[1] < y < box[1] + box[3], (box, parts))
        session.say("quit")
        self.assertEqual(session.end()[0], 0)

    def test_several_objects(self):
        session = Session("--trax-version", "4")
        self.assertEqual(session.hear()[2]["trax.multiobject"], "1")
        session.say("initialize", self.region())
        session.say("initialize", "50,45,30,30")
        session.say("frame", self.images["path"][0])
        self.assertEqual([session.state()[0] for _ in range(2)], [list(self.boxes[0]), [50, 45, 30, 30]])
        session.say("initialize", "35,25,20,20")
        session.say("frame", self.images["path"][1])
        states = [session.state()[0] for _ in range(3)]
        self.assertGreater(overlap(states[0], self.boxes[1]), 0.6)
        self.assertEqual(states[2], [35, 25, 20, 20])
        session.say("quit")
        self.assertEqual(session.end(), (0, ""))

    def test_errors_are_told(self):
        image = self.images["path"][0]
        for messages, reason in (
            ([("frame", image)], "before an object"),
            ([("initialize", image + "x", self.region())], "no such image"),
            ([("initialize", image, "1,2,3")], "expected a rectangle or a polygon"),
            ([("initialize", image, self.region()), ("frame",)], "0 arguments"),
            ([("bogus",)], "unknown message"),
        ):
            for through_socket in (False, True):
                with self.subTest(reason=reason, through_socket=through_socket):
                    session = Session(through_socket=through_socket)
                    session.hear()
                    for i, message in enumerate(messages):
                        if i > 0:
                            session.state()
                        session.say(*message)
                    kind, _, properties = session.hear()
                    self.assertEqual(kind, "quit")
                    self.assertIn(reason, properties["trax.reason"])
                    code, errors = session.end()
                    self.assertEqual((code, errors.count("\n")), (1, 1), errors)
                    self.assertIn(reason, errors)

    def test_a_client_that_vanishes(self):
        for through_socket in (False, True):
            session = Session(through_socket=through_socket)
            session.hear()
            session.say("initialize", self.images["path"][0], self.region())
            session.state()
            code, errors = session.end()
            self.assertEqual(code, 1)
            self.assertIn("without sending quit", errors)


if __name__ == "__main__":
    unittest.main()
