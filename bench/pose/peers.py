"""What people use for key-points over time and views, written from the papers; nothing here is part of the library.

Detections are (V, T, J, 2) [px] with NaN where none, cameras asterism.pose.Camera, paths (T, J, 3).
"""

import itertools
import warnings

import numpy as np
from scipy import optimize, signal, sparse


def triangulated(detections, cameras):
    """Least squares of the errors in pixels, from the linear solution; NaN where fewer than two views see the joint."""
    images = np.array([camera.undistort(view)[0] for camera, view in zip(cameras, detections)])
    seen = np.isfinite(images[..., 0])
    poses = np.array([np.column_stack([camera.rotation, camera.translation]) for camera in cameras])
    rows = np.nan_to_num(images)[..., None] * poses[:, None, None, 2:3] - poses[:, None, None, :2]
    rows = (rows * seen[..., None, None]).transpose(1, 2, 0, 3, 4).reshape(*seen.shape[1:], -1, 4)
    scale = np.linalg.norm(rows[..., 3].reshape(-1)) / max(np.linalg.norm(rows[..., :3].reshape(-1)), 1e-300)
    rows[..., 3] /= max(scale, 1e-300)
    found = np.linalg.svd(rows)[2][..., -1, :]
    points = found[..., :3] / (found[..., 3:] / scale)
    points[seen.sum(0) < 2] = np.nan
    best, step = None, 1e-5 * np.median([np.linalg.norm(camera.translation) for camera in cameras])
    errors = lambda x: np.concatenate([np.nan_to_num(c.project(x) - view) for c, view in zip(cameras, detections)], -1)
    with np.errstate(all="ignore"):
        for _ in range(6):  # Gauss-Newton
            error = errors(points)
            square = (error**2).sum(-1)
            if best is not None:
                worse = ~(square <= least)
                points[worse], error[worse], square[worse] = best[worse], 0, least[worse]
            best, least = points.copy(), square
            slope = np.stack([(errors(points + step * axis) - error) / step for axis in np.eye(3)], -1)
            matrix = np.einsum("tjea,tjeb->tjab", slope, slope)
            matrix[~np.isfinite(matrix).all((-2, -1)) | (seen.sum(0) < 2)] = np.eye(3)
            change = np.einsum("tjea,tje->tja", slope, error)
            points = points - (np.linalg.pinv(matrix) @ np.nan_to_num(change)[..., None])[..., 0]
        square = (errors(points) ** 2).sum(-1)
    points[~(square <= least)] = best[~(square <= least)]
    points[seen.sum(0) < 2] = np.nan
    return points


def reprojection_errors(points, detections, cameras):
    """(V, T, J) [px]"""
    return np.array([np.linalg.norm(camera.project(points) - view, axis=-1) for camera, view in zip(cameras, detections)])


def ransac(detections, cameras, threshold=15.0):
    """Anipose's triangulation: the pair of views with which most views agree to the threshold [px], then all that agree; and those detections."""
    best, most = None, None
    for pair in itertools.combinations(range(len(cameras)), 2):
        only = np.full_like(detections, np.nan)
        only[list(pair)] = detections[list(pair)]
        points = triangulated(only, cameras)
        errors = reprojection_errors(points, detections, cameras)
        with np.errstate(invalid="ignore"):
            is_near = errors < threshold
        score = is_near.sum(0) - np.where(np.isnan(errors), 0, np.minimum(errors, threshold)).sum(0) / (threshold * len(cameras) + 1)
        if best is None:
            best, most = is_near, score
        best = np.where(score > most, is_near, best)
        most = np.maximum(score, most)
    agreeing = np.where(best[..., None], detections, np.nan)
    return triangulated(agreeing, cameras), agreeing


def interpolated(path):
    """NaN replaced by straight lines over frames; zeros where a joint is never found."""
    path = path.copy()
    frames = np.arange(len(path))
    for column in path.reshape(len(path), -1).T:
        is_known = np.isfinite(column)
        column[:] = np.interp(frames, frames[is_known], column[is_known]) if is_known.any() else 0
    return path


def median_filtered(path, width=7):
    padded = np.pad(path, ((width // 2, width // 2), (0, 0), (0, 0)), constant_values=np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return interpolated(np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, width, axis=0), -1))


def savitzky_golay(path, width=9, order=3):
    return signal.savgol_filter(interpolated(path), width, order, axis=0)


def one_euro(path, least_cutoff=0.1, slope=0.1, derivative_cutoff=1.0):
    """Casiez et al. 2012, at one frame a unit of time, causal; cutoffs in periods a frame."""
    path = interpolated(path)
    found, speed = path.copy(), np.zeros_like(path[0])
    share = lambda cutoff: 1 / (1 + 1 / (2 * np.pi * cutoff))
    for t in range(1, len(path)):
        a = share(derivative_cutoff)
        speed = a * (path[t] - found[t - 1]) + (1 - a) * speed
        a = share(least_cutoff + slope * np.abs(speed))
        found[t] = a * path[t] + (1 - a) * found[t - 1]
    return found


def anipose(detections, cameras, start, skeleton=(), smooth=4.0, length=2.0, threshold=15.0, order=3, steps=20):
    """Karashchuk et al. 2021: reprojection with a soft L1 loss, third differences, limb lengths; SciPy's trust region.

    detections: those on which RANSAC agrees, of which start is the triangulation.
    """
    start = median_filtered(start)
    frames, joints, _ = start.shape
    smooth = smooth / np.mean(np.abs(np.diff(start, axis=0)))
    limbs = np.array(list(skeleton), int).reshape(-1, 2)
    seen = np.isfinite(detections[..., 0])
    n = start.size
    lengths = np.median(np.linalg.norm(start[:, limbs[:, 0]] - start[:, limbs[:, 1]], axis=-1), axis=0)

    def errors(x):
        path = x[:n].reshape(start.shape)
        pixels = np.concatenate([(camera.project(path) - view)[s].ravel() for camera, view, s in zip(cameras, detections, seen)])
        pixels = threshold * 2 * (np.sqrt(1 + np.abs(pixels) / threshold) - 1)
        change = np.diff(path, order, axis=0).ravel() * smooth
        found = np.linalg.norm(path[:, limbs[:, 0]] - path[:, limbs[:, 1]], axis=-1)
        return np.concatenate([pixels, change, (length * 100 * (found / np.maximum(np.abs(x[n:]), 1e-12) - 1)).ravel()])

    # Which unknowns each error depends on.
    node = np.arange(n).reshape(start.shape)
    places = [np.repeat(node[s], 2, axis=0) for s in seen]
    change = np.concatenate([node[k : frames - order + k].reshape(-1, 1) for k in range(order + 1)], 1)
    ends = np.concatenate([node[:, limbs[:, 0]], node[:, limbs[:, 1]], np.broadcast_to(n + np.arange(len(limbs)), (frames, len(limbs)))[..., None]], -1)
    blocks = [*places, change, ends.reshape(-1, 7)]
    rows = np.concatenate([np.repeat(np.arange(len(b)) + sum(map(len, blocks[:i])), b.shape[1]) for i, b in enumerate(blocks)])
    pattern = sparse.csr_matrix((np.ones(len(rows), bool), (rows, np.concatenate([b.ravel() for b in blocks]))), (sum(map(len, blocks)), n + len(limbs)))
    return optimize.least_squares(errors, np.append(start.ravel(), lengths), jac_sparsity=pattern, ftol=1e-3, max_nfev=steps).x[:n].reshape(start.shape)


def eks(path, variance):
    """Biderman et al. 2024, one camera: a random walk for each joint, observed with the variance of an ensemble, smoothed over all frames.

    path, variance: (T, J, 2). The step's variance is a multiple of that of the observed steps, of maximum likelihood.
    """
    path, variance = path.copy(), np.maximum(variance, 1e-4)
    variance[~np.isfinite(path)] = 1e12
    path = interpolated(path)
    scale = np.var(np.diff(path, axis=0), axis=0)  # (J, 2)

    def filtered(step):
        mean, spread, loss = path[0], np.full_like(scale, 1e6), np.zeros(scale.shape[0])
        means, spreads = np.empty_like(path), np.empty_like(path)
        for t in range(len(path)):
            spread = spread + (step if t else 0)
            total = spread + variance[t]
            if t:
                loss = loss + ((path[t] - mean) ** 2 / total + np.log(total)).sum(-1)
            gain = spread / total
            mean, spread = mean + gain * (path[t] - mean), (1 - gain) * spread
            means[t], spreads[t] = mean, spread
        return means, spreads, loss

    grid = np.logspace(-6, 1, 29)
    best = grid[np.argmin([filtered(scale * s)[2] for s in grid], axis=0)]
    step = scale * best[:, None]
    means, spreads, _ = filtered(step)
    for t in range(len(path) - 2, -1, -1):
        means[t] += spreads[t] / (spreads[t] + step + 1e-300) * (means[t + 1] - means[t])
    return means
