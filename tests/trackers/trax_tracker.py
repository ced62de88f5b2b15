"""A tracker of TraX, for its client's test: follows nothing, adds 2 to x in every image; says all it hears on stderr.

Arguments: the version of the protocol, the image formats and the region formats of its hello.
"""

import re
import sys

TOKEN = re.compile(r'"((?:[^"\\]|\\.)*)"|([^\s"]+)')


def tokens(line):
    for quoted, plain in TOKEN.findall(line):
        yield re.sub(r"\\(.)", lambda m: "\n" if m[1] == "n" else m[1], quoted) if quoted else plain


def say(message):
    print("@@TRAX:" + message, flush=True)


def answer(region):
    values = [float(v) for v in region.split(",")]
    for i in range(0, len(values) if len(values) > 4 else 2, 2):
        values[i] += 2
    say('state "%s" "confidence=0.75"' % ",".join(map(repr, values)))
    return ",".join(map(repr, values))


version, images, regions = sys.argv[1:]
say(
    f'hello "trax.version={version}" "trax.name=add \\"2\\"" "trax.image={images}" "trax.region={regions}"'
    " trax.multiobject=1"
)
objects = []
for line in sys.stdin:
    kind, *arguments = tokens(line.removeprefix("@@TRAX:"))
    print(kind, *(a[:40] for a in arguments), file=sys.stderr)
    if kind == "quit":
        break
    if kind == "initialize" and int(version) < 4:
        objects = arguments[1:]
    elif kind == "initialize":
        objects = objects + arguments if arguments else []
        continue
    print("an image, of which a tracker may say something")
    objects = [answer(region) for region in objects]
