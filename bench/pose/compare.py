#!/usr/bin/env python3
"""asterism.pose beside what people use: detections that are missing or wrong, and one network against the consensus of others.

compare.py FOLDER [--seeds N] [--only mouse|fly|networks|swaps|stream|speed]: FOLDER has mouse, fly and paw, as the page docs/pose.md describes them.
"""

import argparse
import pathlib
import resource
import time

import asterism.pose as pose
import numpy as np
import peers


def mouse(folder):
    cameras = [c for c in pose.read_cameras(folder / "mouse" / "calibration.toml") if c.name != "side"]  # its calibration is the top camera's
    views = [pose.read_detections(folder / "mouse" / f"{c.name}.csv") for c in cameras]
    names = views[0].joints
    lines = (folder / "mouse" / "skeleton.csv").read_text().split()[1:]
    return np.array([v.points for v in views]), cameras, [tuple(names.index(n) for n in line.split(",")) for line in lines]


def fly(folder, network=0):
    cameras = pose.read_cameras(folder / "fly" / "calibration.toml")
    views = [pose.read_detections(folder / "fly" / f"{c.name}.seed{network}.csv") for c in cameras]
    return np.array([v.points for v in views]), cameras, [(j, j + 1) for j in range(0, len(views[0].joints), 2)]


def corrupted(detections, cameras, seed):
    """20 % of the detections anywhere in the image, 30 % missing, one view missing; and which views are left."""
    rng = np.random.default_rng(seed)
    found = detections.copy()
    for view, camera in enumerate(cameras):
        is_wrong = (rng.random(found.shape[1:3]) < 0.2) & np.isfinite(found[view, ..., 0])
        found[view][is_wrong] = rng.uniform((0, 0), camera.size, (is_wrong.sum(), 2))
    found[rng.random(found.shape[:3]) < 0.3] = np.nan
    left = [view for view in range(len(cameras)) if view != seed % len(cameras)]
    return found[left], [cameras[view] for view in left], left


def robustness(name, detections, cameras, skeleton, seeds):
    reference = peers.triangulated(detections, cameras)
    print(f"{name}: median error over joints, in the cameras' unit; reference: least squares of all views and detections")
    totals = {}
    for seed in seeds:
        broken, left_cameras, left = corrupted(detections, cameras, seed)
        # A joint that only one of these views ever sees has no depth.
        is_judged = (np.isfinite(detections[left][..., 0]).sum(0) >= 2).mean(0) > 0.2
        plain = peers.triangulated(broken, left_cameras)
        robust, agreeing = peers.ransac(broken, left_cameras)
        paths = {
            "triangulation": peers.interpolated(plain), "median": peers.median_filtered(plain), "Savitzky-Golay": peers.savitzky_golay(peers.median_filtered(plain)),
            "one-euro": peers.one_euro(peers.median_filtered(plain)), "RANSAC, median": peers.median_filtered(robust),
        }
        start = time.perf_counter()
        paths["Anipose"] = peers.anipose(agreeing, left_cameras, robust, skeleton)
        seconds = time.perf_counter() - start
        start = time.perf_counter()
        fused = pose.fuse(broken, None, left_cameras, skeleton)
        paths["asterism"] = fused.points
        print(f"  seed {seed}: Anipose {seconds:.1f} s, asterism {time.perf_counter() - start:.2f} s", flush=True)
        paths["(the same views, undisturbed)"] = peers.triangulated(detections[left], left_cameras)
        for method, path in paths.items():
            error = np.nanmedian(np.linalg.norm(path - reference, axis=-1)[:, is_judged], axis=0)
            totals.setdefault(method, []).append(float(np.median(error)))
        inside = contained(fused, reference)[:, is_judged][np.isfinite(reference[:, is_judged, 0])]
        totals.setdefault("95 % regions contain", []).append(float(inside.mean()))
    for method, errors in totals.items():
        print(f"  {method:32}" + " ".join(f"{e:9.4f}" for e in errors) + f"   mean {np.mean(errors):.4f}")
    best = min(np.mean(e) for m, e in totals.items() if m not in ("asterism", "95 % regions contain") and not m.startswith("("))
    print(f"  asterism / best peer: {np.mean(totals['asterism']) / best:.3f}")


def networks(folder):
    """Each network alone, smoothed, against the median of the others [px]; EKS has the variance of all networks."""
    recordings = {"paw left": [pose.read_detections(folder / "paw" / f"left.seed{k}.csv") for k in range(5)],
                  "paw right": [pose.read_detections(folder / "paw" / f"right.seed{k}.csv") for k in range(5)]}
    for camera in "ABC":
        recordings[f"fly {camera}"] = [pose.read_detections(folder / "fly" / f"Cam-{camera}.seed{k}.csv") for k in range(3)]
    for name, found in recordings.items():
        points = np.array([f.points for f in found])
        variance, deviation = np.nanvar(points, axis=0), pose.network_deviation(points)
        totals, inside = {}, {}
        for k in range(len(points)):
            consensus = np.nanmedian(np.delete(points, k, axis=0), axis=0)
            known = np.isfinite(consensus[..., 0])
            fused = {"asterism, one network": pose.fuse(points[k], found[k].confidence), "asterism, deviation": pose.fuse(points[k], found[k].confidence, deviation=deviation)}
            paths = {
                "as detected": points[k], "EKS": peers.eks(points[k], variance),
                "EKS, one variance": peers.eks(points[k], np.broadcast_to(np.nanmean(variance, 0), variance.shape)), **{name: result.points for name, result in fused.items()},
            }
            for method, path in paths.items():
                totals.setdefault(method, []).append(np.nanmean(np.linalg.norm(path - consensus, axis=-1)))
            for method, result in fused.items():
                inside.setdefault(method, []).append(contained(result, consensus)[known].mean())
        best = min(np.mean(totals["EKS"]), np.mean(totals["EKS, one variance"]))
        print(f"{name}: mean error [px]", flush=True)
        for method, errors in totals.items():
            regions = f"; 95 % regions contain {np.mean(inside[method]):.3f} ({min(inside[method]):.3f} to {max(inside[method]):.3f})" if method in inside else ""
            print(f"  {method:22} {np.mean(errors):.3f}, {np.mean(errors) / best:.3f} of EKS{regions}")


def contained(found, reference):
    """(T, J): whether the 95 % regions contain the reference; False where that is missing."""
    difference = np.nan_to_num(found.points - reference)
    limit = {2: 5.991, 3: 7.815}[difference.shape[-1]]
    square = np.einsum("tji,tji->tj", difference, np.linalg.solve(found.covariance, difference[..., None])[..., 0])
    return (square < limit) & np.isfinite(reference).all(-1)


def swaps(folder, seeds):
    """Left and right exchanged in stretches of 1 to 30 frames, a fifth of all; the mouse's own pairs, and neighbouring joints of the fly."""
    recordings = {f"mouse {view}": folder / "mouse" / f"{view}.csv" for view in ("back", "mid", "top")}
    recordings |= {f"fly {camera}": folder / "fly" / f"Cam-{camera}.seed0.csv" for camera in "ABC"}
    for name, path in recordings.items():
        view = pose.read_detections(path)
        pairs = pose.left_right_pairs(view.joints) or [(j, j + 1) for j in range(0, len(view.joints), 2)]
        for seed in seeds:
            rng, points = np.random.default_rng(seed), view.points.copy()
            is_swapped = np.zeros((len(points), len(pairs)), bool)
            for p, (a, b) in enumerate(pairs):
                t = 0
                while t < len(points):
                    if rng.random() < 0.02:
                        length = rng.integers(1, 30)
                        is_swapped[t : t + length, p] = True
                        t += length
                    t += 1
                where = is_swapped[:, p]
                points[where, a], points[where, b] = view.points[where, b], view.points[where, a]
            found = pose.exchange_back(points, pairs).swapped
            seen = np.isfinite(points[..., 0])
            both = np.stack([seen[:, a] & seen[:, b] for a, b in pairs], 1)
            kept = pose.exchange_back(view.points, pairs).swapped
            print(f"{name}, seed {seed}: {is_swapped.mean():.1%} swapped, wrong {(found != is_swapped)[both].mean():.2%}; of nothing swapped, {kept[both].mean():.2%}")


def stream(folder):
    """A window that slides, frame by frame: time, and how far it is from fuse of all frames."""
    def shown(name, seen, cameras, reference):
        half = seen.shape[1] // 2
        recorded, batch = pose.fuse(seen[:, :half], None, cameras), pose.fuse(seen, None, cameras)
        online = pose.Stream(recorded, cameras)
        seconds, points, inside = [], [], []
        for frame in seen.swapaxes(0, 1)[half:]:
            start = time.process_time()
            found = online.push(frame)
            seconds.append(time.process_time() - start)
            points.append(found.points)
            inside.append(found.covariance)
        points = np.array(points)
        known = np.isfinite(reference[half:]).all(-1)
        errors = [np.median(np.linalg.norm(path - reference[half:], axis=-1)[known]) for path in (points, batch.points[half:])]
        square = np.einsum("tji,tji->tj", np.nan_to_num(points - reference[half:]), np.linalg.solve(np.array(inside), np.nan_to_num(points - reference[half:])[..., None])[..., 0])
        away = np.median(np.linalg.norm(points - batch.points[half:], axis=-1))
        print(f"{name}: {np.median(seconds) * 1e3:.2f} ms of CPU a frame (95 %: {np.percentile(seconds, 95) * 1e3:.2f} ms); median error {errors[0]:.4f}, fuse {errors[1]:.4f}; median distance {away:.4f}; 95 % regions contain {(square < 7.815)[known].mean():.3f}")

    truth, seen, cameras = simulated(2000, 15, 4)
    shown("15 joints, 4 views", seen, cameras, truth)
    for name, (detections, cameras, _) in (("mouse", mouse(folder)), ("fly", fly(folder))):
        for seed in range(2):
            broken, left_cameras, _ = corrupted(detections, cameras, seed)
            shown(f"{name}, seed {seed}", broken, left_cameras, peers.triangulated(detections, cameras))


def simulated(frames, joints, views):
    """Paths in space, detections with 10 % outliers and 10 % missing, cameras."""
    rng = np.random.default_rng(1)
    cameras = [pose.Camera([[800, 0, 640], [0, 800, 512], [0, 0, 1]], np.array([0, 2 * np.pi * v / views, 0]), [0, 0, 10.0], size=(1280, 1024)) for v in range(views)]
    truth = np.cumsum(np.cumsum(rng.normal(0, 1e-4, (frames, joints, 3)), 0), 0)
    truth = np.sin(truth) + rng.normal(0, 0.5, (joints, 3))
    seen = np.array([c.project(truth) for c in cameras]) + rng.normal(0, 1, (views, frames, joints, 2))
    is_wrong = rng.random(seen.shape[:3]) < 0.1
    seen[is_wrong] = rng.uniform((0, 0), (1280, 1024), (is_wrong.sum(), 2))
    seen[rng.random(seen.shape[:3]) < 0.1] = np.nan
    return truth, seen, cameras


def speed(frames, joints=15, views=4):
    truth, seen, cameras = simulated(frames, joints, views)
    start, used = time.perf_counter(), time.process_time()
    found = pose.fuse(seen, None, cameras)
    seconds, used = time.perf_counter() - start, time.process_time() - used
    error = found.points - truth
    inside = contained(found, truth)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{frames} frames, {joints} joints, {views} views: {seconds:.1f} s ({used:.1f} s of CPU), {memory:.2f} GB at most; root mean square error {np.sqrt((error**2).sum(-1).mean()):.4f}, 95 % regions contain {inside.mean():.3f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--only", choices=["mouse", "fly", "networks", "swaps", "stream", "speed"])
    parser.add_argument("--frames", type=int, default=100000)
    options = parser.parse_args()
    chosen = [options.only] if options.only else ["mouse", "fly", "networks", "swaps", "stream", "speed"]
    for name in chosen:
        if name in ("mouse", "fly"):
            robustness(name, *(mouse if name == "mouse" else fly)(options.folder), range(options.seeds))
        elif name == "networks":
            networks(options.folder)
        elif name == "swaps":
            swaps(options.folder, range(options.seeds))
        elif name == "stream":
            stream(options.folder)
        else:
            speed(options.frames)
