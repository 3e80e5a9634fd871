"""Transforms of the plane: `t(points)`, `a @ b` (b first), `t.inverse()`.

`Rigid`, `Similarity` and `Affine` are the exact members of the family; `Rigid` is a `Similarity` and that is an
`Affine`. A composition is of the wider kind of the two, an inverse keeps its kind.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


class Transform(ABC):
    """A one-to-one map of the plane onto itself, in metres.

    Name a transform by its frames, target first: `reference_from_source` takes source coordinates to reference ones,
    so that `a_from_b @ b_from_c` is `a_from_c`.
    """

    @abstractmethod
    def __call__(self, points: ArrayLike) -> FloatArray:
        """Move points, shape (n, 2) in metres, to new ones of the same shape."""

    @abstractmethod
    def __matmul__(self, other: Any) -> Any:
        """Compose: `(a @ b)(p)` is `a(b(p))`."""

    @abstractmethod
    def inverse(self) -> Transform:
        """The transform that undoes this one."""


class Affine(Transform):
    """Any linear map and a shift: `p -> linear @ p + shift`.

    `linear` is (2, 2), `shift` (2,) in metres; both are read-only copies. A `ValueError` is raised for a map that is
    not finite or cannot be inverted.
    """

    __slots__ = ("linear", "shift")
    linear: FloatArray
    shift: FloatArray

    def __init__(self, linear: ArrayLike, shift: ArrayLike) -> None:
        linear_array = self._checked(np.array(linear, dtype=np.float64).reshape(2, 2))
        shift_array = np.array(shift, dtype=np.float64).reshape(2)
        if not np.isfinite(shift_array).all():
            raise ValueError("the shift of a transform must be finite")
        linear_array.setflags(write=False)
        shift_array.setflags(write=False)
        object.__setattr__(self, "linear", linear_array)
        object.__setattr__(self, "shift", shift_array)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (np.array(self.linear), np.array(self.shift))

    @staticmethod
    def _checked(linear: FloatArray) -> FloatArray:
        """The linear part as it is kept: checked, and made exactly of its kind."""
        (a, b), (c, d) = linear.tolist()
        if not math.isfinite(a + b + c + d):
            raise ValueError("a transform must be finite")
        if not abs(a * d - b * c) > 1e-12 * max(abs(a), abs(b), abs(c), abs(d), 1e-150) ** 2:
            raise ValueError("a transform must be invertible")
        return linear

    @classmethod
    def identity(cls) -> Self:
        """The transform that moves nothing."""
        return cls(np.eye(2), np.zeros(2))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Self:
        """From a 3x3 homogeneous matrix whose last row is 0, 0, 1. `ValueError` for any other."""
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape != (3, 3) or not np.allclose(m[2], (0, 0, 1), rtol=0, atol=1e-9):
            raise ValueError("a transform's matrix is 3x3 and its last row is 0, 0, 1")
        return cls(m[:2, :2], m[:2, 2])

    @property
    def matrix(self) -> FloatArray:
        """The 3x3 homogeneous matrix, for column vectors (x, y, 1)."""
        m = np.eye(3)
        m[:2, :2] = self.linear
        m[:2, 2] = self.shift
        return m

    @property
    def rotation_deg(self) -> float:
        """The rotation nearest to the linear part, in degrees, counter-clockwise positive, in (-180, 180]."""
        (a, b), (c, d) = self.linear
        return math.degrees(math.atan2(c - b, a + d))

    @property
    def scale(self) -> float:
        """Square root of the factor by which areas grow."""
        return math.sqrt(abs(float(np.linalg.det(self.linear))))

    def __call__(self, points: ArrayLike) -> FloatArray:
        """Move points, shape (n, 2) in metres."""
        return np.asarray(np.asarray(points, dtype=np.float64) @ self.linear.T + self.shift)

    def __matmul__(self, other: Any) -> Affine:
        """Compose (`other` first); the result is of the wider kind of the two."""
        if not isinstance(other, Affine):
            return NotImplemented
        kind = next(k for k in (Rigid, Similarity, Affine) if isinstance(self, k) and isinstance(other, k))
        return kind(self.linear @ other.linear, self.linear @ other.shift + self.shift)

    def inverse(self) -> Self:
        """The transform that undoes this one, of the same kind."""
        linear = np.linalg.inv(self.linear)
        return type(self)(linear, -linear @ self.shift)

    def about(self, origin: ArrayLike) -> Self:
        """The same motion in coordinates from which `origin` was subtracted.

        `t.about(-origin)` brings it back to full coordinates.
        """
        o = np.asarray(origin, dtype=np.float64)
        return type(self)(self.linear, self.linear @ o + self.shift - o)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Affine):
            return NotImplemented
        return (
            type(self) is type(other)
            and np.array_equal(self.linear, other.linear)
            and np.array_equal(self.shift, other.shift)
        )

    def __hash__(self) -> int:
        return hash((type(self), self.linear.tobytes(), self.shift.tobytes()))

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(rotation_deg={self.rotation_deg:.4f}, "
            f"scale={self.scale:.6f}, shift={np.round(self.shift, 4).tolist()})"
        )


class Similarity(Affine):
    """A rotation, one scale for both axes, and a shift; no reflection.

    A linear part that is not a scaled rotation (to 1e-6) raises `ValueError`; rounding below that is removed.
    """

    __slots__ = ()

    @staticmethod
    def _checked(linear: FloatArray) -> FloatArray:
        linear = Affine._checked(linear)
        (a, b), (c, d) = linear.tolist()
        cos, sin = (a + d) / 2, (c - b) / 2
        if max(abs(a - cos), abs(b + sin)) > 1e-6 * max(abs(a), abs(b), abs(c), abs(d)):
            raise ValueError("a similarity is a scaled rotation without reflection")
        return np.array([[cos, -sin], [sin, cos]])


class Rigid(Similarity):
    """A rotation and a shift: lengths and areas stay.

    A linear part that is not a rotation (to 1e-6) raises `ValueError`; rounding below that is removed.
    """

    __slots__ = ()

    @staticmethod
    def _checked(linear: FloatArray) -> FloatArray:
        exact = Similarity._checked(linear)
        scale = math.hypot(exact[0, 0], exact[1, 0])
        if abs(scale - 1) > 1e-6:
            raise ValueError("a rigid transform has scale 1")
        return exact / scale

    @classmethod
    def turn(cls, rotation_deg: float, about: ArrayLike = (0.0, 0.0), shift: ArrayLike = (0.0, 0.0)) -> Self:
        """A turn about a point (degrees, counter-clockwise), then a shift in metres."""
        angle = math.radians(rotation_deg)
        cos, sin = math.cos(angle), math.sin(angle)
        linear = np.array([[cos, -sin], [sin, cos]])
        centre = np.asarray(about, dtype=np.float64)
        return cls(linear, centre - linear @ centre + np.asarray(shift, dtype=np.float64))


class Model(Enum):
    """Which kind of transform is fitted: `rigid`, `similarity` or `affine`."""

    RIGID = "rigid"
    SIMILARITY = "similarity"
    AFFINE = "affine"

    @property
    def kind(self) -> type[Affine]:
        """The class of transform that this model gives."""
        return {"rigid": Rigid, "similarity": Similarity, "affine": Affine}[self.value]

    @property
    def parameters(self) -> int:
        """How many numbers the model fits: 3, 4 or 6."""
        return {"rigid": 3, "similarity": 4, "affine": 6}[self.value]

    def fit(self, source: ArrayLike, reference: ArrayLike, weights: ArrayLike | None = None) -> Affine:
        """The weighted least-squares transform that takes `source` (n, 2) to `reference` (n, 2), metres.

        Rigid and similarity in closed form without reflection (Umeyama 1991, doi:10.1109/34.88573). Raises
        `ValueError` when the points do not determine the model: fewer than 2 distinct ones (3 not on a line for
        affine), or no positive weight.
        """
        p, q = np.asarray(source, dtype=np.float64), np.asarray(reference, dtype=np.float64)
        w = np.ones(len(p)) if weights is None else np.asarray(weights, dtype=np.float64)
        total = float(w.sum())
        if not total > 0:
            raise ValueError("no point has a positive weight")
        w = w / total
        p_mean, q_mean = w @ p, w @ q
        p0, q0 = p - p_mean, q - q_mean
        cross = (q0 * w[:, None]).T @ p0
        spread = (p0 * w[:, None]).T @ p0
        eigenvalues = np.linalg.eigvalsh(spread)
        least = eigenvalues[0] if self is Model.AFFINE else eigenvalues[1]
        if not least > 1e-9 * max(1.0, float(eigenvalues[1])):
            raise ValueError("the points do not determine the transform")
        if self is Model.AFFINE:
            linear = cross @ np.linalg.inv(spread)
        else:
            cos, sin = cross[0, 0] + cross[1, 1], cross[1, 0] - cross[0, 1]
            length = math.hypot(cos, sin)
            if length == 0:
                raise ValueError("the points do not determine the rotation")
            scale = 1.0 if self is Model.RIGID else length / float(np.trace(spread))
            linear = np.array([[cos, -sin], [sin, cos]]) * (scale / length)
        return self.kind(linear, q_mean - linear @ p_mean)
