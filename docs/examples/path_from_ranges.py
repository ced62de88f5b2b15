#!/usr/bin/env python3
"""The path of a robot from its odometry and from ranges to beacons: path_from_ranges.py FILE.pyfg

Reads the format of PyFactorGraph: VERTEX_SE2, VERTEX_XY, EDGE_SE2, EDGE_RANGE. True positions serve only to print the errors.
"""

import pathlib
import sys
import time

import asterism
import numpy as np

CUTOFF = 2.0  # deviations from which on a range counts less


def read(path: str) -> dict[str, np.ndarray]:
    """True poses (x, y, heading), steps (dx, dy, turn), beacons, and of each range its pose, beacon, length and deviation."""
    poses, beacons, steps, ranges = {}, {}, [], []
    with open(path) as file:
        for number, line in enumerate(file, 1):
            kind, *words = line.split() or [""]
            try:
                if kind == "VERTEX_SE2":
                    poses[words[1]] = [float(word) for word in words[2:5]]
                elif kind == "VERTEX_XY":
                    beacons[words[0]] = [float(word) for word in words[1:3]]
                elif kind == "EDGE_SE2":
                    steps.append([float(word) for word in words[3:6]])
                elif kind == "EDGE_RANGE":
                    ranges.append((number, words[1], words[2], float(words[3]), float(words[4]) ** 0.5))
            except (IndexError, ValueError):
                sys.exit(f"{path}:{number}: expected the numbers of {kind}")
    if len(poses) != len(steps) + 1 or not ranges:
        sys.exit(f"{path}: expected a step from each pose to the next, and ranges")
    pose, beacon = ({name: k for k, name in enumerate(named)} for named in (poses, beacons))
    for number, of, to, *_ in ranges:
        if of not in pose or to not in beacon:
            sys.exit(f"{path}:{number}: a range from {of} to {to}, which are not a pose and a beacon")
    return {
        "poses": np.array(list(poses.values())),
        "steps": np.array(steps),
        "beacons": np.array(list(beacons.values())),
        "pose": np.array([pose[name] for _, name, *_ in ranges]),
        "beacon": np.array([beacon[name] for _, _, name, *_ in ranges]),
        "range": np.array([length for *_, length, _ in ranges]),
        "deviation": np.array([deviation for *_, deviation in ranges]),
    }


def dead_reckoning(start: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Positions (poses, 2)."""
    headings = start[2] + np.concatenate([[0], np.cumsum(steps[:-1, 2])])
    moves = np.exp(1j * headings) * (steps[:, 0] + 1j * steps[:, 1])
    path = complex(*start[:2]) + np.concatenate([[0], np.cumsum(moves)])
    return np.stack([path.real, path.imag], axis=1)


def moved(x: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """x after the rigid motion, mirrored or not, that brings it nearest to the truth."""
    left, _, right = np.linalg.svd((x - x.mean(0)).T @ (truth - truth.mean(0)))
    return (x - x.mean(0)) @ left @ right + truth.mean(0)


def error(x: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((x - truth) ** 2, axis=1))))


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    if not pathlib.Path(sys.argv[1]).exists():
        print(f"skipped: there is no {sys.argv[1]}")
        return
    data = read(sys.argv[1])
    truth = data["poses"][:, :2]
    reckoned = dead_reckoning(data["poses"][0], data["steps"])
    print(f"{len(truth)} poses, {len(data['range'])} ranges; dead reckoning: {error(reckoned, truth):.3f} m root mean square")
    for name, beacons in (("known", data["beacons"]), ("unknown", np.full_like(data["beacons"], np.nan))):
        begin = time.perf_counter()
        path = asterism.locate_path(
            data["steps"], beacons, data["pose"], data["beacon"], data["range"], data["deviation"], cutoff=CUTOFF
        )
        seconds = time.perf_counter() - begin
        x = path.x if name == "known" else moved(path.x, truth)
        print(
            f"beacons {name}: error {error(x, truth):.3f} m; turn_sigma {path.turn_sigma:.5f}, {path.outliers.sum()} outliers, "
            f"energy in [{path.lower_bound:.1f}, {path.energy:.1f}]; {seconds:.2f} s"
        )


if __name__ == "__main__":
    main()
