"""Compares the measures of bench/evaluation with the formulas of the toolkits, written a second time with
NumPy and SciPy.

Usage: measures_oracle.py ORACLE, the program built from measures_oracle.cpp. Cases are random, from fixed seeds.
Ends with 77 (skipped) without NumPy and SciPy.
"""

import itertools
import subprocess
import sys
import unittest

try:
    import numpy as np
    from scipy import stats
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

TAGS = ["camera_motion", "occlusion", "size_change"]
SKIPPED, STARTED, FAILED, TRACKED = 0, 1, 2, 3
SPECIAL = {SKIPPED, STARTED, FAILED}


def ask(case):
    """The oracle's lines for a case of nested numbers and words: (name, values) each."""

    def words(item):
        if isinstance(item, (list, tuple, np.ndarray)):
            return " ".join(words(each) for each in item)
        return repr(float(item)) if not isinstance(item, str) else item

    done = subprocess.run([ORACLE], input=words(case), capture_output=True, text=True, check=True)
    lines = [line.split() for line in done.stdout.splitlines()]
    return [(line[0], np.array([float(word) for word in line[1:]])) for line in lines]


def sized(values):
    return [len(values), list(values)]


# Supervised runs. A run is a pair (codes, overlaps); a sequence is a dictionary with the runs of each
# tracker.


def random_run(random, length, skill):
    codes, overlaps = np.full(length, TRACKED), np.zeros(length)
    start = 0
    while start < length:
        codes[start] = STARTED
        survives = int(random.geometric(1 / (skill * 120)))
        failure = start + survives
        stop = min(failure, length)
        overlaps[start + 1 : stop] = np.clip(random.normal(skill, 0.15, max(stop - start - 1, 0)), 0.01, 1)
        if failure >= length:
            break
        codes[failure] = FAILED
        codes[failure + 1 : failure + 5] = SKIPPED
        start = failure + 5
    return codes, overlaps


def random_sequence(random, length, skills):
    tags = {tag: random.random(length) < 0.1 + 0.3 * i for i, tag in enumerate(TAGS)}
    tags["size_change"][: length // 2] = False
    runs = []
    for skill in skills:
        repetitions = int(random.choice([1, 3, 15]))
        runs.append([random_run(random, length, skill) for _ in range(repetitions)])
    return {"length": length, "tags": tags, "practical": random.uniform(0.01, 0.2, length), "runs": runs}


def supervised_case(sequences, trackers, interval):
    case = ["supervised", trackers, len(sequences)]
    for sequence in sequences:
        case += [sequence["length"], len(sequence["tags"])]
        case += [[tag, marks.astype(int)] for tag, marks in sequence["tags"].items()]
        case += [sequence["practical"]]
        case += [[len(runs), [[codes, overlaps] for codes, overlaps in runs]] for runs in sequence["runs"]]
    return case + [interval]


def select(sequence, tag):
    """Indices of the frames with the tag."""
    if tag == "all":
        return np.arange(sequence["length"])
    if tag == "empty":
        return np.flatnonzero(~np.any(list(sequence["tags"].values()), axis=0))
    return np.flatnonzero(sequence["tags"][tag])


def burnt_in(codes, overlaps):
    """Overlaps, NaN in frames that do not count: special ones and those that a start's window of ten reaches."""
    window = np.zeros(19, bool)
    window[9:] = True
    starts = (codes == STARTED).astype(int)
    reached = np.convolve(starts, window.astype(int))[9 : 9 + len(codes)] > 0
    return np.where(reached | (codes != TRACKED), np.nan, overlaps)


def legacy_stack(sequences, tracker, tag, repetitions=15):
    """The frames' mean overlaps of all sequences in a row; the failures, sequences x repetitions."""
    frames, failures = [], []
    for sequence in sequences:
        chosen = select(sequence, tag)
        if len(chosen) == 0:
            continue
        matrix = np.full((repetitions, len(chosen)), np.nan)
        counts = np.full(repetitions, np.nan)
        for r, (codes, overlaps) in enumerate(sequence["runs"][tracker]):
            matrix[r] = burnt_in(codes[chosen], overlaps[chosen])
            counts[r] = np.sum(codes[chosen] == FAILED)
        valid = ~np.isnan(matrix)
        with np.errstate(invalid="ignore"):
            frames.append(np.where(valid, matrix, 0).sum(axis=0) / valid.sum(axis=0))
        failures.append(np.where(np.isnan(counts), np.nanmean(counts), counts))
    return np.concatenate(frames), np.array(failures)


def legacy_ar(sequences, tracker, tag):
    frames, failures = legacy_stack(sequences, tracker, tag)
    accuracy = np.nanmean(frames) if np.any(~np.isnan(frames)) else 0
    total = np.mean(np.sum(failures, axis=0))
    rate = total / sum(len(select(sequence, tag)) for sequence in sequences)
    return [accuracy, total, rate, np.exp(-30 * rate)]


def python_ar(sequences, tracker):
    accuracies, failures = [], []
    for sequence in sequences:
        per_run = []
        for codes, overlaps in sequence["runs"][tracker]:
            mask = np.isin(codes, list(SPECIAL), invert=True)
            for start in np.flatnonzero(codes == STARTED):
                mask[start : start + 10] = False
            per_run.append(overlaps[mask].mean() if mask.any() else 0.0)
        accuracies.append(np.mean(per_run))
        counts = [np.count_nonzero(codes == FAILED) for codes, _ in sequence["runs"][tracker]]
        failures.append(np.mean(counts))
    lengths = np.array([sequence["length"] for sequence in sequences])
    failed = np.average(failures, weights=lengths)
    return [np.average(accuracies, weights=lengths), failed, failed / lengths.mean(),
            np.exp(-30 * failed / lengths.mean())]


def legacy_curve(sequences, tracker, tag):
    longest = max(sequence["length"] for sequence in sequences)
    rows, weights = [], []
    for sequence in sequences:
        tagged = np.zeros(sequence["length"], bool)
        tagged[select(sequence, tag)] = True
        runs = sequence["runs"][tracker]
        for codes, overlaps in runs:
            n = len(codes)
            values = np.where(codes == TRACKED, overlaps, np.nan)
            # One-based, with the restart five frames after the failure.
            points = [1] + [int(f) + 1 + 5 for f in np.flatnonzero(codes == FAILED) if f + 1 + 5 <= n]
            for i, point in enumerate(points):
                closed = i + 1 < len(points)
                end = points[i + 1] if closed else n
                part = values[point - 1 : end]
                row = np.zeros(longest) if closed else np.full(longest, np.nan)
                row[: len(part)] = np.nan_to_num(part)
                rows.append(row)
                number = tagged.sum() if tag == "empty" else tagged[point - 1 : end].sum()
                weights.append(number / len(part) / len(runs))
    rows, weights = np.array(rows), np.array(weights)
    curve = np.ones(longest)
    for length in range(2, longest + 1):
        usable = ~np.isnan(rows[:, length - 1])
        with np.errstate(invalid="ignore"):
            curve[length - 1] = (np.sum(rows[usable, 1:length].mean(axis=1) * weights[usable]) /
                                 np.sum(weights[usable]))
    return curve


def python_curve(sequences, tracker):
    parts = []
    for sequence in sequences:
        for codes, overlaps in sequence["runs"][tracker]:
            overlaps = np.where(codes == TRACKED, overlaps, 0)
            starts, failures = np.flatnonzero(codes == STARTED), np.flatnonzero(codes == FAILED)
            parts += [(overlaps[s:f], False) for s, f in zip(starts, failures)]
            if len(starts) > len(failures):
                parts.append((overlaps[starts[-1] :], True))
    longest = max(len(part) for part, _ in parts)
    means, masks = np.zeros((len(parts), longest)), np.zeros((len(parts), longest))
    for i, (part, survived) in enumerate(parts):
        padded = np.pad(part, (0, longest - len(part)))
        means[i, 1:] = np.cumsum(padded[1:]) / np.arange(1, longest)
        masks[i, : len(part) if survived else longest] = 1
    return (means * masks).sum(axis=0) / masks.sum(axis=0)


def adapted(values, different, best_first):
    order = np.argsort(-values if best_first == "high" else values, kind="stable")
    ranks = np.empty(len(values))
    ranks[order] = np.arange(1, len(values) + 1)
    return [ranks[~different[i]].mean() for i in range(len(values))]


def ar_ranks(sequences, trackers, tag, practical):
    stacks = [legacy_stack(sequences, t, tag) for t in range(trackers)]
    limits = np.concatenate([sequence["practical"][select(sequence, tag)] for sequence in sequences])
    by_accuracy, by_robustness = np.zeros((2, trackers, trackers), bool)
    for i, j in itertools.permutations(range(trackers), 2):
        difference = stacks[i][0] - stacks[j][0]
        valid = ~np.isnan(difference)
        apart = True
        if valid.sum() >= 25:
            mode = "exact" if np.count_nonzero(difference[valid]) <= 15 else "approx"
            apart = stats.wilcoxon(difference[valid], correction=False, mode=mode).pvalue <= 0.05
        if practical and abs(np.mean(difference[valid] / limits[valid])) < 1:
            apart = False
        by_accuracy[i, j] = apart
        a, b = stacks[i][1].ravel(), stacks[j][1].ravel()
        by_robustness[i, j] = stats.mannwhitneyu(a, b, method="asymptotic").pvalue <= 0.05
    accuracy = np.array([legacy_ar(sequences, t, tag)[0] for t in range(trackers)])
    failures = np.array([legacy_ar(sequences, t, tag)[1] for t in range(trackers)])
    return adapted(accuracy, by_accuracy, "high"), adapted(failures, by_robustness, "low")


class Supervised(unittest.TestCase):
    def test_random_runs(self):
        random = np.random.default_rng(1)
        ranked_apart = 0
        for _ in range(6):
            skills = [0.75, 0.72, 0.5, 0.55]
            sequences = [random_sequence(random, int(n), skills) for n in random.integers(40, 300, 6)]
            low, high = 60, int(random.integers(70, max(s["length"] for s in sequences)))
            lines = dict(ask(supervised_case(sequences, len(skills), [low, high])))
            tags = sorted(TAGS + ["empty"])
            for t in range(len(skills)):
                name = f"tracker{t}."
                self.near(lines[name + "python.ar"], python_ar(sequences, t))
                curve = python_curve(sequences, t)
                self.near(lines[name + "python.curve"], curve)
                self.near(lines[name + "python.eao"], [curve[low : high + 1].mean()])
                values = {tag: legacy_ar(sequences, t, tag) for tag in tags + ["all"]}
                sizes = [sum(len(select(sequence, tag)) for sequence in sequences) for tag in tags]
                weighted = np.average([values[tag][:3] for tag in tags], axis=0, weights=sizes)
                self.near(lines[name + "legacy.mean_over_tags"][:3], weighted)
                for tag in tags + ["all"]:
                    self.near(lines[name + "legacy.ar." + tag], values[tag])
                    curve = legacy_curve(sequences, t, tag)
                    self.near(lines[name + "legacy.curve." + tag], curve)
                    self.near(lines[name + "legacy.eao." + tag], [np.nanmean(curve[low - 1 : high])])
            for practical in (False, True):
                name = "ranks.practical." if practical else "ranks."
                ranks = {tag: ar_ranks(sequences, len(skills), tag, practical) for tag in tags + ["all"]}
                ranks["mean"] = np.mean([ranks[tag] for tag in tags], axis=0)
                for tag, (accuracy, robustness) in ranks.items():
                    self.near(lines[name + "accuracy." + tag], accuracy)
                    self.near(lines[name + "robustness." + tag], robustness)
                    ranked_apart += len(set(accuracy)) > 1
        self.assertGreater(ranked_apart, 20, "some trackers differ")

    def near(self, actual, expected):
        np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-12)


class OnePass(unittest.TestCase):
    @staticmethod
    def random_boxes(random, n):
        boxes = np.column_stack([random.uniform(20, 200, (n, 2)), random.uniform(10, 80, (n, 2))])
        return np.cumsum(np.vstack([boxes[:1], random.normal(0, 1, (n - 1, 4))]), axis=0)

    def test_random_boxes(self):
        random = np.random.default_rng(2)
        case, success, precision, normalised, averages = ["one_pass", 5], [], [], [], []
        for _ in range(5):
            runs = int(random.integers(1, 4))
            case.append(runs)
            overlaps, errors, relatives, later = [], [], [], []
            for _ in range(runs):
                n = int(random.integers(30, 90))
                truth = self.random_boxes(random, n)
                result = truth + random.normal(0, 8, (n, 4))
                result[random.random(n) < 0.1] = np.nan
                result[random.random(n) < 0.05, 2] = -1
                truth[random.random(n) < 0.1, int(random.integers(4))] = 0
                truth[0] = [30, 30, 20, 20]
                case += [n, truth, result]
                for t in range(1, n):
                    if np.isnan(result[t]).any() or min(result[t, 2:]) <= 0:
                        result[t] = result[t - 1]
                result[0] = truth[0]
                valid = (truth > 0).all(axis=1)
                last, last_truth = result[:, :2] + result[:, 2:] - 1, truth[:, :2] + truth[:, 2:] - 1
                inner = np.minimum(last, last_truth) - np.maximum(result[:, :2], truth[:, :2]) + 1
                common = np.prod(np.maximum(inner, 0), axis=1)
                union = np.prod(result[:, 2:], axis=1) + np.prod(truth[:, 2:], axis=1) - common
                apart = (last + result[:, :2] - last_truth - truth[:, :2]) / 2
                with np.errstate(divide="ignore", invalid="ignore"):
                    relative = np.linalg.norm(apart / truth[:, 2:], axis=1)
                    overlap = np.where(valid, common / union, -1)
                overlaps.append(overlap)
                errors.append(np.where(valid, np.linalg.norm(apart, axis=1), -1))
                relatives.append(np.where(valid, relative, -1))
                later.append(overlap[1:][valid[1:]])
            pool = lambda values: np.concatenate(values)[:, None]
            success.append((pool(overlaps) > np.linspace(0, 1, 21)).mean(axis=0))
            precision.append((pool(errors) <= np.arange(51)).mean(axis=0))
            normalised.append((pool(relatives) <= np.arange(51) / 100).mean(axis=0))
            averages.append(np.concatenate(later).mean())
        lines = dict(ask(case))
        curves = [np.mean(curve, axis=0) for curve in (success, precision, normalised)]
        for name, curve in zip(("success", "precision", "normalised_precision"), curves):
            np.testing.assert_allclose(lines[name], curve, atol=1e-13)
        scores = [curves[0].mean(), np.mean(averages), curves[1][20], curves[2][20]]
        np.testing.assert_allclose(lines["scores"], scores, atol=1e-13)

    def test_temporal_starts(self):
        random = np.random.default_rng(3)
        for _ in range(40):
            n = int(random.integers(25, 400))
            usable = random.random(n) < random.uniform(0.2, 1)
            usable[0] = True
            frames = np.flatnonzero(usable) + 1
            last = np.flatnonzero(n - frames + 1 >= 20)[-1] + 1
            steps = np.floor(np.arange(1, last + 1e-9, last / 19)).astype(int)
            expected = frames[np.append(steps, last) - 1] - 1
            np.testing.assert_array_equal(ask(["temporal", sized(usable)])[0][1], expected)

    def test_spatial_starts(self):
        random = np.random.default_rng(4)
        away = lambda x: np.copysign(np.floor(np.abs(x) + 0.5), x)  # halves away from zero
        for _ in range(40):
            width, height = random.integers(100, 300, 2)
            x, y, w, h = box = [float(v) for v in (*random.integers(1, 90, 2), *random.integers(8, 90, 2))]
            right, bottom = x + w - 1, y + h - 1
            shift_x, shift_y = np.ceil(0.1 * w), np.ceil(0.1 * h)
            far = [away(x - 0.1 * w), away(y - 0.1 * h), away(right + 0.1 * w), away(bottom + 0.1 * h)]
            sides = [[far[0], far[1], right, bottom], [x, far[1], far[2], bottom],
                     [far[0], y, right, far[3]], [x, y, far[2], far[3]]]
            shifts = [(-shift_x, 0), (shift_x, 0), (0, -shift_y), (0, shift_y)]
            expected = [[x + right_by, y + down_by, w, h] for right_by, down_by in shifts]
            expected += [[l, t, r - l + 1, b - t + 1] for l, t, r, b in sides]
            for ratio in (0.8, 0.9, 1.1, 1.2):
                size = np.array([ratio * w, ratio * h])
                expected.append(away(np.concatenate([np.array([x + w / 2, y + h / 2]) - size / 2, size])))
            expected = np.array(expected)
            expected[:, :2] = np.maximum(expected[:, :2], 1)
            room = np.array([width, height]) - expected[:, :2] + 1
            expected[:, 2:] = np.minimum(expected[:, 2:], room)
            actual = [values for _, values in ask(["spatial", box, width, height])]
            np.testing.assert_array_equal(actual, expected)


class MultiStart(unittest.TestCase):
    def test_random_runs(self):
        random = np.random.default_rng(5)
        case, progress, sums, sizes, lengths, runs = ["multi_start", 6], [], [], [], [], []
        for length in random.integers(150, 900, 6):
            anchors = [0, 50, 100, int(length) - 1]
            case += [length, len(anchors)]
            progress.append([])
            sizes.append([])
            for anchor in anchors:
                n = int(max(length - anchor, anchor + 1))
                overlaps = np.clip(random.normal(0.6, 0.2, n), 0, 1)
                if random.random() < 0.6:
                    overlaps[int(random.integers(n)) :] *= 0.1
                visible = random.random(n) < 0.97
                case += [n, overlaps, visible.astype(int)]
                overlaps[0] = 0
                low = "".join("x" if o <= 0.1 and v else "." for o, v in zip(overlaps, visible))
                found = low.find("x" * 10)
                tracked = found if found >= 0 else n
                progress[-1].append(tracked)
                sizes[-1].append(n)
                sums.append(overlaps[:tracked].sum())
                runs.append((np.where(np.arange(n) < tracked, overlaps, 0), found < 0))
            lengths.append(length)
        shares = [sum(p) / sum(n) for p, n in zip(progress, sizes)]
        curve = np.zeros(755)
        for j in range(1, 755):
            values = [o[1 : j + 1].mean() for o, _ in runs if j < len(o)]
            values += [o[1:].sum() / (j - 1) for o, survived in runs if j >= len(o) and not survived]
            curve[j] = np.mean(values) if values else 0
        lines = dict(ask(case))
        self.assertTrue(any(survived for _, survived in runs) and not all(survived for _, survived in runs))
        np.testing.assert_allclose(lines["curve"], curve, atol=1e-12)
        accuracy = sum(sums) / sum(map(sum, progress))
        expected = [accuracy, np.average(shares, weights=lengths), curve[115:756].mean()]
        np.testing.assert_allclose(lines["score"], expected, atol=1e-12)


class Statistics(unittest.TestCase):
    @staticmethod
    def p(*case):
        return ask(case)[0][1][0]

    def test_signed_rank(self):
        random = np.random.default_rng(6)
        for n in [3, 8, 15, 16, 40, 300]:
            for rounded in (False, True):
                d = random.normal(0.3, 1, n)
                d = np.round(2 * d) / 2 if rounded else d
                kept = d[d != 0]
                if len(kept) > 15:
                    expected = stats.wilcoxon(kept, correction=False, mode="approx").pvalue
                else:
                    ranks = stats.rankdata(np.abs(kept))
                    smaller = min(ranks[kept > 0].sum(), ranks[kept < 0].sum())
                    sums = np.array(list(itertools.product([0, 1], repeat=len(kept)))) @ ranks
                    expected = min(1, 2 * np.mean(sums <= smaller))
                    if not rounded:
                        self.assertAlmostEqual(expected, stats.wilcoxon(kept, mode="exact").pvalue, 12)
                self.assertAlmostEqual(self.p("signed_rank", sized(d)), expected, 12)

    def test_rank_sum(self):
        random = np.random.default_rng(7)
        for n, m in [(3, 4), (8, 9), (9, 10), (10, 9), (10, 10), (9, 40), (60, 45)]:
            for rounded in (False, True):
                a, b = random.normal(0, 1, n), random.normal(0.5, 1, m)
                a, b = (np.round(a), np.round(b)) if rounded else (a, b)
                if min(n, m) < 10 and n + m < 20:
                    a_, b_ = (a, b) if n <= m else (b, a)
                    ranks = stats.rankdata(np.concatenate([a_, b_]))
                    own = ranks[: len(a_)].sum()
                    sums = np.array([sum(c) for c in itertools.combinations(ranks, len(a_))])
                    expected = min(1, 2 * min(np.mean(sums <= own), np.mean(sums >= own)))
                    if not rounded:
                        self.assertAlmostEqual(expected, stats.mannwhitneyu(a, b, method="exact").pvalue, 12)
                else:
                    expected = stats.mannwhitneyu(a, b, method="asymptotic").pvalue
                self.assertAlmostEqual(self.p("rank_sum", sized(a), sized(b)), expected, 12)

    def test_density_and_typical_lengths(self):
        random = np.random.default_rng(8)
        for n in [2, 5, 25, 60]:
            lengths = np.unique(random.lognormal(5.6, 0.7, n).astype(int) + 20)
            deviation = np.std(lengths)
            z = (lengths - lengths.mean()) / deviation
            pilot = (4 / (3 * len(z))) ** 0.2  # its standard deviation
            # Fourth derivative of the pilot's kernel at all differences, by its Hermite polynomial.
            u = np.subtract.outer(z, z) / pilot
            hermite = np.polynomial.hermite_e.hermeval(u, [0, 0, 0, 0, 1])
            roughness = np.mean(hermite * stats.norm.pdf(u)) / pilot**5
            bandwidth = deviation * (1 / (2 * np.sqrt(np.pi) * roughness * len(z))) ** 0.2
            lines = ask(["kde", sized(lengths), sized([1.0, 200.0, 333.3])])
            self.assertAlmostEqual(lines[0][1][0] / bandwidth, 1, 10)
            kde = stats.gaussian_kde(lengths, bandwidth / np.std(lengths, ddof=1))
            np.testing.assert_allclose([v[0] for _, v in lines[1:]], kde([1, 200, 333.3]), rtol=1e-9)

            x = np.arange(1, lengths.max() + 1)
            p = kde(x) / kde(x).sum()
            low = high = int(np.argmax(p))
            while True:  # zero-based; growth stops before the last length
                down, up = low - 1 >= 0, high + 1 < len(x) - 1
                if not down and not up:
                    low, high = 0, len(x) - 1
                    break
                if down and (not up or p[low - 1] > p[high + 1]):
                    low -= 1
                else:
                    high += 1
                if p[low : high + 1].sum() >= 0.5:
                    break
            np.testing.assert_array_equal(ask(["lengths", sized(lengths)])[0][1],
                                          [x[low], x[high], x[np.argmax(p)]])

    def test_percentiles(self):
        values = np.random.default_rng(9).normal(size=101)
        np.testing.assert_allclose(ask(["percentiles", sized(values)])[0][1], np.percentile(values, [5, 95]),
                                   atol=1e-13)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    ORACLE = sys.argv.pop(1)
    unittest.main()
