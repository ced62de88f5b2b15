#!/usr/bin/env python3
"""asterism.MDS: against scikit-learn and SciPy where they are installed, and by what has to hold of any result."""

import pickle
import subprocess
import sys
import unittest
import warnings

import asterism
import numpy as np
from stress import distances_of, stress, symmetric

try:
    import sklearn.base
    import sklearn.exceptions
    import sklearn.manifold
    import sklearn.utils.estimator_checks
except ImportError:
    sklearn = None
    print("scaling_test: without scikit-learn (Debian package python3-sklearn)")
try:
    import scipy.optimize
    import scipy.sparse
except ImportError:
    scipy = None


def precomputed(*arguments, **options):
    return asterism.MDS(*arguments, dissimilarity="precomputed", **options)


class MdsTest(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(5)

    @unittest.skipUnless(sklearn, "needs scikit-learn")
    def test_checks_of_scikit_learn(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for made in (asterism.MDS(), asterism.MDS(3, metric=False)):
                for estimator, check in sklearn.utils.estimator_checks.check_estimator(made, generate_only=True):
                    with self.subTest(str(made), check=str(check)):
                        check(estimator)
        changed = asterism.MDS(3, metric=False, n_init=2)
        self.assertEqual(sklearn.base.clone(changed).get_params(), changed.get_params())

    @unittest.skipUnless(sklearn, "needs scikit-learn")
    def test_no_more_stress_than_scikit_learn(self):
        for metric in (True, False):
            for n in (20, 60, 320):
                with self.subTest(metric=metric, n=n):
                    points = self.random.normal(size=(n, 4))
                    options = dict(metric=metric, normalized_stress=not metric, random_state=1)
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # about defaults that later versions change
                        theirs = sklearn.manifold.MDS(2, n_init=2, max_iter=300, **options).fit(points)
                    self.assertLessEqual(asterism.MDS(2, **options).fit(points).stress_, 1.005 * theirs.stress_)

    def test_exact_distances_are_met_in_any_dimension(self):
        for dim in (1, 2, 3, 5, 12, 50):
            with self.subTest(dim=dim):
                points = self.random.normal(size=(60, dim))
                made = precomputed(dim, eps=1e-9, n_init=None if dim <= 12 else 2).fit(distances_of(points))
                self.assertEqual(made.embedding_.shape, (60, dim))
                self.assertLess(made.stress_, 1e-9)
                np.testing.assert_allclose(distances_of(made.embedding_), distances_of(points), atol=1e-4)

    @unittest.skipUnless(scipy, "needs SciPy")
    def test_ends_at_a_minimum(self):
        # Missing pairs, uneven weights and losses: what a tolerance that is enough for whole matrices leaves far above the minimum.
        n = 20
        i, j = np.triu_indices(n, 1)
        for loss, dim, noise in (("quadratic", 2, 0), ("quadratic", 5, 0.2), ("huber", 2, 0.2), ("geman-mcclure", 3, 0.2), ("quadratic", 20, 0.1)):
            with self.subTest(loss=loss, dim=dim):
                plane = distances_of(self.random.normal(size=(n, min(dim, 5)))) * symmetric(np.exp(self.random.normal(scale=noise, size=(n, n))))
                distances = np.where(symmetric(self.random.random((n, n)) < 0.5), np.nan, plane)
                weights = symmetric(np.exp(2 * self.random.normal(size=(n, n))))
                made = precomputed(dim, loss=loss, scale=None if loss == "quadratic" else 0.3).fit(distances, weights=weights)
                known = ~np.isnan(distances[i, j])
                d, w = distances[i, j][known], weights[i, j][known]

                def of(x):
                    square = (d - np.linalg.norm(np.diff(x.reshape(n, dim)[np.array([i, j]).T[known]], axis=1)[:, 0], axis=1)) ** 2
                    if loss == "huber":
                        square = np.where(square <= 0.09, square, 0.6 * np.sqrt(square) - 0.09)
                    return np.sum(w * (square if loss != "geman-mcclure" else square / (1 + square / 0.09)))

                least = scipy.optimize.minimize(of, made.embedding_.ravel(), options={"maxiter": 100}).fun
                self.assertAlmostEqual(of(made.embedding_), made.stress_, delta=1e-9 * np.sum(w * d**2))
                self.assertLessEqual(made.stress_ - least, 1e-4 * least + 1e-7 * np.sum(w * d**2))

    def test_is_mds_in_two_and_three_dimensions(self):
        for dim in (2, 3):
            distances = distances_of(self.random.normal(size=(15, dim))) * symmetric(np.exp(self.random.normal(scale=0.05, size=(15, 15))))
            weights = symmetric(self.random.uniform(0.5, 2, (15, 15)))
            anchors = np.full((15, dim), np.nan)
            anchors[:4] = self.random.normal(size=(4, dim))
            distances[3, 9] = distances[9, 3] = np.nan
            for more in ({}, {"weights": weights}, {"anchors": anchors, "anchor_weights": 2}, {"anchors": anchors, "anchor_weights": np.inf}):
                with self.subTest(dim=dim, given=list(more)):
                    made = precomputed(dim, eps=1e-9).fit(distances, **more)
                    self.assertAlmostEqual(made.stress_ / asterism.mds(distances, dim=dim, **more).stress, 1, places=6)
                    if not "anchors" in more:
                        self.assertAlmostEqual(stress(made.embedding_, distances, more.get("weights", 1.0)) / made.stress_, 1, places=9)
            np.testing.assert_array_equal(made.embedding_[:4], anchors[:4])
            masked = np.ma.masked_invalid(distances)
            np.testing.assert_array_equal(precomputed(dim).fit(masked).embedding_, precomputed(dim).fit(distances).embedding_)

    def test_links_between_most_pairs(self):
        # L-BFGS without a factorisation, with points that are fixed, pulled, or free; and vectors of more links than fit on a stack.
        for n, share in ((90, 1), (90, 0.5), (1100, 1)):
            points = self.random.normal(size=(n, 3))
            distances = np.where(symmetric(self.random.random((n, n))) < share, distances_of(points), np.nan)
            anchors = np.full((n, 2), np.nan)
            anchors[:3] = points[:3, :2]
            for more in ({}, {"anchors": anchors, "anchor_weights": 1e-3}, {"anchors": anchors, "anchor_weights": np.inf}):
                with self.subTest(n=n, share=share, given=more.get("anchor_weights")):
                    made = precomputed(2, eps=1e-7, n_init=1).fit(distances, **more)
                    x = made.embedding_
                    held = np.zeros_like(x)
                    if more and np.isfinite(more["anchor_weights"]):
                        held[:3] = x[:3] - anchors[:3]
                    self.assertAlmostEqual((stress(x, distances) + 1e-3 * np.sum(held**2)) / made.stress_, 1, places=9)
                    offsets = x[:, None] - x
                    lengths = distances_of(x) + np.eye(n)
                    forces = np.nansum((1 - distances / lengths)[..., None] * offsets, axis=1) + 1e-3 * held
                    self.assertLess(np.abs(forces[3 if more and not held.any() else 0 :]).max(), 1e-5 * n)

    def test_non_metric_keeps_the_order_alone(self):
        points = self.random.normal(size=(30, 2))
        distances = distances_of(points)
        made = precomputed(2, metric=False, eps=1e-5).fit(distances**3 + 7 * (1 - np.eye(30)))
        self.assertLess(made.stress_, 5e-3)
        i, j = np.triu_indices(30, 1)
        reached = distances_of(made.embedding_)[i, j]
        self.assertGreater(np.corrcoef(reached, distances[i, j])[0, 1], 0.999)
        self.assertTrue((np.diff(made.disparities_[np.argsort(distances[i, j])]) >= 0).all())
        # Kruskal's stress-1, of the disparities, which are the nearest to the distances of all that have their order.
        self.assertAlmostEqual(np.sqrt(np.sum((reached - made.disparities_) ** 2) / np.sum(reached**2)), made.stress_, places=6)
        new = self.random.normal(size=(5, 2))
        away = np.linalg.norm(new[:, None] - points, axis=2)
        again = np.linalg.norm(made.transform(away**3 + 7)[:, None] - made.embedding_, axis=2)
        self.assertGreater(np.corrcoef(again.ravel(), away.ravel())[0, 1], 0.99)

    @unittest.skipUnless(sklearn, "needs scikit-learn")
    def test_points_in_one_place(self):
        for metric in (True, False):
            scaled = asterism.MDS(metric=metric, random_state=0).fit(np.ones((6, 3)))
            self.assertEqual(scaled.stress_, 0)
            np.testing.assert_array_equal(scaled.embedding_, np.zeros((6, 2)))

    def test_isotonic_regression(self):
        from sklearn.isotonic import isotonic_regression

        for n in (1, 2, 50, 500):
            values, weights = self.random.normal(size=n), self.random.uniform(0.1, 3, n)
            np.testing.assert_allclose(asterism._asterism._isotonic(values, weights), isotonic_regression(values, sample_weight=weights), atol=1e-12)

    @unittest.skipUnless(scipy, "needs SciPy")
    def test_new_points_are_at_minima_and_mostly_at_the_lowest(self):
        lowest = count = 0
        for dim, features in ((1, 3), (2, 2), (2, 6), (3, 6), (6, 9)):
            with self.subTest(dim=dim, features=features):
                made = asterism.MDS(dim).fit(self.random.normal(size=(60, features)))
                new = self.random.normal(size=(6, features))
                away = np.linalg.norm(new[:, None] - made._fitted_features, axis=2)
                weights = self.random.uniform(0.2, 2, away.shape) * (self.random.random(away.shape) < 0.9)
                for given, w in ((made.transform(new), np.ones_like(away)), (made.transform(new, weights=weights), weights)):
                    for x, d, row in zip(given, away, w):
                        of = lambda y: np.sum(row * (d - np.linalg.norm(y - made.embedding_, axis=1)) ** 2)
                        starts = [x, *self.random.normal(size=(8, dim)), made.embedding_[d.argmin()] + 0.01]
                        minima = [scipy.optimize.minimize(of, start, method="BFGS").fun for start in starts]
                        self.assertLessEqual(of(x), minima[0] * (1 + 1e-6) + 1e-9)
                        lowest += of(x) <= min(minima) * (1 + 1e-5) + 1e-9
                        count += 1
        self.assertGreaterEqual(lowest, 0.9 * count)

    @unittest.skipUnless(scipy, "needs SciPy")
    def test_new_points_are_where_two_descents_end(self):
        # The same without haste: the minimum from weighted squares of the distances or, up to 5 dimensions, from the mirror image of that one.
        for dim in (1, 2, 3, 4, 5, 10):
            held, new = self.random.normal(size=(81, dim)), 2 * self.random.normal(size=(30, dim))
            away = np.linalg.norm(new[:, None] - held, axis=2) + self.random.exponential(size=(30, 81))
            weights = self.random.uniform(0.2, 2, away.shape) * (self.random.random(away.shape) < 0.8)
            placed = asterism._asterism._place(held, np.where(weights > 0, away, np.nan), weights, np.empty((0, dim)), 1)
            same = 0
            for x, d, w in zip(placed, away, weights):
                of = lambda y: np.sum(w * (d - np.linalg.norm(y - held, axis=1)) ** 2)
                least = lambda start: scipy.optimize.minimize(of, start, method="BFGS", options={"gtol": 1e-8}).x
                # |y|^2 - 2 y h + |h|^2 = d^2, linear in |y|^2 and y.
                root = np.sqrt(w) / np.maximum(d, 0.1 * np.average(d, weights=w))
                unknown = np.column_stack([np.ones(81), -2 * held])
                first = least(np.linalg.lstsq(root[:, None] * unknown, root * (d**2 - np.sum(held**2, axis=1)), rcond=None)[0][1:])
                second = least(2 * held[np.where(w > 0, d, np.inf).argmin()] - first)
                end = min(first, second, key=of) if dim <= 5 else first
                self.assertLessEqual(of(x), of(end) * 1.2)
                same += np.abs(x - end).max() < 1e-5
            self.assertGreaterEqual(same, 28 if dim > 1 else 24, dim)
        with self.assertRaisesRegex(ValueError, "a row of distances and weights for each point that is held"):
            asterism._asterism._place(held, away[:, :5].copy(), np.ones((1, 80)), np.empty((0, 5)), 1)

    def test_new_points_on_a_line_are_at_the_lowest_minimum(self):
        made = precomputed(1).fit(distances_of(self.random.normal(size=(30, 3))))
        away = self.random.uniform(0, 4, size=(40, 30))
        away[self.random.random(away.shape) < 0.2] = np.nan
        weights = self.random.uniform(0, 2, away.shape)
        grid = np.linspace(-10, 10, 20001)[:, None]
        for given, w in ((made.transform(away), np.ones_like(away)), (made.transform(away, weights=weights), weights)):
            for x, d, row in zip(given, away, w):
                of = lambda y: np.nansum(row * (d - np.abs(y - made.embedding_[:, 0])) ** 2, axis=-1)
                self.assertLessEqual(of(x), of(grid).min() * (1 + 1e-12))
        away[3, 7] = 0
        np.testing.assert_array_equal(made.transform(away)[3], made.embedding_[7])

    def test_new_points_leave_the_span_of_the_held_ones(self):
        for held in (np.zeros((1, 3)), np.ones((4, 2)), np.outer(self.random.normal(size=9), [1, 2, 0, -1])):
            new = self.random.normal(size=(20, held.shape[1]))
            away = np.linalg.norm(new[:, None] - held, axis=2)
            placed = asterism._asterism._place(held, away, np.ones((1, len(held))), np.empty((0, held.shape[1])), 1)
            np.testing.assert_allclose(np.linalg.norm(placed[:, None] - held, axis=2), away, atol=1e-6)

    def test_new_points_do_not_depend_on_each_other(self):
        points, new = self.random.normal(size=(150, 3)), self.random.normal(size=(300, 3))
        made = asterism.MDS(2, n_jobs=2).fit(points)
        np.testing.assert_array_equal(made.transform(new)[7:9], made.transform(new[7:9]))
        np.testing.assert_array_equal(made.transform(points, among=150), made.embedding_)

    def test_wrong_distances(self):
        points = self.random.normal(size=(40, 2))
        distances = distances_of(points)
        wrong = np.where(symmetric(self.random.random(distances.shape) < 0.1), 3 * distances, distances)
        away = np.linalg.norm(points[:3, None] + 0.1 - points, axis=2)
        away[:, 20] *= 5
        for loss, scale, least in (("huber", 0.01, 0.05), ("geman-mcclure", 0.1, 0.02)):
            made = precomputed(2, loss=loss, scale=scale, eps=1e-6).fit(wrong)
            self.assertLess(np.abs(distances_of(made.embedding_) - distances).max(), least)
            self.assertLess(np.abs(np.linalg.norm(made.transform(away)[:, None] - made.embedding_, axis=2) - np.linalg.norm(points[:3, None] + 0.1 - points, axis=2)).max(), 2 * least)
        self.assertGreater(np.abs(distances_of(precomputed(2).fit(wrong).embedding_) - distances).max(), 0.2)

    def test_starts_find_several_minima_of_a_loss(self):
        lower = 0
        for _ in range(8):
            distances = distances_of(self.random.normal(size=(8, 5)))
            one, many = (precomputed(2, loss="geman-mcclure", scale=0.3, n_init=count).fit(distances).stress_ for count in (1, 32))
            self.assertLessEqual(many, one * (1 + 1e-6))
            lower += many < 0.99 * one
        self.assertGreater(lower, 1)

    def test_the_number_of_jobs_changes_nothing(self):
        points = self.random.normal(size=(50, 5))
        one, two, all_but_one = (asterism.MDS(2, n_init=6, n_jobs=jobs).fit(points) for jobs in (1, 2, -2))
        np.testing.assert_array_equal(one.embedding_, two.embedding_)
        np.testing.assert_array_equal(one.embedding_, all_but_one.embedding_)
        new = self.random.normal(size=(200, 5))
        np.testing.assert_array_equal(one.transform(new), two.transform(new))

    def test_a_proven_gap(self):
        points = self.random.normal(size=(12, 2))
        made = precomputed(2, certify=True, eps=1e-9).fit(distances_of(points))
        self.assertTrue(made.certificate_.certified)
        self.assertLess(made.gap_, 1e-3)
        noisy = distances_of(points) * symmetric(np.exp(self.random.normal(scale=0.05, size=(12, 12))))
        made = precomputed(2, certify=True, eps=1e-9).fit(noisy, anchors=points, anchor_weights=3)
        self.assertLess(made.gap_, 1e-6)
        self.assertAlmostEqual(made.lower_bound_ / made.stress_, 1, places=6)
        self.assertLessEqual(made.lower_bound_, made.stress_)
        self.assertLessEqual(made.lower_bound_, asterism.mds(noisy, anchors=points, anchor_weights=3).stress)
        rough = precomputed(2, certify=True).fit(symmetric(self.random.uniform(0.5, 1.5, (12, 12))))
        self.assertTrue(np.isnan(rough.gap_) or 0 < rough.gap_ < 1)

    def test_each_fit_stands_alone(self):
        points, new = self.random.normal(size=(12, 3)), self.random.normal(size=(4, 3))
        made = asterism.MDS(2, certify=True).fit(points)
        placed = made.transform(new)
        made.set_params(certify=False, n_components=3, metric=False, dissimilarity="precomputed")
        np.testing.assert_array_equal(made.transform(new), placed)  # by what fit has found
        self.assertEqual(list(made.get_feature_names_out()), ["mds0", "mds1"])
        made.fit(distances_of(points))
        self.assertFalse({"certificate_", "lower_bound_", "gap_"} & set(vars(made)))
        made.set_params(metric=True).fit(distances_of(points))
        self.assertFalse(hasattr(made, "disparities_"))
        with self.assertRaises(ValueError):
            made.fit(-distances_of(points))
        with self.assertRaisesRegex(ValueError, "not fitted yet"):
            made.transform(new)

    def test_a_pickle_goes_on(self):
        made = asterism.MDS(2).fit(self.random.normal(size=(20, 4)))
        new = self.random.normal(size=(3, 4))
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(made)).transform(new), made.transform(new))

    def test_needs_no_scikit_learn(self):
        code = (
            "import sys; sys.modules['sklearn'] = None\n"
            "import asterism, numpy as np\n"
            "made = asterism.MDS(2)\n"
            "try: made.transform([[0, 1]])\n"
            "except ValueError as error: assert 'not fitted' in str(error)\n"
            "assert made.fit(np.eye(4)).transform(np.eye(4)).shape == (4, 2)\n"
        )
        subprocess.run([sys.executable, "-c", code], check=True)

    def test_distances_given_as_points_are_told(self):
        distances = symmetric(np.random.default_rng(3).uniform(1, 2, (6, 6)))
        np.fill_diagonal(distances, 0)
        for fit in (lambda x: asterism.MDS().fit(x), lambda x: asterism.MDS().fit_transform(x)):
            with self.assertWarnsRegex(UserWarning, "if these are distances, use dissimilarity='precomputed'") as caught:
                fit(distances)
            self.assertEqual(caught.filename, __file__)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            asterism.MDS().fit(distances[:5])
            asterism.MDS().fit(distances + np.eye(6))
            precomputed().fit(distances)

    def test_says_what_is_wrong(self):
        good = symmetric(np.ones((4, 4)))
        fitted = precomputed().fit(good)
        for call, error, message in [
            (lambda: asterism.MDS(metric="euclidean").fit(good), ValueError, "metric: expected True or False for non-metric scaling, found 'euclidean'"),
            (lambda: asterism.MDS(init=good), TypeError, "'init': it is an argument of fit"),
            (lambda: asterism.MDS(dim=2), TypeError, r"MDS\(\) has no option 'dim': here it is 'n_components'"),
            (lambda: asterism.MDS(starts=2), TypeError, "here it is 'n_init'"),
            (lambda: asterism.MDS(seed=2), TypeError, "here it is 'random_state'"),
            (lambda: asterism.MDS(tolerance=1), TypeError, "here it is 'eps'"),
            (lambda: asterism.MDS(max_iterations=1), TypeError, "here it is 'max_iter'"),
            (lambda: asterism.MDS(threads=1), TypeError, "here it is 'n_jobs'"),
            (lambda: asterism.MDS(foo=1), TypeError, r"has no option 'foo' \(it has: n_components, metric"),
            (lambda: asterism.MDS().set_params(dim=3), ValueError, "Invalid parameter 'dim' .* here it is 'n_components'"),
            (lambda: precomputed(0).fit(good), ValueError, "n_components: expected >= 1, found 0"),
            (lambda: precomputed(2.5).fit(good), TypeError, "n_components: expected an integer, found 2.5"),
            (lambda: precomputed(200).fit(good), ValueError, "n_components: expected at most 64, found 200"),
            (lambda: precomputed(n_init=0).fit(good), ValueError, "n_init: expected >= 1"),
            (lambda: precomputed(n_jobs=0).fit(good), ValueError, "n_jobs: expected >= 1"),
            (lambda: precomputed(loss="huber", scale=0).fit(good), ValueError, "scale: expected a finite number > 0, found 0"),
            (lambda: precomputed(loss="huber", scale=[1, 2]).fit(good), ValueError, r"scale: expected shape \(\), found \(2,\)"),
            (lambda: precomputed(eps="1e-3").fit(good), TypeError, "eps: expected numbers, found <U4"),
            (lambda: precomputed(certify="no").fit(good), ValueError, "certify: expected True or False, found 'no'"),
            (lambda: precomputed(eps=0).fit(good), ValueError, "eps: expected a finite number > 0, found 0"),
            (lambda: precomputed(random_state="a").fit(good), TypeError, "random_state: expected an integer, found 'a'"),
            (lambda: asterism.MDS(dissimilarity="cosine").fit(good), ValueError, "dissimilarity: expected 'euclidean' or 'precomputed', found 'cosine'"),
            (lambda: precomputed(normalized_stress=3).fit(good), ValueError, "normalized_stress: expected True, False or 'auto'"),
            (lambda: precomputed(loss="cauchy").fit(good), ValueError, "loss: expected 'quadratic', 'huber' or"),
            (lambda: precomputed(loss="huber").fit(good), ValueError, "scale: expected a number for loss='huber', found None"),
            (lambda: precomputed(scale=1).fit(good), ValueError, "scale: expected None for loss='quadratic', found 1"),
            (lambda: precomputed(metric=False, certify=True).fit(good), ValueError, "neither a loss nor a certificate"),
            (lambda: precomputed(metric=False).fit(good, anchors=np.zeros((4, 2))), ValueError, "anchors: non-metric scaling has no unit"),
            (lambda: precomputed().fit(good[:2]), ValueError, r"X: expected a square matrix of distances \(N, N\), found \(2, 4\)"),
            (lambda: precomputed().fit(-good), ValueError, r"X: \[0, 1\] is -1.0; expected >= 0"),
            (lambda: precomputed().fit(np.triu(good)), ValueError, "X: expected a symmetric matrix"),
            (lambda: precomputed().fit(good, init=np.zeros((3, 2))), ValueError, r"init: expected shape \(4, 2\)"),
            (lambda: precomputed().fit(good, weights=-good), ValueError, r"weights: \[0, 1\] is -1.0"),
            (lambda: asterism.MDS().fit([[0, np.nan]]), ValueError, r"X: \[0, 1\] is nan"),
            (lambda: asterism.MDS().fit(np.ma.masked_equal(good, 0)), TypeError, "masked"),
            (lambda: asterism.MDS().transform(good), ValueError, "not fitted yet"),
            (lambda: asterism.MDS().get_feature_names_out(), ValueError, "not fitted yet"),
            (lambda: fitted.transform(1e60 * good), ValueError, r"X: a point has the distance 1e\+60 from points that lie within"),
            (lambda: fitted.transform(good[:, :3]), ValueError, "X has 3 features, but MDS is expecting 4"),
            (lambda: fitted.transform(np.full((2, 4), np.nan)), ValueError, "X: row 0 has no known distance"),
            (lambda: fitted.transform(-good - 1), ValueError, "X: expected distances >= 0"),
            (lambda: fitted.transform(good, weights=-good), ValueError, "weights: expected finite numbers >= 0"),
            (lambda: fitted.transform(good, among=0), ValueError, "among: expected >= 1, found 0"),
        ]:
            with self.subTest(message), self.assertRaisesRegex(error, message):
                call()


if __name__ == "__main__":
    unittest.main()
