#!/usr/bin/env python3
"""Fits the weights of BoxJudge, and measures how good its probability is on other sequences.

    bench/evaluation/fit_judge.py SIGNS FOLDS [--fit 0,1,2]

SIGNS is the file of asterism-signs. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; lines that begin with # are comments.
Needs NumPy.

The probability that a box overlaps the object is a logistic regression on the averages of the likenesses. It is fitted by maximum
likelihood on the one pass of all trackers, in the folds of --fit, where every sequence and tracker has the same weight, shared by its
frames; a small quadratic penalty (1e-3 in units of the deviations) keeps the weights finite. What is positive is a box without any
overlap, also where the object is absent. Two thresholds are compared: the probability of 1/2, and the response that was used before.

Prints the weights for box_judge.cpp and tables in Markdown: for the folds on which nothing was fitted, and out of fold, where each
fold is predicted by a fit to the others.
"""

import argparse
import csv
import sys

import numpy as np

from cross_validation import BadInput, read_folds

LIKENESSES = ("shape", "levels", "colors")
PENALTY = 1e-3


def fit(x, right, weight):
    """[constant, weights...] of maximum likelihood, by Newton's method with bounded steps."""
    weight = weight / weight.sum()
    mean = weight @ x
    deviation = np.sqrt(weight @ (x - mean) ** 2) + 1e-12
    design = np.column_stack([np.ones(len(x)), (x - mean) / deviation])
    penalty = PENALTY * np.diag([0] + [1] * x.shape[1])
    beta = np.zeros(design.shape[1])
    for _ in range(200):
        p = 1 / (1 + np.exp(-design @ beta))
        hessian = (design * (weight * p * (1 - p))[:, None]).T @ design + penalty
        step = np.linalg.solve(hessian, design.T @ (weight * (p - right)) + penalty @ beta)
        length = np.linalg.norm(step)
        beta -= step * min(1, 4 / max(length, 1e-12))
        if length < 1e-9:
            break
    return np.concatenate([[beta[0] - beta[1:] @ (mean / deviation)], beta[1:] / deviation])


def predict(weights, x):
    return 1 / (1 + np.exp(-(weights[0] + x @ weights[1:])))


def area(score, right, weight):
    """The area under the ROC curve: how often a right box has the higher score."""
    _, rank = np.unique(score, return_inverse=True)
    wrong_at, right_at = np.bincount(rank, weight * ~right), np.bincount(rank, weight * right)
    total = wrong_at.sum() * right_at.sum()
    return (right_at @ (np.cumsum(wrong_at) - wrong_at / 2)) / total if total > 0 else float("nan")


def precision_at(score, right, weight, recall):
    order = np.argsort(score, kind="stable")
    found = np.cumsum((weight * ~right)[order])
    if found[-1] == 0:
        return float("nan")
    last = min(np.searchsorted(found, recall * found[-1] - 1e-12), len(found) - 1)
    return found[last] / np.cumsum(weight[order])[last]


def flag(flagged, right, weight):
    """(precision, recall) of a flag for wrong boxes."""
    hit = weight[flagged & ~right].sum()
    return hit / max(weight[flagged].sum(), 1e-12), hit / max(weight[~right].sum(), 1e-12)


def read(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    missing = {"tracker", "kind", "sequence", "overlap", "weak", *LIKENESSES} - set(rows[0] if rows else ())
    if missing:
        raise BadInput(f"{path}: the columns {', '.join(sorted(missing))} are missing")
    for number, row in enumerate(rows, 2):
        for name in ("overlap", *LIKENESSES):
            try:
                float(row[name])
            except (TypeError, ValueError):
                raise BadInput(f"{path}:{number}: the {name} {row[name]} is not a number") from None
    return rows


class Frames:
    def __init__(self, rows, fold_of):
        unknown = {row["sequence"] for row in rows} - set(fold_of)
        if unknown:
            raise BadInput(f"no fold has {', '.join(sorted(unknown))}")
        self.tracker, self.kind = (np.array([row[key] for row in rows]) for key in ("tracker", "kind"))
        self.fold = np.array([fold_of[row["sequence"]] for row in rows])
        self.x = np.array([[float(row[name]) for name in LIKENESSES] for row in rows])
        self.right = np.array([float(row["overlap"]) > 0 for row in rows])
        self.weak = np.array([row["weak"] == "1" for row in rows])
        video = np.array([f"{row['tracker']}/{row['kind']}/{row['sequence']}" for row in rows])
        names, index, count = np.unique(video, return_inverse=True, return_counts=True)
        self.weight = 1 / count[index]
        self.video, self.videos = index, names


def table(frames, probability, chosen, title):
    yield f"| {title} | videos, of these with wrong boxes | without overlap | area | precision at recall 0.5 | "\
          "precision, recall below 1/2 | of a weak response |"
    yield "|---|---|---|---|---|---|---|"
    for tracker in dict.fromkeys(frames.tracker):
        for kind in dict.fromkeys(frames.kind):
            for name in ("sequences", "frames"):
                of = chosen & (frames.tracker == tracker) & (frames.kind == kind)
                if not of.any():
                    continue
                right, p = frames.right[of], probability[of]
                weight = frames.weight[of] if name == "sequences" else np.ones(of.sum())
                wrong_videos = len(np.unique(frames.video[of][~right]))
                yield (f"| {tracker}, {kind}, by {name} | {len(np.unique(frames.video[of]))}, {wrong_videos} | "
                       f"{100 * (weight @ ~right) / weight.sum():.1f} % | {area(p, right, weight):.3f} | "
                       f"{precision_at(p, right, weight, 0.5):.2f} | "
                       + ", ".join(f"{v:.2f}" for v in flag(p < 0.5, right, weight)) + " | "
                       + ", ".join(f"{v:.2f}" for v in flag(frames.weak[of], right, weight)) + " |")
    yield ""


def reliability(frames, probability, chosen):
    yield "| probability | " + " | ".join(f"{i / 10:.1f} to {(i + 1) / 10:.1f}" for i in range(10)) + " |"
    yield "|---" * 11 + "|"
    for tracker in dict.fromkeys(frames.tracker):
        of = chosen & (frames.tracker == tracker) & (frames.kind == "pass")
        bins = np.minimum((probability[of] * 10).astype(int), 9)
        weight = frames.weight[of]
        shares = []
        for i in range(10):
            inside = weight[bins == i].sum()
            share = (weight * frames.right[of])[bins == i].sum() / inside if inside > 0 else float("nan")
            shares.append(f"{share:.2f} ({100 * inside / weight.sum():.0f} %)")
        yield f"| {tracker} | " + " | ".join(shares) + " |"
    yield ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("signs")
    parser.add_argument("folds")
    parser.add_argument("--fit", default="0,1,2", help="the folds whose frames the weights are fitted on")
    options = parser.parse_args()
    fold_of = {name: fold for fold, names in read_folds(options.folds).items() for name in names}
    frames = Frames(read(options.signs), fold_of)
    one_pass = frames.kind == "pass"
    fitted = np.isin(frames.fold, options.fit.split(","))

    def fit_on(which):
        return fit(frames.x[which], frames.right[which], frames.weight[which])

    weights = fit_on(fitted & one_pass)
    print(f"constant {weights[0]:.3f}, " + ", ".join(f"{n} {w:.3f}" for n, w in zip(LIKENESSES, weights[1:])) + "\n")
    probability = predict(weights, frames.x)
    print("\n".join(table(frames, probability, ~fitted, "folds not fitted")))
    for fold in np.unique(frames.fold):
        here = frames.fold == fold
        probability[here] = predict(fit_on(~here & one_pass), frames.x[here])
    print("\n".join(table(frames, probability, np.ones(len(probability), bool), "out of fold, all")))
    print("\n".join(reliability(frames, probability, np.ones(len(probability), bool))))


if __name__ == "__main__":
    try:
        main()
    except (BadInput, OSError) as error:
        sys.exit(f"fit_judge.py: {error}")
