#!/usr/bin/env python3
"""Measures how reliable a tracker's confidence and lost flag are, and calibrates the confidence by nested cross-validation.

    bench/evaluation/calibration.py CANDIDATES FRAMES FOLDS OUT

CANDIDATES is a JSON file such as candidates/confidence.json: the mappings to try from the confidence c to the probability p that the
box overlaps the object by more than "overlap", and the thresholds to try for the lost flag. FRAMES is the file of `asterism-eval
export-frames`. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; lines that begin with # are comments. Needs NumPy.

The mappings:

    raw        p = c
    power      p = c^a
    logistic   p = 1 / (1 + exp(-(a + b c))), b >= 0 (Platt 1999)
    logit      the same of ln(c / (1 - c)) in place of c: beta calibration with two parameters (Kull et al. 2017)
    isotonic   the nondecreasing step function of least squared error (Zadrozny and Elkan 2002)

Power, logistic and logit are fitted by maximum likelihood. Every sequence has the same weight in each protocol, shared by its frames,
and the protocols count alike. For each fold in turn, the mapping is chosen on the other folds, where each fold is predicted by a fit
on the rest: the first mapping stays unless a later one has the lower Brier score in all protocols beyond the 95 % interval of a paired
bootstrap over sequences; a still later one replaces it by the same rule. The choice is fitted on the other folds and applied to the
fold. The resulting predictions are called `out-of-fold`. The threshold of the lost flag is chosen likewise, by the greatest F1 for
frames without any overlap: the first threshold stays unless another is better beyond the interval in all protocols.

Prints tables in Markdown, with the number of candidates; OUT is a JSON file with all of it, and the parameters fitted on all folds.
"""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np

from cross_validation import BadInput, read_folds

SURE = 0.8  # the tracker counts as sure of a frame of at least this probability
BINS = 10   # of equal width, of the expected calibration error and the reliability table
RESAMPLES = 2000
EDGE = 1e-6  # confidences are kept this far from 0 and 1 where their logarithms are taken


# Mappings: fit(c, y, w) gives the parameters, apply(parameters, c) the probabilities.

def sigmoid(z):
    return 0.5 * (1 + np.tanh(z / 2))


def inner(c):
    return np.clip(c, EDGE, 1 - EDGE)


def logit(c):
    return np.log(inner(c)) - np.log1p(-inner(c))


def fit_power(c, y, w):
    """The a of maximum likelihood, as the root of the derivative; the log-likelihood is concave in a."""
    s = -np.log(inner(c))

    def slope(log_a):
        a = math.exp(log_a)
        return np.sum(w * (np.where(y, -s, 0) + np.where(y, 0, s * np.exp(-a * s) / -np.expm1(-a * s))))

    low, high = -12.0, 12.0
    if slope(low) <= 0 or slope(high) >= 0:  # all labels are alike
        return [math.exp(low if slope(low) <= 0 else high)]
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) > 0 else (low, middle)
    return [math.exp((low + high) / 2)]


def fit_logistic(x, y, w):
    """[a, b] of maximum likelihood, by Newton's method with step halving; b = 0 if it would be negative."""
    positive = np.sum(w * y) / np.sum(w)
    constant = [float(logit(np.array(positive))), 0.0]
    if not 0 < positive < 1:
        return constant
    design = np.column_stack([np.ones_like(x), x])

    def loss(beta):
        z = design @ beta
        return np.sum(w * (np.logaddexp(0, z) - np.where(y, z, 0))) / np.sum(w)

    beta, value = np.array(constant), loss(np.array(constant))
    for _ in range(100):
        p = sigmoid(design @ beta)
        gradient = design.T @ (w * (p - y)) / np.sum(w)
        hessian = (design * (w * p * (1 - p))[:, None]).T @ design / np.sum(w)
        try:
            step = np.linalg.solve(hessian, gradient)
        except np.linalg.LinAlgError:
            break
        size = 1.0
        while size > 1e-6 and not loss(beta - size * step) <= value:
            size /= 2
        if size <= 1e-6:
            break
        beta = beta - size * step
        value, former = loss(beta), value
        if former - value < 1e-14:
            break
    return [float(b) for b in beta] if beta[1] > 0 else constant


def fit_isotonic(c, y, w):
    """[[upper end of the block, value], ...] by pooling adjacent violators."""
    ends, start = np.unique(c, return_inverse=True)
    weights = np.bincount(start, w)
    values = np.bincount(start, w * y) / weights
    blocks = []  # [end, value, weight]
    for block in zip(ends.tolist(), values.tolist(), weights.tolist()):
        blocks.append(list(block))
        while len(blocks) > 1 and blocks[-2][1] >= blocks[-1][1]:
            end, value, weight = blocks.pop()
            blocks[-1] = [end, (blocks[-1][1] * blocks[-1][2] + value * weight) / (blocks[-1][2] + weight),
                          blocks[-1][2] + weight]
    return [block[:2] for block in blocks]


def apply_isotonic(blocks, c):
    ends, values = np.array(blocks).T
    return values[np.minimum(np.searchsorted(ends, c), len(ends) - 1)]


MAPPINGS = {
    "raw": (lambda c, y, w: [], lambda _, c: c),
    "power": (fit_power, lambda p, c: inner(c) ** p[0]),
    "logistic": (fit_logistic, lambda p, c: sigmoid(p[0] + p[1] * c)),
    "logit": (lambda c, y, w: fit_logistic(logit(c), y, w), lambda p, c: sigmoid(p[0] + p[1] * logit(c))),
    "isotonic": (fit_isotonic, apply_isotonic),
}


# Measures. All take weights; those of a resample are the weights times how often the sequence was drawn.

def brier(p, y, w):
    return float(np.sum(w * (p - y) ** 2) / np.sum(w))


def area_under_roc(score, y, w):
    """The probability that a frame of the class has a higher score than another; equal scores count half."""
    _, group = np.unique(score, return_inverse=True)
    inside, outside = np.bincount(group, w * y), np.bincount(group, w * ~y)
    total = inside.sum() * outside.sum()
    return float(np.sum(inside * (np.cumsum(outside) - outside / 2)) / total) if total > 0 else math.nan


def reliability(p, y, w, bins=BINS):
    """For each bin with frames: its share of the weight, the mean probability, and the share of the class."""
    index = np.minimum((p * bins).astype(int), bins - 1)
    weight = np.bincount(index, w, bins)
    some = weight > 0
    means = [np.bincount(index, w * v, bins)[some] / weight[some] for v in (p, y)]
    return np.column_stack([weight[some] / weight.sum(), *means])


def calibration_error(p, y, w):
    share, said, true = reliability(p, y, w).T
    return float(np.sum(share * np.abs(said - true)))


def flag_quality(flag, y, w):
    """Precision, recall and F1 of a flag for the class y."""
    hit, flagged, all_of_class = (float(np.sum(w * v)) for v in (flag & y, flag, y))
    return (hit / flagged if flagged > 0 else math.nan, hit / all_of_class if all_of_class > 0 else math.nan,
            2 * hit / (flagged + all_of_class) if flagged + all_of_class > 0 else math.nan)


class Frames:
    """One tracker's frames of all protocols."""

    def __init__(self, rows, overlap):
        self.sequences = sorted({row["sequence"] for row in rows})
        self.protocols = sorted({row["protocol"] for row in rows})
        index = {name: i for i, name in enumerate(self.sequences)}
        self.sequence = np.array([index[row["sequence"]] for row in rows])
        self.protocol = np.array([row["protocol"] for row in rows])
        self.c = np.array([float(row["confidence"]) for row in rows])
        overlaps = np.array([float(row["overlap"]) for row in rows])
        if not np.all((self.c >= 0) & (self.c <= 1)):
            raise BadInput("confidences must be in [0, 1]")
        self.good, self.off = overlaps > overlap, overlaps <= 0
        self.w = np.zeros(len(rows))
        for protocol in self.protocols:
            of_it = self.protocol == protocol
            counts = np.bincount(self.sequence[of_it], minlength=len(self.sequences))
            self.w[of_it] = 1 / counts[self.sequence[of_it]]

    def of(self, sequences):
        """The frames of these sequences, as a mask."""
        return np.isin(self.sequence, [i for i, name in enumerate(self.sequences) if name in set(sequences)])


def draws(count, resamples=RESAMPLES, seed=1):
    """How often each of `count` sequences is in each resample."""
    picked = np.random.default_rng(seed).integers(count, size=(resamples, count))
    return np.array([np.bincount(row, minlength=count) for row in picked], float)


def interval(samples):
    samples = samples[~np.isnan(samples)]
    return tuple(float(q) for q in np.quantile(samples, (0.025, 0.975))) if len(samples) else (math.nan, math.nan)


def sums(frames, where, *values):
    """Weighted sums by sequence, one row per value, of which linear measures of a resample are computed."""
    return np.array([np.bincount(frames.sequence[where], (frames.w * v)[where], len(frames.sequences)) for v in values])


def brier_gain(frames, here, new, old):
    """Brier score of `new` minus that of `old`, with the interval of a paired bootstrap over sequences."""
    total, gain = sums(frames, here, np.ones_like(new), (new - frames.good) ** 2 - (old - frames.good) ** 2)
    present = total > 0
    drawn = draws(int(present.sum()))
    return (float(gain.sum() / total.sum()), *interval(drawn @ gain[present] / (drawn @ total[present])))


def better_brier(frames, where, new, old):
    """Whether `new` has the lower Brier score in all protocols beyond the interval."""
    return all(brier_gain(frames, where & (frames.protocol == protocol), new, old)[2] < 0 for protocol in frames.protocols)


def f1_samples(frames, here, threshold, drawn, present):
    flag = frames.c < threshold
    hit, flagged, off = (drawn @ row[present] for row in sums(frames, here, flag & frames.off, flag, frames.off))
    with np.errstate(invalid="ignore", divide="ignore"):
        return 2 * hit / (flagged + off)


def better_flag(frames, where, new, old):
    for protocol in frames.protocols:
        here = where & (frames.protocol == protocol)
        present = sums(frames, here, np.ones_like(frames.w))[0] > 0
        drawn = draws(int(present.sum()))
        gain = f1_samples(frames, here, new, drawn, present) - f1_samples(frames, here, old, drawn, present)
        if not interval(gain)[0] > 0:
            return False
    return True


def fit(frames, where, mapping):
    return MAPPINGS[mapping][0](frames.c[where], frames.good[where], frames.w[where])


def predict(frames, folds, mapping):
    """Probabilities of the frames of `folds`: for each fold by a fit on the other ones."""
    masks = [frames.of(sequences) for sequences in folds]
    p = np.full(len(frames.c), math.nan)
    for held_out in masks:
        rest = np.logical_or.reduce([mask for mask in masks if mask is not held_out])
        p[held_out] = MAPPINGS[mapping][1](fit(frames, rest, mapping), frames.c[held_out])
    return p


def choose_mapping(frames, folds, mappings):
    where = np.logical_or.reduce([frames.of(sequences) for sequences in folds])
    choice, p = mappings[0], predict(frames, folds, mappings[0])
    for mapping in mappings[1:]:
        q = predict(frames, folds, mapping)
        if better_brier(frames, where, q, p):
            choice, p = mapping, q
    return choice


def choose_threshold(frames, folds, thresholds):
    """The threshold of the greatest F1, averaged over the protocols, if better_flag prefers it to the first one, else the first."""
    where = np.logical_or.reduce([frames.of(sequences) for sequences in folds])

    def f1(threshold):
        return np.mean([flag_quality((frames.c < threshold)[here], frames.off[here], frames.w[here])[2]
                        for here in (where & (frames.protocol == protocol) for protocol in frames.protocols)])

    best = max(thresholds, key=f1)  # the first of equal ones
    return best if best != thresholds[0] and better_flag(frames, where, best, thresholds[0]) else thresholds[0]


def evaluate(frames, p):
    """{protocol: measures} of probabilities p."""
    result = {}
    for protocol in frames.protocols:
        here = frames.protocol == protocol
        q, y, w = p[here], frames.good[here], frames.w[here]
        sure = q >= SURE
        total = float(np.sum(w[sure]))
        drawn = draws(len(frames.sequences))
        squares, weights = sums(frames, here, (p - frames.good) ** 2, np.ones_like(p))
        areas = np.array([area_under_roc(q, y, w * d[frames.sequence[here]]) for d in drawn[:200]])
        result[protocol] = {
            "brier": brier(q, y, w), "brier_interval": interval(drawn @ squares / (drawn @ weights)),
            "brier_minus_raw": brier_gain(frames, here, p, frames.c), "ece": calibration_error(q, y, w), "area": area_under_roc(q, y, w), "area_interval": interval(areas),
            "sure": total / float(np.sum(w)),
            "sure_wrong": float(np.sum((w * ~y)[sure])) / total if total > 0 else math.nan,
            "sure_off": float(np.sum((w * frames.off[here])[sure])) / total if total > 0 else math.nan,
            "reliability": reliability(q, y, w).tolist()}
    return result


def evaluate_flag(frames, threshold):
    """{protocol: measures} of the flag c < threshold, with one threshold or one per frame, for frames without overlap."""
    result = {}
    for protocol in frames.protocols:
        here = frames.protocol == protocol
        flag, off, w = (frames.c < threshold)[here], frames.off[here], frames.w[here]
        precision, recall, f1 = flag_quality(flag, off, w)
        result[protocol] = {"precision": precision, "recall": recall, "f1": f1, "area": area_under_roc(-frames.c[here], off, w),
                            "flagged": float(np.sum(w * flag) / np.sum(w)), "off": float(np.sum(w * off) / np.sum(w))}
    return result


def calibrate(frames, folds, candidates):
    folds = {name: [s for s in sequences if s in frames.sequences] for name, sequences in folds.items()}
    folds = {name: sequences for name, sequences in folds.items() if sequences}
    missing = set(frames.sequences) - {s for sequences in folds.values() for s in sequences}
    if missing:
        raise BadInput("in no fold: " + ", ".join(sorted(missing)))
    if len(folds) < 3:
        raise BadInput("three folds at least are needed")
    mappings, thresholds = candidates["mappings"], candidates["lost"]["thresholds"]
    everything = np.ones(len(frames.c), bool)
    chosen, thresholds_chosen = {}, {}
    p, flag_below = np.full(len(frames.c), math.nan), np.full(len(frames.c), math.nan)
    for name, held_out in folds.items():
        others = [sequences for other, sequences in folds.items() if other != name]
        here = frames.of(held_out)
        chosen[name] = choose_mapping(frames, others, mappings)
        p[here] = MAPPINGS[chosen[name]][1](fit(frames, ~here, chosen[name]), frames.c[here])
        thresholds_chosen[name] = choose_threshold(frames, others, thresholds)
        flag_below[here] = thresholds_chosen[name]
    all_folds = list(folds.values())
    predictions = {"out-of-fold": p} | {mapping: predict(frames, all_folds, mapping) for mapping in mappings}
    constant = np.full(len(frames.c), math.nan)  # a prediction without the confidence, for comparison
    for held_out in all_folds:
        here = frames.of(held_out)
        constant[here] = np.sum((frames.w * frames.good)[~here]) / np.sum(frames.w[~here])
    predictions["constant"] = constant
    return {"frames": len(frames.c), "sequences": len(frames.sequences), "chosen": chosen,
            "chosen_on_all": choose_mapping(frames, all_folds, mappings),
            "parameters_on_all": {m: fit(frames, everything, m) for m in mappings if m != "isotonic"},
            "parameters_by_fold": {name: {m: fit(frames, ~frames.of(s), m) for m in mappings if m != "isotonic"}
                                   for name, s in folds.items()},
            "measures": {name: evaluate(frames, q) for name, q in predictions.items()},
            "thresholds": thresholds_chosen, "threshold_on_all": choose_threshold(frames, all_folds, thresholds),
            "lost": {"out-of-fold": evaluate_flag(frames, flag_below)}
            | {f"below {t:g}": evaluate_flag(frames, t) for t in sorted(thresholds)}}


def read_candidates(path):
    try:
        candidates = json.loads(Path(path).read_text(encoding="utf-8"))
        mappings, thresholds = candidates["mappings"], candidates["lost"]["thresholds"]
        overlap = float(candidates["overlap"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: expected \"overlap\", \"mappings\" and \"lost\" with \"thresholds\": {error}") from error
    unknown = [m for m in mappings if m not in MAPPINGS]
    if unknown or not mappings or not thresholds or not 0 <= overlap < 1:
        raise BadInput(f"{path}: mappings of {', '.join(MAPPINGS)}, thresholds, and an overlap in [0, 1) are needed")
    return candidates


def read_frames(path, overlap):
    """{tracker: Frames}"""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        trackers = list(dict.fromkeys(row["tracker"] for row in rows))
        result = {t: Frames([row for row in rows if row["tracker"] == t], overlap) for t in trackers}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: not a file of asterism-eval export-frames: {error}") from error
    if not result:
        raise BadInput(f"{path}: there are no frames")
    return result


def percent(value):
    return "-" if math.isnan(value) else f"{100 * value:.1f} %"


def tables(tracker, result):
    order = ["out-of-fold", *[n for n in result["measures"] if n != "out-of-fold"]]
    yield f"## {tracker}: {result['frames']} frames of {result['sequences']} sequences"
    yield ""
    yield f"Chosen: on all {result['chosen_on_all']}; " + ", ".join(f"fold {k} {v}" for k, v in result["chosen"].items())
    yield "Fitted on all: " + ", ".join(f"{m} {[round(x, 3) for x in p]}" for m, p in result["parameters_on_all"].items() if p)
    yield ""
    yield f"| protocol | mapping | Brier | minus raw | calibration error | area | sure (p >= {SURE}) | of these wrong | without overlap |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for protocol in next(iter(result["measures"].values())):
        for name in order:
            m = result["measures"][name][protocol]
            yield (f"| {protocol} | {name} | {m['brier']:.3f} ({m['brier_interval'][0]:.3f} to {m['brier_interval'][1]:.3f}) | "
                   f"{m['brier_minus_raw'][0]:+.3f} ({m['brier_minus_raw'][1]:+.3f} to {m['brier_minus_raw'][2]:+.3f}) | "
                   f"{m['ece']:.3f} | {m['area']:.3f} ({m['area_interval'][0]:.3f} to {m['area_interval'][1]:.3f}) | "
                   f"{percent(m['sure'])} | {percent(m['sure_wrong'])} | {percent(m['sure_off'])} |")
    yield ""
    yield (f"Lost flag chosen: on all below {result['threshold_on_all']:g}; "
           + ", ".join(f"fold {k} {v:g}" for k, v in result["thresholds"].items()))
    yield ""
    yield "| protocol | lost | flagged | without overlap | precision | recall | F1 | area |"
    yield "|---|---|---|---|---|---|---|---|"
    for protocol in next(iter(result["lost"].values())):
        for name, by_protocol in result["lost"].items():
            m = by_protocol[protocol]
            yield (f"| {protocol} | {name} | {percent(m['flagged'])} | {percent(m['off'])} | {percent(m['precision'])} | "
                   f"{percent(m['recall'])} | {m['f1']:.3f} | {m['area']:.3f} |")
    yield ""
    yield "| protocol | mapping | " + " | ".join(f"{i / BINS:g} to {(i + 1) / BINS:g}" for i in range(BINS)) + " |"
    yield "|---|---" + "|---" * BINS + "|"
    for protocol in next(iter(result["measures"].values())):
        for name in ("raw", "out-of-fold"):
            if name not in result["measures"]:
                continue
            cells = [""] * BINS
            for share, said, true in result["measures"][name][protocol]["reliability"]:
                cells[min(int(said * BINS), BINS - 1)] = f"{said:.2f}: {true:.2f} ({100 * share:.0f} %)"
            yield f"| {protocol} | {name} | " + " | ".join(cells) + " |"
    yield ""


def main(arguments):
    if len(arguments) != 4:
        raise BadInput("usage: calibration.py CANDIDATES FRAMES FOLDS OUT")
    candidates = read_candidates(arguments[0])
    folds = read_folds(arguments[2])
    trackers = read_frames(arguments[1], candidates["overlap"])
    results = {tracker: calibrate(frames, folds, candidates) for tracker, frames in trackers.items()}
    Path(arguments[3]).write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    print(f"{len(candidates['mappings'])} mappings and {len(candidates['lost']['thresholds'])} thresholds tried.\n")
    for tracker, result in results.items():
        print("\n".join(tables(tracker, result)))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except BadInput as error:
        sys.exit(f"calibration.py: {error}")
