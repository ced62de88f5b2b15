#!/usr/bin/env python3
"""How often the 95 % regions of asterism.pose.fuse contain a truth that is known, under noise that is known.

coverage.py [FOLDER] [--seeds A B] [--frames N ...]: FOLDER has mouse, fly and paw, as the page docs/pose.md describes them; without it, only paths
of random motions. One line a kind of recording, the mean over seeds A .. B - 1.
"""

import argparse
import pathlib
import warnings

import asterism.pose as pose
import numpy as np
import random_cases
from scipy.ndimage import gaussian_filter1d

from compare import contained


def cameras_around(count):
    return [
        pose.Camera([[800, 0, 640], [0, 800, 512], [0, 0, 1]], np.array([0, 2 * np.pi * v / max(count, 3), 0]), [0, 0, 10.0], size=(1280, 1024))
        for v in range(count)
    ]


def smooth(rng, frames, joints, dim):
    """Random walks about places that differ."""
    return random_cases.walk(rng, frames, joints, dim) + rng.normal(0, 0.5, (1, joints, dim))


def bursts(rng, frames, joints, dim):
    return rng.normal(0, 0.5, (joints, dim)) + random_cases.bursts(rng, frames, joints, dim)


def of_animals(folder):
    """(name, path (T, J, D), cameras): what networks and people saw, filtered."""
    table = np.genfromtxt(folder / "mouse" / "points3d.csv", delimiter=",", skip_header=2)[:, 1:]
    mouse = table.reshape(len(table), -1, 3)
    mouse = mouse[:, np.isfinite(mouse).all((0, 2))]
    mouse_cameras = [c for c in pose.read_cameras(folder / "mouse" / "calibration.toml") if c.name != "side"]
    paw = np.concatenate([np.median([pose.read_detections(folder / "paw" / f"{side}.seed{k}.csv").points[:1000] for k in range(5)], 0) for side in ("left", "right")], 1)
    fly_cameras = pose.read_cameras(folder / "fly" / "calibration.toml")
    views = np.array([np.nanmedian([pose.read_detections(folder / "fly" / f"{c.name}.seed{k}.csv").points for k in range(3)], 0) for c in fly_cameras])
    import peers

    fly = peers.interpolated(peers.triangulated(views, fly_cameras))
    fly = fly[:, np.isfinite(fly).all((0, 2))]
    return [(name, gaussian_filter1d(path, 1, axis=0), cameras) for name, path, cameras in (("mouse", mouse, mouse_cameras), ("fly", fly, fly_cameras), ("paw", paw, None))]


def seen(rng, truth, cameras, views, noise, wrong, missing):
    """Detections with noise [px], another one for each view and joint; some anywhere in the image, some missing."""
    image = np.array([c.project(truth) for c in cameras]) if cameras else np.array([truth] * views)
    deviation = noise * np.exp(rng.normal(0, 0.4, (len(image), 1, truth.shape[1], 1)))
    found = image + rng.normal(0, 1, image.shape) * deviation
    is_wrong = rng.random(found.shape[:3]) < wrong
    low, high = image.min((0, 1, 2)) - 50 * noise, image.max((0, 1, 2)) + 50 * noise
    found[is_wrong] = rng.uniform(low, high, (is_wrong.sum(), 2))
    found[rng.random(found.shape[:3]) < missing] = np.nan
    return found


def recordings(rng, animals, frames):
    """(name, truth, cameras, views, noise) of about so many frames."""
    for name, motion in (("smooth", smooth), ("bursts", bursts)):
        yield f"{name}, 1 view", motion(rng, frames, 8, 2) * 100, None, 1, 1.0
        yield f"{name}, 2 detectors", motion(rng, frames, 8, 2) * 100, None, 2, 1.0
        for views in (2, 4):
            yield f"{name}, {views} cameras", motion(rng, frames, 8, 3), cameras_around(views), views, 1.0
    for name, path, cameras in animals:
        if len(path) < frames:
            continue
        begin = int(rng.integers(0, len(path) - frames + 1))
        piece = path[begin : begin + frames]
        if cameras is None:
            yield f"{name}, 1 view", piece, None, 1, 1.0
        else:
            chosen = rng.choice(len(cameras), 2, replace=False)
            yield f"{name}, 2 cameras", piece, [cameras[c] for c in chosen], 2, 2.0
            yield f"{name}, 3 cameras", piece, cameras, 3, 2.0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path, nargs="?")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 5))
    parser.add_argument("--frames", type=int, nargs="+", default=(30, 100, 300, 1000))
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)
    animals = of_animals(options.folder) if options.folder else []
    everything = {}
    for frames in options.frames:
        for disturbance, wrong, missing in (("clean", 0, 0), ("disturbed", 0.1, 0.2)):
            inside, errors = {}, {}
            for seed in range(*options.seeds):
                rng = np.random.default_rng((seed, frames, int(100 * wrong)))
                for name, truth, cameras, views, noise in recordings(rng, animals, frames):
                    found = pose.fuse(seen(rng, truth, cameras, views, noise, wrong, missing), None, cameras)
                    inside.setdefault(name, []).append(contained(found, truth).mean())
                    errors.setdefault(name, []).append(np.sqrt(((found.points - truth) ** 2).sum(-1).mean()))
            for name, shares in inside.items():
                print(f"{frames:5} frames, {disturbance:9}, {name:20} contain {np.mean(shares):.3f} ({min(shares):.3f} to {max(shares):.3f}); root mean square error {np.mean(errors[name]):.4g}", flush=True)
                everything.setdefault(frames, []).append(np.mean(shares))
    for frames, shares in everything.items():
        shares = np.array(shares)
        print(f"{frames:5} frames: {np.mean((shares >= 0.9) & (shares <= 0.98)):.0%} of {len(shares)} kinds within 90 to 98 %, {np.mean((shares >= 0.93) & (shares <= 0.97)):.0%} within 93 to 97 %; mean {shares.mean():.3f}, {shares.min():.3f} to {shares.max():.3f}")


if __name__ == "__main__":
    main()
