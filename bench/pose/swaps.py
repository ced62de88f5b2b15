#!/usr/bin/env python3
"""Left and right that are swapped in recordings of a known truth: how many labels fuse(pairs=) leaves wrong, and what they cost.

swaps.py [--seeds A B]: two legs that cross and two ears, in one image or seen by two or three cameras; 0, 5 and 15 % wrong detections; swaps in one
view or in all. Labels count where both detections are right and their joints are more than six deviations of the noise apart. Errors are those of
all points, over those of fuse of the recording before the swaps: the median and the 95 % quantile.
"""

import argparse

import asterism.pose as pose
import numpy as np
from coverage import cameras_around

PAIRS = [(0, 1), (2, 3)]
KINDS = {"none": 0, "single frames": 1, "a fifth of frames": 0.2, "runs of 10": 10, "runs of 60": 60}


def animal(rng, frames, dim):
    """Its body drifts, legs 0 and 1 cross in each step, ears 2 and 3 are near each other."""
    body = np.cumsum(np.cumsum(rng.normal(0, 6e-4, (frames, dim)), 0), 0)
    body -= body.mean(0)
    body /= max(1.0, np.abs(body).max())
    phase, joints = 2 * np.pi * np.arange(frames) / rng.uniform(10, 40), np.repeat(body[:, None], 4, 1)
    for joint, side in enumerate((1, -1, 1, -1)):
        if joint < 2:
            joints[:, joint, 0] += 0.25 * np.sin(phase) * side
            joints[:, joint, 1] += 0.08 * np.maximum(0, np.cos(phase) * side)
        else:
            joints[:, joint, :2] += 0.06 * side, 0.5
        joints[:, joint, 2:] += (0.12 if joint < 2 else 0.05) * side
    return joints


def where(rng, frames, kind):
    size, found = KINDS[kind], np.zeros(frames, bool)
    if 0 < size < 1:
        return rng.random(frames) < size
    if size == 1:
        found[rng.choice(frames - 2, frames // 25, replace=False) + 1] = True
    elif size:
        for start in range(20, frames - size - 10, int(size * 3.2)):
            found[start : start + size] = True
    return found


def swap(values, swapped):
    found = values.copy()
    for p, (a, b) in enumerate(PAIRS):
        found[swapped[..., p], a], found[swapped[..., p], b] = values[swapped[..., p], b], values[swapped[..., p], a]
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 3))
    options = parser.parse_args()
    rows = []
    for views in (1, 2, 3):
        for kind in KINDS:
            for noise, wrong, missing in ((1, 0, 0), (3, 0.05, 0.1), (3, 0.15, 0.2)):
                for swapped_views in (1,) if kind == "none" else sorted({1, views}):
                    found = []
                    for seed in range(*options.seeds):
                        rng = np.random.default_rng((seed, views, list(KINDS).index(kind), int(100 * wrong)))
                        truth, cameras = animal(rng, 300, 2 if views == 1 else 3), None if views == 1 else cameras_around(views)
                        truth = truth * 200 + 500 if views == 1 else truth
                        image = np.array([c.project(truth) for c in cameras]) if cameras else truth[None]
                        seen = image + rng.normal(0, noise, image.shape)
                        is_wrong = rng.random(seen.shape[:3]) < wrong
                        seen[is_wrong] = rng.uniform(0, 1000, (is_wrong.sum(), 2))
                        seen[rng.random(seen.shape[:3]) < missing] = np.nan
                        swapped = np.zeros((views, 300, 2), bool)
                        swapped[:swapped_views] = np.stack([where(rng, 300, kind) for _ in PAIRS], -1)
                        is_good = np.isfinite(swap(seen, swapped)[..., 0]) & ~swap(is_wrong, swapped)
                        is_apart = [np.linalg.norm(image[:, :, a] - image[:, :, b], axis=-1) > 6 * noise for a, b in PAIRS]
                        is_judged = np.stack([is_good[:, :, a] & is_good[:, :, b] for a, b in PAIRS], -1) & np.stack(is_apart, -1)
                        results = pose.fuse(seen, None, cameras), pose.fuse(swap(seen, swapped), None, cameras, pairs=PAIRS), pose.fuse(swap(seen, swapped), None, cameras)
                        errors = [np.quantile(np.linalg.norm(r.points - truth, axis=-1), (0.5, 0.95)) for r in results]
                        labels = ((results[1].swapped != swapped) & is_judged).sum() / max(is_judged.sum(), 1)
                        found.append((labels, *(errors[1] / errors[0]), *(errors[2] / errors[0])))
                    found = np.mean(found, 0)
                    rows.append((kind, views, swapped_views, *found))
                    print(f"{views} views, {kind}, in {swapped_views}, {100 * wrong:.0f} % wrong: labels {found[0]:.2%}; errors {found[1]:.2f}, {found[2]:.2f}; without pairs {found[3]:.2f}, {found[4]:.2f}", flush=True)
    for name, chosen in [(kind, [r for r in rows if r[0] == kind and (r[1] == 1 or r[2] < r[1])]) for kind in KINDS] + [(kind + ", all cameras", [r for r in rows if r[0] == kind and 1 < r[1] == r[2]]) for kind in list(KINDS)[1:]] + [("all", rows)]:
        numbers = np.array([r[3:] for r in chosen])
        errors = np.exp(np.log(numbers[:, 1:]).mean(0))
        print(f"{name:30} labels {numbers[:, 0].mean():.2%} (at most {numbers[:, 0].max():.1%}); errors {errors[0]:.2f}, {errors[1]:.2f}; without pairs {errors[2]:.2f}, {errors[3]:.2f}")


if __name__ == "__main__":
    main()
