#!/usr/bin/env python3
"""Headers of the solver include those of their own room, a folder, and of rooms below it: python3 check_rooms.py ROOT"""

import re
import sys
from pathlib import Path

# From the bottom: a room may include those in lines above its own.
ROOMS = [
    ["base"],  # what says nothing about springs: exports, memory, numbers
    ["matrix"],  # factorisations and eigenvalues
    ["problem"],  # systems and what is wrong with them
    ["energy"],  # energy and derivatives, and what they tell about a solution
    ["run", "linear"],  # options, summaries, the frame around iterations; IDA's matrix
    ["terms"],  # systems of terms
    ["method"],
    ["batch", "discrete", "distributed", "graph", "io", "ranges", "reference"],
]
LEVEL = {room: level for level, rooms in enumerate(ROOMS) for room in rooms}


def main(root):
    headers = Path(root) / "solver/include/asterism/solver"
    faults = []
    for path in sorted(headers.rglob("*.hpp")):
        room = path.relative_to(headers).parts[0]
        if room not in LEVEL:
            faults.append(f"{path}: {room} is no room, see {__file__}")
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            other = re.match(r"#include <asterism/solver/(\w+)/", line)
            if other and other[1] != room and LEVEL.get(other[1], len(ROOMS)) >= LEVEL[room]:
                faults.append(f"{path}:{number}: a header of {room} includes one of {other[1]}")
    print("\n".join(faults) or "includes between rooms run one way")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
