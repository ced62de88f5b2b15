#!/usr/bin/env python3
"""asterism.pose.fuse beside simple methods on random recordings of a known truth, of every size and kind.

random_cases.py [--seeds A B] [--stream | --few | --runs]: one line a case in which fuse is clearly worse than the best of the simple methods, raises, gives NaN, or
takes long; then a table of the kinds of motion: errors beside those of the best simple method, and how often the 95 % regions contain the truth.
--stream: instead, the newest points of a Stream, whose scales are those of fuse of the same recording, beside those of this fuse. --few: instead, one to nine frames of three to six cameras with wrong detections, beside RANSAC: how many points that at
least three cameras see are off by more than ten times the noise. --runs: the same for 50 to 300 frames of two cameras, where wrong detections come in runs;
RANSAC is followed by a median of 7 frames.
"""

import argparse
import dataclasses
import time
import warnings

import asterism.pose as pose
import numpy as np
import peers
from compare import contained


def walk(rng, frames, joints, dim):
    """Velocities are random walks, of another size for each joint."""
    size = np.exp(rng.normal(0, 1, (1, joints, 1))) * 3e-3
    path = np.cumsum(np.cumsum(rng.normal(0, 1, (frames, joints, dim)) * size, 0), 0)
    path -= path.mean(0)
    return path / max(1.0, np.abs(path).max() / 2)


def still(rng, frames, joints, dim):
    return np.zeros((frames, joints, dim))


def line(rng, frames, joints, dim):
    return np.linspace(-0.5, 0.5, frames)[:, None, None] * rng.normal(0, 1, (1, joints, dim))


def circle(rng, frames, joints, dim):
    """Gait: periods of 12 to 60 frames."""
    phase = 2 * np.pi * (np.arange(frames)[:, None] / rng.uniform(12, 60, (1, joints)) + rng.random((1, joints)))
    a, b = rng.normal(0, 0.3, (2, 1, joints, dim))
    return np.cos(phase)[..., None] * a + np.sin(phase)[..., None] * b


def bursts(rng, frames, joints, dim):
    """Rest, and bursts of motion between two places."""
    place = np.zeros((joints, dim))
    path = np.zeros((frames, joints, dim))
    for j in range(joints):
        t = 0
        while t < frames:
            rest = t + int(rng.integers(10, 40))
            path[t:rest, j] = place[j]
            goal, steps = place[j] + rng.normal(0, 0.3, dim), int(rng.integers(5, 20))
            way = (1 - np.cos(np.pi * np.arange(1, steps + 1) / steps)) / 2
            left = path[rest : rest + steps, j]
            left[:] = (place[j] + way[:, None] * (goal - place[j]))[: len(left)]
            place[j], t = goal, rest + steps
    return path


MOTIONS = {"walk": walk, "still": still, "line": line, "circle": circle, "bursts": bursts}


def rotation(rng):
    v = rng.normal(0, 1, 3)
    return v / np.linalg.norm(v) * rng.uniform(0, np.pi)


RUNS = ["no runs", "of a joint", "of a joint, in one place", "of a view", "of all"]


def runs(rng, kind, shape, share):
    """(V, T, J): where detections are wrong, in runs of 8 frames on average of one joint in a view, of all joints in a view, or of all."""
    found = np.zeros(shape, bool)
    views, frames, joints = shape
    for v, j in [(v, j) for v in range(views) for j in range(joints)]:
        if v and kind == "of all" or j and kind in ("of all", "of a view"):
            found[v, :, j] = found[0 if kind == "of all" else v, :, 0]
            continue
        t = -int(rng.integers(8))
        while t < frames:
            t += int(rng.exponential(8 / share - 8)) + 1
            end = t + int(rng.exponential(8)) + 1
            found[v, max(t, 0) : max(end, 0), j] = True
            t = end
    return found


class Case:
    """Detections, how they came about and the truth; all of one seed."""

    def __init__(self, seed, few=False, in_runs=False):
        rng = np.random.default_rng((7, seed))
        self.kind = list(MOTIONS)[int(rng.integers(len(MOTIONS)))]
        self.dim = int(rng.integers(2, 4))
        self.views = int(rng.integers(2, 7)) if self.dim == 3 else int(rng.choice([1, 1, 2, 3]))
        self.frames = int(rng.choice([1, 2, 3, 4, 6, 10, 20, 50, 120, 300, 1100], p=[0.05, 0.05, 0.05, 0.05, 0.05, 0.1, 0.15, 0.2, 0.2, 0.08, 0.02]))
        self.joints = int(rng.choice([1, 2, 3, 6, 12]))
        self.unit = float(10.0 ** rng.choice([-3, 0, 3])) if self.dim == 3 else 1.0
        self.image = float(10.0 ** rng.choice([1, 3, 3, 3, 5]))  # its size [px]
        self.noise = float(10 ** rng.uniform(-3.7, -2)) * self.image
        self.wrong = float(rng.choice([0, 0, 0.05, 0.2, 0.4]))
        self.missing = float(rng.choice([0, 0, 0.1, 0.3, 0.6]))
        self.stretches = bool(rng.random() < 0.3)
        self.uneven = bool(rng.random() < 0.25)
        self.rounded = bool(rng.random() < 0.15)
        if few:
            self.dim, self.views, self.frames, self.stretches = 3, int(rng.integers(3, 7)), int(rng.integers(1, 10)), False
            self.wrong, self.missing = float(rng.choice([0.05, 0.15, 0.3])), float(rng.choice([0, 0.1]))
            self.unit = float(10.0 ** rng.choice([-3, 0, 3]))
        if in_runs:
            self.dim, self.views, self.frames, self.stretches, self.uneven = 3, 2, int(rng.choice([50, 120, 300])), False, False
            self.wrong, self.missing = float(rng.choice([0.05, 0.2, 0.4])), float(rng.choice([0, 0.1, 0.3]))
            self.runs = str(rng.choice(RUNS))
        times = np.cumsum(rng.uniform(0.05, 2, self.frames)) if self.uneven else np.arange(self.frames) * 1.0
        self.times = times * float(10.0 ** rng.choice([-2, 0, 3])) if self.uneven else None
        path = MOTIONS[self.kind](rng, self.frames, self.joints, self.dim)
        if self.uneven and self.frames > 1:  # the same motion, at other times
            even = np.linspace(times[0], times[-1], self.frames)
            path = np.stack([np.interp(times, even, c) for c in path.reshape(self.frames, -1).T], 1).reshape(path.shape)
        path = path + rng.normal(0, 0.5, (1, self.joints, self.dim))
        if self.dim == 3:
            ring = np.linspace(0, rng.uniform(0.5, 2.2 if in_runs else 2 * np.pi * (1 - 1 / self.views)), self.views)
            self.cameras = []
            for v in range(self.views):
                f = self.image * rng.uniform(0.7, 1.5)
                k = np.array([rng.normal(0, 0.1), 0, rng.normal(0, 2e-3), rng.normal(0, 2e-3), 0]) if rng.random() < 0.5 else None
                self.cameras.append(pose.Camera([[f, 0, self.image / 2], [0, f, self.image / 2], [0, 0, 1]], np.array([0, ring[v], 0]) + rng.normal(0, 0.1, 3), np.array([0, 0, rng.uniform(6, 12)]) * self.unit, **({} if k is None else {"distortions": k})))
            self.truth = path * self.unit
            seen = np.array([c.project(self.truth) for c in self.cameras])
            self.ideal = self.noise * 9 / self.image * self.unit  # of a point, about
        else:
            self.cameras = None
            self.truth = (path * 0.15 + 0.5) * self.image
            seen = np.array([self.truth] * self.views)
            self.ideal = self.noise
        deviation = self.noise * np.exp(rng.normal(0, 0.4, (self.views, 1, self.joints, 1)))
        seen = seen + rng.normal(0, 1, seen.shape) * deviation
        if self.rounded:
            seen = np.round(seen / self.noise) * self.noise
        is_wrong = rng.random(seen.shape[:3]) < self.wrong
        if in_runs and self.runs != "no runs":
            is_wrong = runs(rng, self.runs, is_wrong.shape, self.wrong)
        seen[is_wrong] = rng.uniform(0, self.image, (is_wrong.sum(), 2))
        if in_runs and self.runs == "of a joint, in one place":
            begin = np.maximum.accumulate(np.where(is_wrong, -1, np.arange(self.frames)[:, None]), 1) + 1
            place = np.take_along_axis(seen, np.minimum(begin, self.frames - 1)[..., None], 1)
            seen = np.where(is_wrong[..., None], place + rng.normal(0, self.noise, seen.shape), seen)
        seen[rng.random(seen.shape[:3]) < self.missing] = np.nan
        if self.stretches:
            for v in range(self.views):
                for j in range(self.joints):
                    if rng.random() < 0.4:
                        begin = int(rng.integers(self.frames))
                        seen[v, begin : begin + int(rng.integers(1, max(2, self.frames // 2))), j] = np.nan
        if self.views > 2 and rng.random() < 0.2:
            seen[int(rng.integers(self.views))] = np.nan
        self.detections = seen
        chance = rng.random()
        self.confidence = None
        if chance < 0.1:
            self.confidence = np.ones(seen.shape[:3])
        elif chance < 0.15:
            self.confidence = np.zeros(seen.shape[:3])
        elif chance < 0.3:
            self.confidence = np.where(is_wrong, rng.beta(2, 2, is_wrong.shape), rng.beta(8, 1, is_wrong.shape))
        self.number = np.isfinite(seen[..., 0]).sum(0)  # (T, J)

    def __str__(self):
        parts = [f"{self.dim}-D, {self.views} views, {self.frames} frames, {self.joints} joints, {self.kind}", f"noise {self.noise / self.image:.1e} of {self.image:g} px"]
        parts += [f"{100 * self.wrong:.0f} % wrong"] * (self.wrong > 0) + [f"{100 * self.missing:.0f} % missing"] * (self.missing > 0)
        parts += ["stretches"] * self.stretches + ["uneven"] * self.uneven + ["rounded"] * self.rounded
        if self.confidence is not None:
            parts.append(f"confidence {self.confidence.min():.1f}..{self.confidence.max():.1f}")
        return ", ".join(parts)


def simple(case):
    """Paths of simple methods, all without NaN."""
    seen = case.detections
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        if case.dim == 3:
            plain, robust = peers.triangulated(seen, case.cameras), peers.ransac(seen, case.cameras, threshold=5 * case.noise)[0]
        else:
            plain, robust = np.nanmean(seen, 0), np.nanmedian(seen, 0)
        found = {}
        for name, path in (("plain", plain), ("robust", robust)):
            found[name] = peers.interpolated(path)
            if case.frames >= 3:
                found[name + ", median of 3"] = peers.median_filtered(path, 3)
            if case.frames >= 7:
                found[name + ", median of 7"] = peers.median_filtered(path, 7)
            if case.frames >= 9:
                found[name + ", Savitzky-Golay"] = peers.savitzky_golay(path)
                found[name + ", both"] = peers.savitzky_golay(peers.median_filtered(path, 5))
    return found


def measures(path, case):
    """Median and 90 % quantile of the errors where at least two views (space) or one see the joint."""
    is_judged = case.number >= case.dim - 1
    error = np.linalg.norm(path - case.truth, axis=-1)[is_judged]
    error = error[np.isfinite(error)]
    return (np.median(error), np.quantile(error, 0.9)) if len(error) else (0.0, 0.0)


def stream(seeds):
    """Cases of ten frames and more."""
    rows = {}
    for seed in seeds:
        case = Case(seed)
        if case.frames < 10 or (case.number.sum(0) == 0).any():
            continue
        fused = pose.fuse(case.detections, case.confidence, case.cameras, times=case.times)
        online = pose.Stream(fused, case.cameras)
        found = [
            online.push(case.detections[:, t], None if case.times is None else case.times[t], None if case.confidence is None else case.confidence[:, t])
            for t in range(case.frames)
        ]
        newest = dataclasses.replace(fused, points=np.array([f.points for f in found]), covariance=np.array([f.covariance for f in found]))
        if not (np.isfinite(newest.points).all() and (np.linalg.eigvalsh(newest.covariance)[..., 0] > 0).all()):
            print(f"seed {seed}: {case}: NaN, or a covariance that is not definite", flush=True)
        ratios = [max(a, 1e-3 * case.ideal) / max(b, 1e-3 * case.ideal) for a, b in zip(measures(newest.points, case), measures(fused.points, case))]
        for key in ("all", case.kind, f"{case.views} views {case.dim}-D", f"{case.wrong:g} wrong"):
            rows.setdefault(key, []).append((*ratios, contained(newest, case.truth).mean()))
    for key, row in sorted(rows.items()):
        row = np.array(row)
        errors = np.exp(np.log(row[:, :2]).mean(0))
        print(f"{key:16} {len(row):4} cases: median error {errors[0]:.2f} of fuse's, 90 % error {errors[1]:.2f}; regions contain {row[:, 2].mean():.3f}, of the worst tenth {np.quantile(row[:, 2], 0.1):.3f}")


def few(seeds, in_runs=False):
    rows = {}
    for seed in seeds:
        case = Case(seed, few=not in_runs, in_runs=in_runs)
        if (case.number.sum(0) == 0).any():
            continue
        fused = pose.fuse(case.detections, case.confidence, case.cameras, times=case.times)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)
            robust = peers.ransac(case.detections, case.cameras, threshold=5 * case.noise)[0]
        robust = peers.median_filtered(robust) if in_runs else peers.interpolated(robust)
        is_judged = case.number >= (2 if in_runs else 3)
        off = [np.linalg.norm(path - case.truth, axis=-1)[is_judged] > 10 * case.ideal for path in (fused.points, robust)]
        for key in ((case.runs, case.kind, f"{case.wrong:g} wrong", "all") if in_runs else (f"{case.frames} frames", f"{case.views} views", f"{case.wrong:g} wrong", "all")):
            rows.setdefault(key, []).append(np.array([off[0].sum(), off[1].sum(), is_judged.sum()]))
    for key, row in sorted(rows.items()):
        fused, robust, count = np.sum(row, 0)
        print(f"{key:24} {len(row):4} cases, {count:6} points: off {fused / count:.1%}, RANSAC {robust / count:.1%}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 200))
    parser.add_argument("--stream", action="store_true")
    parser.add_argument("--few", action="store_true")
    parser.add_argument("--runs", action="store_true")
    options = parser.parse_args()
    if options.few or options.runs:
        return few(range(*options.seeds), options.runs)
    if options.stream:
        return stream(range(*options.seeds))
    groups, flags = {}, 0
    for seed in range(*options.seeds):
        case = Case(seed)
        start = time.process_time()
        try:
            fused = pose.fuse(case.detections, case.confidence, case.cameras, times=case.times)
        except ValueError as error:
            if (case.number.sum(0) == 0).any() and "never seen" in str(error):
                continue
            print(f"seed {seed}: {case}: {error}", flush=True)
            flags += 1
            continue
        seconds = time.process_time() - start
        other = {name: measures(path, case) for name, path in simple(case).items()}
        mine = measures(fused.points, case)
        best = [min(m[k] for m in other.values()) for k in range(2)]
        inside = contained(fused, case.truth)
        notes = []
        for k, name in enumerate(("median", "90 %")):
            if mine[k] > 1.3 * best[k] + 0.3 * case.ideal:
                which = min(other, key=lambda m: other[m][k])
                notes.append(f"{name} error {mine[k] / case.ideal:.2f}, {which} {best[k] / case.ideal:.2f}")
        if not (np.isfinite(fused.points).all() and np.isfinite(fused.covariance).all()):
            notes.append("NaN")
        elif not (np.linalg.eigvalsh(fused.covariance)[..., 0] > 0).all():
            notes.append("covariance not definite")
        if seconds > 1 + 2e-4 * case.detections[..., 0].size:
            notes.append(f"{seconds:.1f} s")
        if inside.size >= 200 and inside.mean() < 0.8:
            notes.append(f"regions contain {inside.mean():.2f}")
        if notes:
            flags += 1
            print(f"seed {seed}: {case}: {'; '.join(notes)}", flush=True)
        for key in ("all", case.kind, f"{case.dim}-D", f"{min(case.frames, 300)} frames" , f"{case.wrong:g} wrong", f"{case.views} views {case.dim}-D"):
            group = groups.setdefault(key, ([], [], [], []))
            group[0].append(mine[0] / max(best[0], 1e-3 * case.ideal))
            group[1].append(mine[1] / max(best[1], 1e-3 * case.ideal))
            group[2].append(inside.mean())
            group[3].append(inside.size)
    for key, (median, tail, inside, size) in sorted(groups.items()):
        print(f"{key:16} {len(median):4} cases: median error {np.exp(np.mean(np.log(np.maximum(median, 1e-3)))):.2f} of the best, 90 % error {np.exp(np.mean(np.log(np.maximum(tail, 1e-3)))):.2f}; regions contain {np.mean(inside):.3f}, of all points {np.average(inside, weights=size):.3f}, of the worst tenth {np.quantile(inside, 0.1):.3f}")
    print(f"{flags} cases flagged")


if __name__ == "__main__":
    main()
