"""pycpd's rigid registration for trees: scale fixed at 1, weights of trees, and an end where nothing moves."""

import warnings

import numpy as np
from numpy.typing import NDArray

with warnings.catch_warnings():
    warnings.simplefilter("ignore", SyntaxWarning)  # pycpd 2.0.0 compares numbers by `is not`
    from pycpd import RigidRegistration

Array = NDArray[np.float64]

# The spread never counts as smaller, tree spacings: copies of one survey fit exactly.
LEAST_SIGMA = 1e-3


class Drift(RigidRegistration):  # type: ignore[misc]
    """pycpd's expectation maximisation without a change of scale.

    pycpd fits a scale in every round and has no setting against it, so the maximisation is that of the paper's figure 2
    with s = 1. `X` (n, 2) are the trees that stay and `Y` (m, 2) those that move, `weight` (m, n) what each pair counts
    beside its probability, `P` (m, n) both in one after a round.
    """

    def __init__(self, X: Array, Y: Array, weight: Array, sigma: float, w: float) -> None:  # noqa: N803
        super().__init__(X=X, Y=Y, sigma2=sigma**2, w=w)
        self.weight = weight

    def round(self) -> float:
        """One expectation and one maximisation; how far the farthest point moved. `ValueError` when no pair is left."""
        before = self.TY
        self.iterate()
        return float(np.abs(self.TY - before).max())

    def expectation(self) -> None:
        """The probability of every pair, times its weight."""
        super().expectation()
        self.P *= self.weight
        self.Pt1, self.P1, self.Np = self.P.sum(axis=0), self.P.sum(axis=1), self.P.sum()
        if self.Np < self.D + 1:
            raise ValueError("fewer than three trees have a partner")

    def update_transform(self) -> None:
        """The rotation as pycpd finds it, and the shift that belongs to it at scale 1."""
        with np.errstate(all="ignore"):  # the scale, which is not used, of points that coincide
            super().update_transform()
        self.s = 1.0
        self.t = (self.Pt1 @ self.X - self.P1 @ self.Y @ self.R) / self.Np

    def update_variance(self) -> None:
        """The mean square of the residuals per axis."""
        square = self.Pt1 @ (self.X**2).sum(axis=1) + self.P1 @ (self.TY**2).sum(axis=1)
        square -= 2 * np.sum((self.P @ self.X) * self.TY)
        self.sigma2 = max(square / (self.Np * self.D), LEAST_SIGMA**2)
