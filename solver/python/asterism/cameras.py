"""Calibrated cameras, for asterism.pose."""

from __future__ import annotations

import dataclasses
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from . import _asterism, inputs

_Floats = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera, as OpenCV describes it: a point X of the world is seen by cv::projectPoints. ValueError for other shapes."""

    #: (3, 3) [px].
    matrix: npt.ArrayLike
    #: Rotation from the world to the camera: (3, 3), or a Rodrigues vector (3,), which may be a column (3, 1), as translation may.
    rotation: npt.ArrayLike
    #: (3,), in the world's unit of length.
    translation: npt.ArrayLike
    #: k1, k2, p1, p2, k3; the last ones may be left out.
    distortions: npt.ArrayLike = ()
    #: Width and height of the image [px], if known.
    size: Sequence[float] | None = None
    name: str = ""

    def __post_init__(self) -> None:
        def keep(field: str, value: Any) -> None:
            object.__setattr__(self, field, value)

        if not isinstance(self.name, str):
            raise TypeError(f"camera: name: expected a string, found {inputs.shown(self.name)}")
        where = f"camera {self.name}".rstrip()
        for field, shapes in [("matrix", [(3, 3)]), ("rotation", [(3, 3), (3,)]), ("translation", [(3,)])]:
            value = np.array(inputs.numbers(getattr(self, field), f"{where}: {field}"))
            if field != "matrix" and value.shape in ((3, 1), (1, 3)):  # a vector, as OpenCV returns it
                value = value.ravel()
            if value.shape not in shapes:
                raise ValueError(f"{where}: {field}: expected shape {' or '.join(map(str, shapes))}, found {value.shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"{where}: {field}: expected finite numbers")
            keep(field, value)
        distortions = np.array(inputs.numbers(self.distortions, f"{where}: distortions")).ravel()
        if len(distortions) > 5 or not np.isfinite(distortions).all():
            found = f"{len(distortions)} numbers" if np.isfinite(distortions).all() else f"{distortions}"
            raise ValueError(f"{where}: distortions: expected at most five finite numbers (k1, k2, p1, p2, k3), found {found}")
        keep("distortions", np.append(distortions, np.zeros(5 - len(distortions))))
        if self.rotation.shape == (3,):
            keep("rotation", _rotation(self.rotation))
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"{where}: rotation: expected a rotation")
        if not (self.matrix[0, 0] > 0 and self.matrix[1, 1] > 0):
            raise ValueError(f"{where}: matrix: expected positive focal lengths")
        if self.matrix[1, 0] != 0 or not np.array_equal(self.matrix[2], [0, 0, 1]):
            rows = self.matrix[1:].tolist()
            raise ValueError(f"{where}: matrix: expected the last rows [0, fy, cy] and [0, 0, 1], found {rows[0]} and {rows[1]}: is it transposed?")
        if self.size is not None:
            size = np.array(inputs.numbers(self.size, f"{where}: size", (2,)))
            if not (size > 0).all():
                raise ValueError(f"{where}: size: expected a positive width and height")
            keep("size", size)

    def project(self, points: npt.ArrayLike) -> _Floats:
        """The image points (..., 2) [px] of points (..., 3) of the world."""
        seen = _points(points, "points", 3) @ self.rotation.T + self.translation
        image = self._distorted(seen[..., :2] / seen[..., 2:])
        return image @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def undistort(self, pixels: npt.ArrayLike) -> tuple[_Floats, _Floats]:
        """Normalised coordinates (..., 2) of pixels (..., 2), NaN where the distortion has no inverse, and the pixels for a unit of them."""
        seen = _points(pixels, "pixels", 2)
        sights = _asterism._pose_sights(seen[None], self.matrix[None], self.distortions[None])[0]
        return sights[..., :2], sights[..., 2:].reshape(*seen.shape, 2)

    def _distorted(self, image: _Floats) -> _Floats:
        k1, k2, p1, p2, k3 = self.distortions
        x, y = image[..., 0], image[..., 1]
        r = x * x + y * y
        radial = 1 + r * (k1 + r * (k2 + r * k3))
        return np.stack([x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x), y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y], -1)


def _points(values: npt.ArrayLike, name: str, dim: int) -> _Floats:
    found = inputs.numbers(values, name, missing=np.nan)
    if found.shape[-1:] != (dim,):
        raise ValueError(f"{name}: expected shape (..., {dim}), found {found.shape}")
    return found


def _rotation(vector: _Floats) -> _Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
