"""Left and right that a detector takes for each other, for asterism.pose."""

from __future__ import annotations

import dataclasses
from typing import Any, Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from . import inputs

_Floats = npt.NDArray[np.float64]

#: How much less probable an exchanged frame is, as a difference of energies: which of two whole paths is left is for the majority to say.
_EXCHANGED = 0.05
#: The same for two neighbouring frames of which one is exchanged.
_CHANGED = 2.0
#: The same for a frame whose labels are compared with a path that is known.
_UNLIKELY = 4.0


@dataclasses.dataclass(frozen=True, eq=False)
class Exchanged:
    """The result of exchange_back, for V views, T frames and P pairs of joints."""

    #: As given, with the two joints of a pair exchanged where they were swapped.
    detections: _Floats
    #: (V, T, P), or (T, P) for one view that was given without its axis: where they were.
    swapped: npt.NDArray[np.bool_]

    def apply(self, values: npt.ArrayLike, pairs: Iterable[tuple[int, int]]) -> _Floats:
        """Other numbers of the detections, such as confidence (V, T, J), exchanged in the same way."""
        found = np.array(inputs.numbers(values, "values", missing=np.nan))
        if found.shape[: self.swapped.ndim - 1] != self.swapped.shape[:-1]:
            raise ValueError(f"values: expected shape {(*self.swapped.shape[:-1], '..')}, found {found.shape}")
        joints = found.shape[self.swapped.ndim - 1] if found.ndim >= self.swapped.ndim else 0
        couples = inputs.joint_pairs(pairs, "pairs", joints)
        if len(couples) != self.swapped.shape[-1]:
            raise ValueError(f"pairs: expected {self.swapped.shape[-1]}, found {len(couples)}")
        _exchange(found, self.swapped, couples)
        return found

    __repr__ = inputs.brief


def left_right_pairs(names: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of joints whose names differ only in left and right: left_hip and right_hip, hipL and hipR, L1 and R1."""
    names = inputs.items(names, "names", "a list of names")
    if not all(isinstance(name, str) for name in names):
        raise TypeError("names: expected a list of names")
    place = {name: k for k, name in enumerate(names)}
    pairs = []
    for k, name in enumerate(names):
        for left, right in (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT")):
            if left in name and name.replace(left, right) in place:
                pairs.append((k, place[name.replace(left, right)]))
                break
        else:
            others = [name.removesuffix(end) + other for end, other in (("L", "R"), ("_l", "_r")) if name.endswith(end)]
            others += [other + name.removeprefix(start) for start, other in (("L", "R"), ("l_", "r_")) if name.startswith(start)]
            pairs += [(k, place[other]) for other in others if other in place][:1]
    return pairs


def exchange_back(detections: npt.ArrayLike, pairs: Iterable[tuple[int, int]], times: npt.ArrayLike | None = None) -> Exchanged:
    """Undoes swaps of left and right: the labels under which the paths of both joints are smoothest.

    detections: (V, T, J, 2) [px], or (T, J, 2) for one view; NaN where a joint was not seen. pairs: of joints that may be swapped, each joint in at most
    one; left_right_pairs finds them by their names. times: (T,), rising; frame numbers if left out.

    Each view and pair is decided on its own, by an exact minimum over all choices of frames (min-sum over a chain whose states are the labels of two neighbouring
    frames, a change of which costs 2): changes of velocity have Student's t distribution with one degree of freedom, of a scale that is their median, so that a jump which
    both choices have, or an outlier, costs little. Frames that see one joint of the pair alone go to the nearer path. If most frames are swapped, the
    result is swapped: nothing in a path says which side is left. ValueError for other shapes, infinite numbers, bad pairs and times that do not rise.
    """
    found = np.array(inputs.numbers(detections, "detections", missing=np.nan))
    if found.ndim not in (3, 4) or found.shape[-1] != 2:
        raise ValueError(f"detections: expected shape (views, frames, joints, 2) or (frames, joints, 2), found {found.shape}")
    views = found[None] if found.ndim == 3 else found
    frames, joints = views.shape[1:3]
    if np.isinf(found).any():
        raise ValueError("detections: expected finite numbers, or NaN")
    couples = inputs.joint_pairs(pairs, "pairs", joints)
    if len(np.unique(couples)) < couples.size:
        raise ValueError(f"pairs: expected pairs of two joints, 0 to {joints - 1}, each joint at most once")
    when = np.arange(frames, dtype=float) if times is None else inputs.array(times, "times", (frames,))
    if not np.isfinite(when).all() or (np.diff(when) <= 0).any():
        raise ValueError("times: expected finite, rising times")
    if frames > 1:
        when = (when - when[0]) / np.median(np.diff(when))
    swapped = np.zeros((len(views), frames, len(couples)), bool)
    for view, path in enumerate(views):
        for p, (a, b) in enumerate(couples):
            swapped[view, :, p] = _swapped(path[:, [a, b]], when)
    _exchange(views, swapped, couples)
    return Exchanged(found, swapped[0] if found.ndim == 3 else swapped)


def exchanged(values: Any, swapped: npt.NDArray[np.bool_], pairs: npt.NDArray[np.intp]) -> Any:
    """A copy with pairs exchanged; None stays."""
    if values is None:
        return None
    found = np.array(values)
    _exchange(found, swapped, pairs)
    return found


def _exchange(values: _Floats, swapped: npt.NDArray[np.bool_], pairs: npt.NDArray[np.intp]) -> None:
    """In place; joints are the axis of values after those of the frames."""
    for p, (a, b) in enumerate(pairs):
        where = swapped[..., p]
        left, right = values[where, a].copy(), values[where, b].copy()
        values[where, a], values[where, b] = right, left


def _swapped(path: _Floats, times: _Floats) -> npt.NDArray[np.bool_]:
    """The choices for one pair (T, 2, 2)."""
    is_seen = ~_isolated(path) & np.isfinite(path).all(-1)
    both = np.flatnonzero(is_seen.all(1))
    swapped = np.zeros(len(path), bool)
    if len(both) < 2:
        return swapped
    swapped[both] = _smoothest(path[both], times[both])
    right = path.copy()
    right[swapped] = right[swapped, ::-1]
    known = [np.stack([np.interp(times, times[both], right[both, side, axis]) for axis in range(2)], -1) for side in range(2)]
    for joint in range(2):  # frames of one joint alone
        alone = is_seen[:, joint] & ~is_seen[:, 1 - joint]
        away = np.array([((path[alone, joint] - side[alone]) ** 2).sum(-1) for side in known])
        swapped[alone] = away[1 - joint] < away[joint] / 4  # twice as near to the other's path
    return swapped


def swaps_by_paths(
    pixels: _Floats, pairs: npt.NDArray[np.intp], times: _Floats, cameras: Any, area: _Floats, fused: Callable[[npt.NDArray[np.bool_]], Any]
) -> npt.NDArray[np.bool_]:
    """(V, T, P): where pairs are swapped in detections (V, T, J, 2), by the paths of both joints, which all views share.

    fused: a FusedPose, given where pairs are exchanged. It is begun with nothing exchanged, and with what exchange_back finds in the detections that
    are no outliers then. In each, labels and paths are found by turns. For each pair, the one of the lower energy is taken.
    """
    swapped = np.zeros((*pixels.shape[:2], len(pairs)), bool)
    first = fused(swapped)
    alone = exchange_back(np.where(first.outliers[..., None], np.nan, pixels), pairs, times).swapped
    swapped, first = _settled(pixels, pairs, cameras, area, fused, swapped, first)
    if not alone.any():
        return swapped
    alone, second = _settled(pixels, pairs, cameras, area, fused, alone, fused(alone))
    noise, motion = np.minimum(first.noise, second.noise), np.minimum(first.motion, second.motion)
    energies = [_energies(found, exchanged(pixels, s, pairs), times, noise, motion, area) for s, found in ((swapped, first), (alone, second))]
    better = energies[1][pairs].sum(1) < energies[0][pairs].sum(1)
    return np.where(better, alone, swapped)


def _settled(
    pixels: _Floats, pairs: npt.NDArray[np.intp], cameras: Any, area: _Floats, fused: Callable[..., Any], swapped: npt.NDArray[np.bool_], found: Any
) -> tuple[npt.NDArray[np.bool_], Any]:
    """Each detection goes to the path that it is nearer to, and paths are those of these detections; at most four times."""
    for _ in range(4):
        now = exchanged(pixels, swapped, pairs)
        change = np.zeros_like(swapped)
        spread = np.linalg.cholesky(found.covariance)
        for view, seen in enumerate(now):
            project = cameras[view].project if cameras else np.asarray
            image = project(found.points)
            blur = sum(((project(found.points + spread[..., k]) - image) ** 2).sum(-1) for k in range(spread.shape[-1])) / 2
            variance = found.noise[view] ** 2 + blur
            for p, (a, b) in enumerate(pairs):
                of = [[_loss(seen[:, i] - image[:, j] - found.offsets[view, j], variance[:, j], area[view]) for j in (a, b)] for i in (a, b)]
                change[view, :, p] = of[0][0] + of[1][1] - of[0][1] - of[1][0] > _UNLIKELY
        if not change.any():
            break
        swapped = swapped ^ change
        found = fused(swapped)
    return swapped, found


def _loss(error: _Floats, variance: _Floats, area: float) -> _Floats:
    """Of errors (.., 2): that of fuse; 0 where there is no detection."""
    square = (error**2).sum(-1)
    loss = -np.log(0.99 / (2 * np.pi * variance * (1 + square / (4 * variance)) ** 3) + 0.01 / area)
    return np.where(np.isfinite(square), loss, 0)


def _energies(found: Any, pixels: _Floats, times: _Floats, noise: _Floats, motion: _Floats, area: _Floats) -> _Floats:
    """Of each joint (J,), with these scales."""
    error = pixels - found.reprojections - found.offsets[:, None]
    sum_ = sum(_loss(error[view], noise[view] ** 2, area[view]).sum(0) for view in range(len(pixels)))
    step = np.diff(times)[:, None, None]
    change = np.diff(np.diff(found.points, axis=0) / step, axis=0) / np.sqrt((step[1:] + step[:-1]) / 2)
    return sum_ + (1 + change.shape[-1]) / 2 * np.log1p((change**2).sum(-1) / motion**2).sum(0)


def _isolated(path: _Floats) -> npt.NDArray[np.bool_]:
    """Detections (T, 2) that are far from all of either joint in the three frames before and after, but one: outliers, which would hide how the path goes on."""
    near = []
    for k in range(1, 4):
        away = np.full((2, len(path), 2, 2), np.nan)
        away[0, k:] = np.linalg.norm(path[k:, :, None] - path[:-k, None], axis=-1)
        away[1, :-k] = np.linalg.norm(path[:-k, :, None] - path[k:, None], axis=-1)
        near += [*away[..., 0], *away[..., 1]]
    second = np.sort(np.array(near), axis=0)[1]  # NaN is last
    known = second[np.isfinite(second)]
    return second > 4 * np.percentile(known, 70) if len(known) else np.zeros(second.shape, bool)


def _scale(typical: float, square: _Floats) -> float:
    """That of squares of which most may be 0."""
    return max(typical, 1e-12 * float(square.max())) or 1.0


def _smoothest(path: _Floats, times: _Floats) -> npt.NDArray[np.bool_]:
    """The choices for frames (T, 2, 2) that see both: Viterbi's algorithm over the labels of neighbouring frames."""
    count = len(path)
    step = np.diff(times)
    label = np.stack([path, path[:, ::-1]])  # (label, T, joint, 2)
    # (label before, label, T - 1, joint, 2)
    speed = (label[None, :, 1:] - label[:, None, :-1]) / step[:, None, None]
    square = (speed**2).sum(-1)
    slow = float(np.median(square.min((0, 1))))
    cost = np.log1p(square / _scale(16 * slow, square)).sum(-1)  # weak: it only tells apart what no change of velocity does
    if count > 2:
        # (label before, label, label after, T - 2, joint, 2)
        change = (speed[None, :, :, 1:] - speed[:, :, None, :-1]) * np.sqrt(2 / (step[1:] + step[:-1]))[:, None, None]
        square = (change**2).sum(-1)
        bend = np.log1p(square / _scale(float(np.median(square.min((0, 1, 2)))), square)).sum(-1)  # each joint on its own: one may be an outlier
    differs = _CHANGED * (1 - np.eye(2))
    best = cost[:, :, 0] + _EXCHANGED * (np.arange(2)[:, None] + np.arange(2)) + differs
    back = np.zeros((count, 2, 2), np.intp)
    for t in range(2, count):
        total = best[:, :, None] + bend[..., t - 2]
        back[t] = total.argmin(0)
        best = total.min(0) + cost[..., t - 1] + _EXCHANGED * np.arange(2) + differs
    found = np.zeros(count, np.intp)
    found[-2:] = np.unravel_index(best.argmin(), (2, 2))
    for t in range(count - 1, 1, -1):
        found[t - 2] = back[t, found[t - 1], found[t]]
    is_swapped = found.astype(bool)
    return ~is_swapped if is_swapped.mean() > 0.5 else is_swapped
