#!/usr/bin/env python3
"""asterism.locate_path on simulated drives of a known truth, beside least squares of full poses.

random_paths.py [--seeds A B] [--scale S] [--held]: one line a kind of drive. The peer has headings among its unknowns, the true deviations of the
odometry, Cauchy's loss where ranges are wrong, and starts at the truth, so that it does not end in another minimum. --scale: the odometry counts so
many metres too few for each, which the peer knows and locate_path does not. --held: for locate_path, the scale is 1.
"""

import argparse

import asterism
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

USUAL = {"shape": "loops", "poses": 300, "beacons": 4, "known": 4, "sigma": 0.3, "told": 1.0, "rate": 0.5, "wrong": 0.1, "turn": 0.01, "slip": 0.03, "pauses": False}
KINDS = {
    "usual": {}, "straight": {"shape": "line"}, "straight, one corner": {"shape": "corner"}, "mower": {"shape": "mower"}, "60 poses": {"poses": 60},
    "1500 poses": {"poses": 1500}, "2 beacons": {"beacons": 2, "known": 2}, "no outliers": {"wrong": 0}, "30 % outliers": {"wrong": 0.3},
    "ranges of 1 m": {"sigma": 1.0}, "twice the true sigma told": {"told": 2.0}, "15 ranges": {"rate": 0.05}, "600 ranges": {"rate": 2.0}, "gyroscope": {"turn": 0.001},
    "turns of 3 degrees": {"turn": 0.05}, "pauses": {"pauses": True}, "2 of 4 beacons unknown": {"known": 2}, "no beacon known": {"known": 0},
}


def wave(rng, count, length):
    """A random process of deviation 1 that forgets over so many steps."""
    kept, found = np.exp(-1 / length), np.empty(count)
    found[0] = rng.normal()
    for k in range(1, count):
        found[k] = kept * found[k - 1] + np.sqrt(1 - kept**2) * rng.normal()
    return found


class Drive:
    """A true path [m], what the odometry and the ranges say of it, and where the beacons are."""

    step = 0.3

    def __init__(self, seed, kind):
        self.kind = kind = {**USUAL, **kind}
        rng = np.random.default_rng((77, seed))
        count = kind["poses"] - 1
        speed, turns = self.step * np.exp(0.3 * wave(rng, count, 20)), np.zeros(count)
        if kind["shape"] == "loops":
            turns = speed / rng.uniform(6, 12) + 0.05 * wave(rng, count, 30)
        elif kind["shape"] == "corner":
            turns[count // 2 : count // 2 + 10] = np.pi / 20
        elif kind["shape"] == "mower":
            row = int(rng.integers(40, 90))
            for number, k in enumerate(range(row, count - 8, row)):
                turns[k : k + 8] = (-1) ** number * np.pi / 8
        if kind["pauses"]:
            for k in range(0, count, 35):
                if rng.random() < 0.3:
                    speed[k : k + 35] = turns[k : k + 35] = 0
        self.heading = rng.uniform(-3, 3) + np.append(0, np.cumsum(turns))
        path = np.append(0, np.cumsum(speed * np.exp(1j * self.heading[:-1])))
        path -= path.mean()
        self.truth = np.column_stack([path.real, path.imag])
        self.deviation = np.array([self.step * kind["slip"], 0.3 * self.step * kind["slip"], kind["turn"]])
        noise = self.deviation * rng.normal(size=(count, 3)) * (speed > 0)[:, None]
        self.steps = np.column_stack([speed, np.zeros(count), turns]) + noise
        angle = rng.uniform(0, 6) + np.arange(kind["beacons"]) * 2 * np.pi / kind["beacons"] + rng.normal(0, 0.3, kind["beacons"])
        reach = max(30.0, np.abs(path).max()) * rng.uniform(0.6, 1.2, kind["beacons"])
        self.places = np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]
        self.beacons = np.where(np.arange(kind["beacons"])[:, None] < kind["known"], self.places, np.nan)
        number = int(kind["rate"] * kind["poses"])
        self.pose, self.beacon = np.sort(rng.uniform(0, count, number)), rng.integers(0, kind["beacons"], number)
        at = np.column_stack([np.interp(self.pose, np.arange(count + 1), c) for c in self.truth.T])
        self.ranges = np.linalg.norm(at - self.places[self.beacon], axis=1) + kind["sigma"] * rng.normal(size=number)
        is_wrong = rng.random(number) < kind["wrong"]
        self.ranges = np.abs(self.ranges + is_wrong * rng.uniform(0, 8, number))

    def error(self, x):
        """Root mean square; where no beacon is known, after the best rigid motion."""
        if self.kind["known"] == 0:
            x, truth = x - x.mean(0), self.truth - self.truth.mean(0)
            u, _, v = np.linalg.svd(x.T @ truth)
            return np.sqrt(np.mean(np.sum((x @ u @ v - truth) ** 2, 1)))
        return np.sqrt(np.mean(np.sum((x - self.truth) ** 2, 1)))


def full_poses(drive, steps=15):
    """Gauss-Newton's method on x, y and heading of all poses and the unknown beacons, from the truth: (poses, 2)."""
    count, number = len(drive.truth), len(drive.ranges)
    unknown = np.flatnonzero(np.isnan(drive.beacons[:, 0]))
    column = np.full(len(drive.beacons), -1)
    column[unknown] = 3 * count + 2 * np.arange(len(unknown))
    x = np.concatenate([np.column_stack([drive.truth, drive.heading]).ravel(), drive.places[unknown].ravel()])
    before = np.minimum(drive.pose.astype(int), count - 2)
    share = drive.pose - before
    weight = 1 / np.where((drive.steps == 0).all(1)[:, None], 1e-4, drive.deviation)
    first, row = 3 * np.arange(count - 1), 3 * (count - 1) + np.arange(number)
    for _ in range(steps):
        pose, entries = x[: 3 * count].reshape(-1, 3), []
        c, s = np.cos(pose[:-1, 2]), np.sin(pose[:-1, 2])
        d = np.diff(pose[:, :2], axis=0)
        there = np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], np.diff(pose[:, 2])])
        error = there - drive.steps
        error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
        for k, axis in enumerate(((c, s), (-s, c))):
            for a in range(2):
                entries += [(first + k, first + 3 + a, axis[a] * weight[:, k]), (first + k, first + a, -axis[a] * weight[:, k])]
            entries.append((first + k, first + 2, (there[:, 1] if k == 0 else -there[:, 0]) * weight[:, k]))
        entries += [(first + 2, first + 5, weight[:, 2]), (first + 2, first + 2, -weight[:, 2])]
        places = drive.places.copy()
        places[unknown] = x[3 * count :].reshape(-1, 2)
        away = (1 - share)[:, None] * pose[before, :2] + share[:, None] * pose[before + 1, :2] - places[drive.beacon]
        far = np.linalg.norm(away, axis=1)
        off = (far - drive.ranges) / drive.kind["sigma"]
        loss = 1 / np.sqrt(1 + off**2) if drive.kind["wrong"] else np.ones(number)
        slope = away / far[:, None] * (loss / drive.kind["sigma"])[:, None]
        is_unknown = column[drive.beacon] >= 0
        for a in range(2):
            entries += [(row, 3 * before + a, slope[:, a] * (1 - share)), (row, 3 * before + 3 + a, slope[:, a] * share)]
            entries.append((row[is_unknown], column[drive.beacon[is_unknown]] + a, -slope[is_unknown, a]))
        rows, columns, values = (np.concatenate(part) for part in zip(*entries))
        jacobian = sparse.csc_matrix((values, (rows, columns)), (3 * (count - 1) + number, len(x)))
        residual = np.append((error * weight).ravel(), off * loss)
        step = splu((jacobian.T @ jacobian + 1e-9 * sparse.eye(len(x))).tocsc()).solve(-jacobian.T @ residual)
        x += step * min(1, 2 / np.abs(step).max())
        if np.abs(step).max() < 1e-4:
            break
    return x[: 3 * count].reshape(-1, 3)[:, :2]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(100, 120))
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--held", action="store_true")
    options = parser.parse_args()
    everything, shares, scales = [], [], []
    for name, kind in KINDS.items():
        ratios, inside, sigmas = [], [], []
        for seed in range(*options.seeds):
            drive = Drive(seed, kind)
            steps = drive.steps / [options.scale, options.scale, 1]
            try:
                found = asterism.locate_path(
                    steps, drive.beacons, drive.pose, drive.beacon, drive.ranges, drive.kind["told"] * drive.kind["sigma"], cutoff=3, lower_bound=False,
                    scale_sigma=0 if options.held else 0.1,
                )
            except ValueError as error:
                print(f"{name}, seed {seed}: {error}")
                continue
            ratios.append(drive.error(found.x) / drive.error(full_poses(drive)))
            sigmas.append(found.turn_sigma)
            scales.append(found.scale)
            if drive.kind["known"] > 1:
                off = found.x - drive.truth
                inside.append((np.einsum("ti,ti->t", off, np.linalg.solve(found.covariance, off[..., None])[..., 0]) < 5.991).mean())
        contain = f"95 % regions contain {np.mean(inside):5.1%}, at least {min(inside):4.0%}; " if inside else " " * 47
        print(f"{name:26} error over that of full poses {np.exp(np.mean(np.log(ratios))):.2f}, at most {max(ratios):5.2f}; {contain}turn_sigma {min(sigmas):.4f} to {max(sigmas):.4f}", flush=True)
        everything += ratios
        shares += inside
    print(f"all: {np.exp(np.mean(np.log(everything))):.3f}, 90 % below {np.quantile(everything, 0.9):.2f}; 95 % regions contain {np.mean(shares):.1%}, in {np.mean(np.array(shares) < 0.7):.0%} of the drives less than 70 %; scale {np.mean(scales):.3f} +- {np.std(scales):.3f}, 1 in {np.mean(np.array(scales) == 1):.0%}")


if __name__ == "__main__":
    main()
