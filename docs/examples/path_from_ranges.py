#!/usr/bin/env python3
"""The path of a robot from its odometry and from ranges to beacons: path_from_ranges.py FILE.pyfg

Reads the format of PyFactorGraph: VERTEX_SE2, VERTEX_XY, EDGE_SE2, EDGE_RANGE. Positions alone are unknown. In the robot's
own frame, step k is the complex number z_k, and then it turns by the angle t_k; so steps d_k in the world obey
d_(k+1) = q_k d_k with q_k = z_(k+1) / z_k exp(i t_k), which is linear in the positions. The deviation of d_(k+1) - q_k d_k is
halved until the evidence falls.
"""

import sys
import time

import asterism
import numpy as np

LARGEST = 0.02  # deviation of a step from the turned one before [m]
STEP = 0.05  # of a step's length [m]
SHORTEST = 0.3  # steps are joined until they are so long: where the robot stands still, they have no direction [m]
DOUBTFUL = 2.0  # deviations from which on a range counts less (Geman and McClure)


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
    """Positions as complex numbers."""
    headings = start[2] + np.concatenate([[0], np.cumsum(steps[:-1, 2])])
    moves = np.exp(1j * headings) * (steps[:, 0] + 1j * steps[:, 1])
    return complex(*start[:2]) + np.concatenate([[0], np.cumsum(moves)])


def joined(path: np.ndarray) -> np.ndarray:
    """The poses that are nodes: each at least SHORTEST from the one before."""
    nodes = [0]
    for k, place in enumerate(path):
        if abs(place - path[nodes[-1]]) >= SHORTEST:
            nodes.append(k)
    return np.array(nodes)


def points(numbers: np.ndarray) -> np.ndarray:
    return np.stack([numbers.real, numbers.imag], axis=1)


def matrices(numbers: np.ndarray) -> np.ndarray:
    """Multiplications by complex numbers."""
    return np.stack([points(numbers), points(1j * numbers)], axis=2)


def system_of(data: dict[str, np.ndarray], path: np.ndarray, nodes: np.ndarray, deviation: float) -> asterism.System:
    n = len(nodes)
    system = asterism.System(n + len(data["beacons"]), 2)
    d = np.diff(path[nodes])
    q = d[1:] / d[:-1]  # p_(k+2) - p_(k+1) = q (p_(k+1) - p_k)
    coefficients = (matrices(q), matrices(-1 - q), np.eye(2))
    system.add_differences(np.arange(n - 2)[:, None] + np.arange(3), 1 / deviation**2, coefficients=coefficients)
    system.add_links(np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), abs(d), 1 / STEP**2)
    node = np.searchsorted(nodes, data["pose"], side="right") - 1
    pairs = np.stack([node, n + data["beacon"]], axis=1)
    system.add_links(pairs, data["range"], 1 / data["deviation"] ** 2, loss="geman-mcclure", scale=DOUBTFUL)
    for beacon in range(len(data["beacons"])):
        system.fix(n + beacon)
    return system


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    data = read(sys.argv[1])
    path = dead_reckoning(data["poses"][0], data["steps"])
    nodes = joined(path)
    truth = data["poses"][nodes, :2]

    def error(x: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.sum((x[: len(nodes)] - truth) ** 2, axis=1))))

    start = np.concatenate([points(path[nodes]), data["beacons"]])
    print(f"{len(nodes)} positions, {len(data['range'])} ranges; dead reckoning: {error(start):.3f} m root mean square")
    print("deviation  evidence  error [m]  time [s]")
    best, deviation = (-np.inf, 0.0, 0.0), LARGEST
    while best[1] in (0, 2 * deviation):
        system = system_of(data, path, nodes, deviation)
        x = start.copy()
        begin = time.perf_counter()
        summary = system.solve(x, method="graduated")
        seconds = time.perf_counter() - begin
        # Laplace's approximation, but for what is the same for all.
        determinant = system.solution(x).log_determinant + 4 * (len(nodes) - 2) * np.log(deviation)
        evidence = -summary.final_energy - determinant / 2
        print(f"{deviation:9.5f} {evidence:9.1f} {error(x):10.3f} {seconds:9.2f}")
        best = max(best, (evidence, deviation, error(x)))
        deviation /= 2
    print(f"chosen: {best[1]:g} m, error {best[2]:.3f} m")


if __name__ == "__main__":
    main()
