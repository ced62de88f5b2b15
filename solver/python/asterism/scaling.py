"""Multidimensional scaling as an estimator, with the interface of scikit-learn, which it does not need."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import inspect
import sys
import warnings
from typing import Any, Callable

import numpy as np
import numpy.typing as npt

from . import _asterism, embedding, inputs, names

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.intp]
_Start = Callable[[], _Floats]
_Found = tuple[float, _Floats, int, "_Floats | None"]  # of one start: the stress, points, iterations, and disparities without metric
_LOSSES = ("quadratic", "huber", "geman-mcclure")
_FARTHEST = 1e30  # distances of new points, in sizes of the map
_FINER = 1e-2  # the tolerance of the last solve, as a share of that of the starts
# What fit leaves; a fit first removes what an earlier one left.
_FITTED = (
    "embedding_", "stress_", "n_iter_", "dissimilarity_matrix_", "n_features_in_", "feature_names_in_", "certificate_", "lower_bound_",
    "gap_", "disparities_", "_fitted_features", "_curve", "_residuals",
)


@dataclasses.dataclass(frozen=True, eq=False)
class _Problem:
    """The problem that fit solves."""

    pairs: _Indices  # (K, 2), those with a distance and a weight
    lengths: _Floats
    weights: _Floats
    at: _Floats  # (N, dim): anchors
    hold: _Floats  # (N,): their weights, 0 without
    components: list[_Indices]  # of the pairs
    distances: embedding._Distances  # of all pairs

    @property
    def n(self) -> int:
        return len(self.at)

    @property
    def exact(self) -> npt.NDArray[np.bool_]:
        """Which points stay on their anchors."""
        return np.isinf(self.hold)


class MDS:
    """Multidimensional scaling: points whose distances are those given, with the interface of scikit-learn's MDS.

    It minimises the stress sum w_ij rho((d_ij - |x_i - x_j|)^2) over the known pairs, as mds does in 2 and 3 dimensions, and
    has all that scikit-learn 1.2 asks of a transformer (`check_estimator`), but needs no scikit-learn.

    n_components: the dimension, 1 to 64.
    metric: False for non-metric scaling, which keeps only the order of the distances (Kruskal 1964): the stress is then that of the
        numbers nearest to |x_i - x_j| that increase with d_ij; those of equal d_ij may differ. It has no loss and no proof, and takes no
        anchors.
    n_init: number of starts. None: as for mds, 32 up to 100 points, 8 up to 300, and two for more. The first is classical scaling, the
        others are random.
    max_iter: of each start. eps: the solver's tolerance for each start, without unit; from the lowest, the solver goes on to a
        hundredth of it, within max_iter. For metric=False also the share of the stress by which a regression has to lower it.
    n_jobs: starts, and points of transform, that are computed at a time; None: 1, -1: as many as the machine runs at once, -2: one
        less, and so on. The result does not depend on it.
    random_state: an integer, a RandomState or Generator of NumPy, or None for 1: results are the same in every run.
    dissimilarity: "euclidean": X are points (N, features), and their Euclidean distances are taken; "precomputed": X is a matrix of
        distances as mds takes it, in which pairs may be missing (NaN, masked, or not stored in a sparse matrix).
    normalized_stress: whether `stress_` is sqrt(sum w (d - r)^2 / sum w r^2) with r = |x_i - x_j| (Kruskal's stress-1); "auto": where
        metric is False.
    loss, scale: against wrong distances: "huber" or "geman-mcclure", from residuals of about `scale` on [unit of the
        distances]; "quadratic" has no scale. "geman-mcclure" is solved by "graduated" from every second start, and by "auto" from the
        others.
    certify: also ask how much less stress another placement may have, which takes N^2 memory and about the time of the solve.

    After fit: `embedding_` (N, n_components); `stress_`; `n_iter_` of the start whose result is taken; `dissimilarity_matrix_` (N, N);
    `n_features_in_`; with certify `certificate_`, `lower_bound_`, and `gap_` (as Embedding.gap); without metric `disparities_`, the
    pairs' numbers that increase with d_ij.

    The constructor checks names only, and fit the values, as in scikit-learn. Names of mds, such as `dim`, are a TypeError that says
    the name here.
    """

    def __init__(
        self,
        n_components: int = 2,
        *,
        metric: bool = True,
        n_init: int | None = None,
        max_iter: int = 10000,
        eps: float = 1e-3,
        n_jobs: int | None = None,
        random_state: Any = None,
        dissimilarity: str = "euclidean",
        normalized_stress: bool | str = "auto",
        loss: str = "quadratic",
        scale: float | None = None,
        certify: bool = False,
        **unknown: Any,
    ) -> None:
        for name in unknown:
            if name in ("init", "weights", "anchors", "anchor_weights"):
                raise TypeError(f"MDS() has no option '{name}': it is an argument of fit")
            raise TypeError(names.no_option("MDS()", name, self._names()))
        self.n_components = n_components
        self.metric = metric
        self.n_init = n_init
        self.max_iter = max_iter
        self.eps = eps
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.dissimilarity = dissimilarity
        self.normalized_stress = normalized_stress
        self.loss = loss
        self.scale = scale
        self.certify = certify

    def fit(
        self,
        X: Any,
        y: Any = None,
        *,
        init: npt.ArrayLike | None = None,
        weights: Any = None,
        anchors: npt.ArrayLike | None = None,
        anchor_weights: npt.ArrayLike = 1.0,
    ) -> MDS:
        """Finds the placement of X; y is ignored.

        init: (N, n_components), the only start. weights, anchors, anchor_weights: as for mds, for all dimensions. ValueError or
        TypeError names what is wrong.
        """
        self._check()
        for name in _FITTED:
            vars(self).pop(name, None)
        problem = self._problem(X, weights, anchors, anchor_weights)
        self._remember_columns(X, problem.n)
        starts = self._starts(problem, init)
        system, _ = self._system(problem)
        eps = float(self.eps)

        def solve(x: _Floats, start: int) -> _Found:
            if not self.metric:
                return self._ordered(problem, x, self.max_iter, eps)
            # "graduated" reaches few minima, whatever the start; every second start goes down as it is.
            return self._solved(system, x, self.max_iter, eps, "graduated" if self.loss == "geman-mcclure" and start % 2 == 0 else "auto")

        self._keep(problem, system, self._finished(problem, system, self._lowest(problem, starts, solve)))
        if self.certify:
            self._prove(problem, system)
        return self

    def fit_transform(self, X: Any, y: Any = None, **fit_params: Any) -> _Floats:
        """fit(X, y, **fit_params).embedding_"""
        return self.fit(X, y, **fit_params).embedding_

    def transform(self, X: Any, *, weights: npt.ArrayLike | None = None, among: int = 100) -> _Floats:
        """Places for new points, (M, n_components), each by itself, among the points of fit, which stay where they are.

        X: points (M, features), or, precomputed, their distances (M, N) from the points of fit, where NaN (or masked) is not known.
        weights: (M, N), >= 0, of these distances; None: 1.

        A point goes down to a minimum of its stress, up to 5 dimensions to the lower of two, which is nearly always the lowest; in one
        dimension without a loss it is the lowest.

        among: how many points of fit each new one is placed among. They are drawn at random, the same for all new points, and the time
            is proportional to their number. All points of fit count where distances are missing or have weights. With N = 2000, new
            points had 13 % more stress among 100 than among all, and 6 % more among 200.

        A point whose distance from one of these is 0 is placed on it. ValueError for a point without a known distance, and before fit.
        """
        self._check_is_fitted()
        held, threads = self.embedding_, self._threads()
        if np.ma.isMaskedArray(X):
            X = np.ma.asarray(X).astype(np.float64).filled(np.nan)
        table = _table(X, is_finite=self._fitted_features is not None)
        self._check_columns(X, table.shape[1])
        count, dim = len(table), held.shape[1]
        shares = None if weights is None else inputs.numbers(weights, "weights", (count, len(held)), missing=0)
        if shares is not None and not ((shares >= 0) & np.isfinite(shares)).all():
            raise ValueError("weights: expected finite numbers >= 0")
        is_all = shares is not None or (self._fitted_features is None and bool(np.isnan(table).any()))
        chosen = np.arange(len(held))
        if not is_all and inputs.count(among, "among") < len(held):
            chosen = np.random.default_rng(0).permutation(len(held))[:among]
        places = np.ascontiguousarray(held[chosen])
        size = float(np.ptp(held, axis=0).max())
        result = np.empty((count, dim))
        rows = max(1, 4_000_000 // len(chosen))  # 32 MB of distances
        for first in range(0, count, rows):
            part = slice(first, first + rows)
            if self._fitted_features is None:
                distances = np.ascontiguousarray(table[part][:, chosen])
                if (distances < 0).any() or np.isinf(distances).any():
                    raise ValueError("X: expected distances >= 0 and finite, or NaN where one is not known")
            else:
                distances = _asterism._distances(table[part], self._fitted_features[chosen], threads)
            if (most := np.nanmax(distances, initial=0)) > _FARTHEST * (size or 1):
                raise ValueError(f"X: a point has the distance {most:g} from points that lie within {size:g}; float64 cannot place it")
            if self._curve is not None:
                distances = _of_curve(self._curve, distances)
            own = np.ones((1, len(chosen))) if shares is None else shares[part]
            result[part] = self._placed(places, distances, np.ascontiguousarray(own), threads)
        if len(bad := np.flatnonzero(np.isnan(result).any(axis=1))):
            raise ValueError(f"X: row {bad[0]} has no known distance from a point of fit")
        return result

    def get_feature_names_out(self, input_features: Any = None) -> npt.NDArray[Any]:
        """mds0, mds1, ...: names of the columns of the embedding; after fit."""
        self._check_is_fitted()
        return np.array([f"mds{k}" for k in range(self.embedding_.shape[1])], dtype=object)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The arguments of the constructor, by name."""
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self, **params: Any) -> MDS:
        """Changes arguments of the constructor; ValueError for a name that it does not have."""
        for name, value in params.items():
            if name not in self._names():
                raise ValueError(f"Invalid parameter {name!r} for estimator MDS: {names.no_option('MDS()', name, self._names())}")
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        own = inspect.signature(MDS.__init__).parameters
        changed = [f"{name}={value!r}" for name, value in self.get_params().items() if value is not own[name].default]
        return f"{type(self).__name__}({', '.join(changed)})"

    @classmethod
    def _names(cls) -> list[str]:
        own = inspect.signature(MDS.__init__).parameters.values()
        return [p.name for p in own if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name != "self"]

    # What scikit-learn asks about an estimator: up to 1.5, and since.
    def _more_tags(self) -> dict[str, Any]:
        is_given = self.dissimilarity == "precomputed"
        return {"pairwise": is_given, "allow_nan": is_given}

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, Tags, TargetTags, TransformerTags

        is_given = self.dissimilarity == "precomputed"
        return Tags(
            estimator_type=None,
            target_tags=TargetTags(required=False),
            transformer_tags=TransformerTags(),
            input_tags=InputTags(pairwise=is_given, allow_nan=is_given, sparse=is_given),
        )

    def _check_is_fitted(self) -> None:
        if not hasattr(self, "embedding_"):
            raise _not_fitted()(
                f"This {type(self).__name__} instance is not fitted yet. Call 'fit' with appropriate arguments before using this estimator."
            )

    def _threads(self) -> int:
        jobs = 1 if self.n_jobs is None else self.n_jobs
        if isinstance(jobs, (int, np.integer)) and jobs < 0:
            return max(inputs.processors() + 1 + int(jobs), 1)
        return inputs.count(jobs, "n_jobs")

    def _check(self) -> None:
        if inputs.count(self.n_components, "n_components") > 64:
            raise ValueError(f"n_components: expected at most 64, found {self.n_components}")
        if self.n_init is not None:
            inputs.count(self.n_init, "n_init")
        inputs.count(self.max_iter, "max_iter")
        self._threads()
        inputs.positive(self.eps, "eps")
        for name, among in {
            "metric": (True, False),
            "dissimilarity": ("euclidean", "precomputed"),
            "certify": (True, False),
            "normalized_stress": (True, False, "auto"),
            "loss": tuple(_LOSSES),
        }.items():
            inputs.choice(getattr(self, name), name, among, " for non-metric scaling" if name == "metric" else "")
        if (self.loss == "quadratic") != (self.scale is None):
            raise ValueError(f"scale: expected {'None' if self.loss == 'quadratic' else 'a number'} for loss={self.loss!r}, found {inputs.shown(self.scale)}")
        if self.scale is not None:
            inputs.positive(self.scale, "scale")
        if not self.metric and (self.loss != "quadratic" or self.certify):
            raise ValueError("metric: non-metric scaling has neither a loss nor a certificate; use metric=True")

    def _seed(self) -> int:
        state = self.random_state
        if state is None:
            return 1
        if isinstance(state, np.random.RandomState):
            return int(state.randint(2**31 - 1))
        if isinstance(state, np.random.Generator):
            return int(state.integers(2**31 - 1))
        return inputs.count(state, "random_state", 0)

    def _remember_columns(self, X: Any, n: int) -> None:
        self.n_features_in_ = n if self._fitted_features is None else self._fitted_features.shape[1]
        columns = _column_names(X)
        if columns is not None:
            self.feature_names_in_ = columns

    def _check_columns(self, X: Any, found: int) -> None:
        if found != self.n_features_in_:
            raise ValueError(
                f"X has {found} features, but {type(self).__name__} is expecting {self.n_features_in_} features as input"
            )
        columns, known = _column_names(X), getattr(self, "feature_names_in_", None)
        if columns is not None and known is not None and list(columns) != list(known):
            raise ValueError("X: the columns' names are not those of fit, or in another order")

    def _problem(self, X: Any, weights: Any, anchors: Any, anchor_weights: Any) -> _Problem:
        self._fitted_features: _Floats | None = None
        self._residuals = self.loss, self.scale
        if self.dissimilarity == "euclidean":
            self._fitted_features = features = _features(X)
            n = len(features)
            if n > 2 and features.shape[1] == n and not np.diagonal(features).any() and (features >= 0).all() and np.array_equal(features, features.T):
                is_nested = sys._getframe(2).f_code is MDS.fit_transform.__code__  # the warning is of the line that called it
                warnings.warn(
                    "X: a symmetric matrix with 0 on its diagonal, whose rows are taken as points; if these are distances, use dissimilarity='precomputed'",
                    stacklevel=3 + is_nested,
                )
            i, j = np.triu_indices(n, 1)
            pairs, lengths = np.column_stack([i, j]), _asterism._distances(features, features, self._threads())[i, j]
        else:
            if not inputs.is_sparse(X):
                X = np.ma.asarray(X).filled(np.nan) if np.ma.isMaskedArray(X) else _table(X, is_finite=False)
                if X.shape[0] != X.shape[1]:
                    raise ValueError(f"X: expected a square matrix of distances (N, N), found {X.shape}")
            pairs, lengths, n = embedding._known_pairs(X, "X")
        stiffness = embedding._weights_of(weights, pairs, n)
        if not (counts := stiffness > 0).all():
            pairs, lengths, stiffness = pairs[counts], lengths[counts], stiffness[counts]
        at, hold = embedding._anchors_of(anchors, anchor_weights, n, int(self.n_components))
        if anchors is not None and not self.metric:
            raise ValueError("anchors: non-metric scaling has no unit, so its points have no places; use metric=True")
        embedding._check_any_known("X", n, pairs, hold)
        embedding._check_range(lengths, stiffness, at, hold)
        return _Problem(pairs, lengths, stiffness, at, hold, *embedding.joined(n, pairs, lengths))

    def _system(self, problem: _Problem) -> tuple[_asterism.System, Any]:
        """The system and its links; one point of each component without an anchor is fixed, as it may be anywhere at no cost."""
        system = _asterism.System(problem.n, dim=int(self.n_components))
        loss = {} if self.loss == "quadratic" else {"loss": self.loss, "scale": self.scale}
        weights = problem.weights
        if len(weights) and (weights == weights[0]).all():
            weights = weights[0]
        links = system.add_links(problem.pairs, problem.lengths, weights, **loss) if len(problem.pairs) else None
        is_soft = (problem.hold > 0) & ~problem.exact
        if is_soft.any():
            system.add_anchors(problem.at[is_soft], problem.hold[is_soft], nodes=np.flatnonzero(is_soft))
        for nodes, is_held in zip(problem.components, embedding._any_of_each(problem.hold > 0, problem.components)):
            for node in nodes[problem.exact[nodes]] if is_held else nodes[:1]:
                system.fix(int(node))
        return system, links

    def _starts(self, problem: _Problem, init: Any) -> list[_Start]:
        """Makes the starts, each on the thread that solves from it."""
        n, dim, seed = problem.n, int(self.n_components), self._seed()
        at, hold, components = problem.at, problem.hold, problem.components
        if init is not None:
            given = inputs.array(init, "init", (n, dim))
            if not np.isfinite(given).all():
                raise ValueError("init: expected finite numbers")
            return [lambda: embedding._centred(given, components, hold)]
        starts: list[_Start] = [lambda: embedding._start(problem.distances, components, at, hold, dim)]
        if self.n_init is None and n > embedding._SAMPLED:
            x = starts[0]()
            sampled = embedding.sampled_starts(problem.distances, problem.pairs, problem.weights, x, components, at, hold, seed)
            starts = [lambda x=x: x for x in (x, *sampled)]
        count = embedding.starts_by_default(n) if self.n_init is None else int(self.n_init)
        size = _size(problem) / np.sqrt(2 * dim) if count > 1 else 0.0
        centre = at[hold > 0].mean(axis=0) if (hold > 0).any() else np.zeros(dim)
        starts += [lambda k=k: centre + size * np.random.default_rng([seed, k]).normal(size=(n, dim)) for k in range(1, count)]
        return starts

    def _lowest(self, problem: _Problem, starts: list[_Start], solve: Callable[[_Floats, int], _Found]) -> _Found:
        """The result of solve with the least stress, from all starts."""

        def found(start: int) -> _Found:
            x = starts[start]()
            x[problem.exact] = problem.at[problem.exact]
            return solve(x, start)

        jobs = min(self._threads(), len(starts))
        if jobs == 1:
            return min(map(found, range(len(starts))), key=lambda each: each[0])
        with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
            return min(pool.map(found, range(len(starts))), key=lambda each: each[0])

    def _keep(self, problem: _Problem, system: _asterism.System, found: _Found) -> None:
        """Sets what fit leaves."""
        _, x, iterations, disparities = found
        self.n_iter_ = max(iterations, 1)  # scikit-learn knows no solve that starts at the minimum
        self.embedding_ = x = embedding._side_by_side(x, problem.components, problem.hold)
        self.dissimilarity_matrix_ = np.full((problem.n, problem.n), np.nan)
        np.fill_diagonal(self.dissimilarity_matrix_, 0)
        i, j = problem.pairs.T
        self.dissimilarity_matrix_[i, j] = self.dissimilarity_matrix_[j, i] = problem.lengths
        if disparities is not None:
            self.disparities_ = disparities
        self._curve = None if disparities is None else _curve(problem.lengths, disparities)
        if self.normalized_stress is True or (self.normalized_stress == "auto" and not self.metric):
            self.stress_ = _stress_1(problem, x, problem.lengths if disparities is None else disparities)
        elif disparities is None:
            self.stress_ = 2 * system.energy(x)
        else:
            self.stress_ = float(np.sum(problem.weights * (disparities - embedding.lengths_of(x, problem.pairs)) ** 2))

    def _prove(self, problem: _Problem, system: _asterism.System) -> None:
        x, stress = self.embedding_, 2 * system.energy(self.embedding_)
        self.certificate_ = system.certify(x)
        self.lower_bound_ = min(max(2 * self.certificate_.lower_bound, 0.0), stress)
        rounding = embedding.rounding_of(x, problem.pairs, problem.lengths, problem.weights)
        self.gap_ = embedding.proven_gap(stress, self.lower_bound_, rounding)

    def _finished(self, problem: _Problem, system: _asterism.System, found: _Found) -> _Found:
        """The lowest result, from which the solver has gone on to a finer tolerance."""
        _, x, iterations, _ = found
        if (most := self.max_iter - iterations) < 1:
            return found
        eps = _FINER * float(self.eps)
        last = self._solved(system, x, most, eps) if self.metric else self._ordered(problem, x, most, eps)
        return last[0], last[1], iterations + last[2], last[3]

    def _solved(self, system: _asterism.System, x: _Floats, most: int, eps: float, method: str = "auto") -> _Found:
        """Scaling from a start."""
        summary = system.solve(x, method, tolerance=eps, max_iterations=most)
        if not summary:
            raise ValueError(summary.message)
        return summary.final_energy, x, summary.iterations, None

    def _ordered(self, problem: _Problem, x: _Floats, limit: int, eps: float) -> _Found:
        """Non-metric scaling: isotonic regression and scaling in turn. The stress is Kruskal's stress-1."""
        system, links = self._system(problem)
        if links is None:
            return 0.0, x, 0, np.empty(0)
        lengths, weights = problem.lengths, problem.weights
        total = float(weights.sum())
        stress, iterations = np.inf, 0
        while True:
            reached = embedding.lengths_of(x, problem.pairs)
            order = np.lexsort((reached, lengths))  # equal distances may have unequal disparities
            disparities = np.empty(len(lengths))
            disparities[order] = _asterism._isotonic(reached[order], weights[order])
            if not disparities.any():  # all distances are 0, and so are the places
                return 0.0, x, iterations, disparities
            last, stress = stress, _stress_1(problem, x, disparities)
            if last - stress <= eps * stress or iterations >= limit:
                return stress, x, iterations, disparities
            unit = float(np.sqrt(total / np.sum(weights * disparities**2)))
            links.length = unit * disparities
            x = unit * x
            iterations += self._solved(system, x, min(10, limit - iterations), eps)[2]

    def _placed(self, held: _Floats, distances: _Floats, weights: _Floats, threads: int) -> _Floats:
        if held.shape[1] == 1:
            some = [slice(k, k + 500) for k in range(0, len(distances), 500)]  # so few stay in the cache
            x = np.concatenate([_on_a_line(held[:, 0], distances[k], weights if len(weights) == 1 else weights[k]) for k in some])
        else:
            x = _asterism._place(held, distances, weights, np.empty((0, held.shape[1])), threads)
        loss, scale = self._residuals
        if loss == "quadratic":
            return x
        # Iteratively reweighted least squares: each round has no more loss than the one before.
        for _ in range(50):
            with np.errstate(invalid="ignore"):
                residuals = np.abs(distances - _asterism._distances(x, held, threads)) / scale
            last, x = x, _asterism._place(held, distances, weights * _weight_of_loss(loss, residuals), x, threads)
            if not np.nanmax(np.abs(x - last), initial=0) > 1e-9 * np.ptp(held):
                break
        return x


def _size(problem: _Problem) -> float:
    """The root of the mean of squares of distances in the largest component: of all points from some ten of them."""
    nodes = max(problem.components, key=len)
    some = nodes[:: 1 + len(nodes) // 10]
    return float(np.sqrt(np.mean(problem.distances(some[None], nodes[None]) ** 2))) or 1.0


def _stress_1(problem: _Problem, x: _Floats, wanted: _Floats) -> float:
    """Kruskal's stress-1."""
    reached = embedding.lengths_of(x, problem.pairs)
    square = float(np.sum(problem.weights * reached**2))
    return float(np.sqrt(np.sum(problem.weights * (wanted - reached) ** 2) / square)) if square > 0 else 0.0


def _on_a_line(held: _Floats, distances: _Floats, weights: _Floats) -> _Floats:
    """The places (M, 1) of least stress in one dimension, where the stress is a parabola between any two neighbours."""
    order = np.argsort(held)
    at, d = held[order], distances[:, order]
    w = np.where(np.isnan(d), 0.0, weights[:, order])
    d = np.where(w > 0, d, 0.0)
    below, above = np.zeros((2, len(d), len(at) + 1))

    def sums(of: Callable[[_Floats], _Floats]) -> _Floats:
        """For each gap between neighbours, over the points left of it, which pull to the right, and over the others."""
        below[:, 1:] = np.cumsum(w * of(at + d), axis=1)
        above[:, :-1] = np.cumsum((w * of(at - d))[:, ::-1], axis=1)[:, ::-1]
        return below + above

    total = w.sum(axis=1)[:, None]
    with np.errstate(invalid="ignore"):  # NaN where no distance is known
        first = sums(lambda place: place) / total
        x = np.clip(first, np.append(-np.inf, at), np.append(at, np.inf))
        stress = sums(np.square) / total - 2 * x * first + x**2
    least = np.take_along_axis(x, stress.argmin(axis=1)[:, None], axis=1)
    is_there = (distances == 0) & (weights > 0)
    return np.where(is_there.any(axis=1), held[is_there.argmax(axis=1)], least[:, 0])[:, None]


def _weight_of_loss(loss: str, residuals: _Floats) -> _Floats:
    """rho'(s^2) at residuals in units of the scale."""
    if loss == "huber":
        return 1 / np.maximum(residuals, 1)
    return (1 + residuals**2) ** -2.0


def _curve(lengths: _Floats, disparities: _Floats) -> tuple[_Floats, _Floats]:
    """The disparities as a function of the distances: their means where those are equal."""
    known, place = np.unique(lengths, return_inverse=True)
    return known, np.bincount(place, disparities, len(known)) / np.bincount(place, minlength=len(known))


def _of_curve(curve: tuple[_Floats, _Floats], distances: _Floats) -> _Floats:
    """Linear between the known distances, and in proportion beyond them; 0 stays 0."""
    known, disparities = (np.concatenate([[0.0], each]) for each in curve)
    beyond = disparities[-1] / known[-1] if known[-1] > 0 else 1.0
    return np.where(distances > known[-1], beyond * distances, np.interp(distances, known, disparities))


def _column_names(X: Any) -> npt.NDArray[Any] | None:
    """The names of the columns of a data frame in which all have one."""
    columns = getattr(X, "columns", None)
    if columns is None or not all(isinstance(name, str) for name in columns):
        return None
    return np.asarray(columns, dtype=object)


def _features(X: Any) -> _Floats:
    if np.ma.isMaskedArray(X) and np.ma.is_masked(X):
        raise TypeError("X: expected numbers, found masked ones; give distances with dissimilarity='precomputed' where some are not known")
    return _table(X, is_finite=True)


def _table(X: Any, is_finite: bool) -> _Floats:
    """X as (rows, columns) of float64, in C order, with the messages that scikit-learn expects."""
    if inputs.is_sparse(X):
        raise TypeError("X: a sparse matrix was passed; expected an array of numbers (a sparse matrix of distances is taken by fit with dissimilarity='precomputed')")
    try:
        array = np.asarray(X)
        if array.dtype.kind == "O":
            array = array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise type(error)(f"X: expected an array of numbers, found {type(X).__name__}: {error}") from None
    if array.dtype.kind == "c":
        raise ValueError("X: Complex data not supported")
    array = inputs.numbers(array, "X")
    if array.ndim != 2:
        raise ValueError(
            f"X: Expected 2D array, got {array.ndim}D array instead. Reshape your data either using array.reshape(-1, 1) if it has a "
            "single feature or array.reshape(1, -1) if it contains a single sample."
        )
    for axis, what in enumerate(("sample(s)", "feature(s)")):
        if array.shape[axis] == 0:
            raise ValueError(f"Found array with 0 {what} (shape={array.shape}) while a minimum of 1 is required.")
    if is_finite and not np.isfinite(array).all():
        i, j = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"X: [{i}, {j}] is {array[i, j]}; NaN and inf are not places")
    return np.ascontiguousarray(array)


def _not_fitted() -> type[Exception]:
    """scikit-learn's NotFittedError where it is in use, which is one of ValueError and AttributeError, too."""
    theirs = sys.modules.get("sklearn.exceptions")
    return theirs.NotFittedError if theirs is not None else _NotFitted


class _NotFitted(ValueError, AttributeError):
    pass
