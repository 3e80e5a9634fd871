"""Laying rows on rows: the placements that bring the lines of one survey onto those of the other.

Lines fix the turn and the shift across the rows. Along them nearly nothing is fixed: what a placement has there stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from treereg_core.errors import NoRegistration
from treereg_core.features import IntArray
from treereg_core.row_lines import RowLines
from treereg_core.transform import Affine, FloatArray, Model

# Steps of a placement are held back by this share of what lines say in their own direction.
DAMPING = 0.02
# A tree is beside a line that is nearer than this, in row distances.
BESIDE = 0.75
# The rotation, the scale, and the two ways to shear: a model fits the first few.
WAYS = np.array([[[0, -1], [1, 0]], [[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Laid:
    """Placements (k) of the kind of `template`, `reference_from_source`: linear parts (k, 2, 2), shifts (k, 2), metres.

    `tight` (k,) is the share of the source's trees beside a line of the reference that lie close to it.
    """

    template: type[Affine]
    linear: FloatArray
    shift: FloatArray
    tight: FloatArray

    @classmethod
    def of(cls, transforms: Sequence[Affine]) -> Laid:
        """Placements of one kind as they are."""
        linear, shift = np.array([t.linear for t in transforms]), np.array([t.shift for t in transforms])
        return cls(type(transforms[0]), linear, shift, np.zeros(len(shift)))

    def __len__(self) -> int:
        return len(self.shift)

    def take(self, index: IntArray) -> Laid:
        """Those at these positions, in that order."""
        return replace(self, linear=self.linear[index], shift=self.shift[index], tight=self.tight[index])

    def moved(self, steps: FloatArray) -> Laid:
        """Each of them moved by each of the steps (j, 2), metres: k times j placements."""
        j = len(steps)
        shift = (self.shift[:, None] + steps).reshape(-1, 2)
        return replace(self, linear=np.repeat(self.linear, j, axis=0), shift=shift, tight=np.repeat(self.tight, j))

    def transforms(self) -> tuple[Affine, ...]:
        """The placements as values."""
        return tuple(self.template(a, s) for a, s in zip(self.linear, self.shift, strict=True))


def start_of(placement: Affine, model: Model, source: RowLines) -> Affine:
    """A placement of the source as one of the kind that is fitted.

    Raises `NoRegistration` when the rows do not determine it.
    """
    if isinstance(placement, model.kind):
        return model.kind.from_matrix(placement.matrix)
    try:
        return model.fit(source.smooth, placement(source.smooth))
    except ValueError as error:
        raise NoRegistration(f"the rows of the source are too few to fix a placement: {error}") from None


def lay(reference: RowLines, source: RowLines, sample: IntArray, start: Laid, widths: tuple[float, ...]) -> Laid:
    """Bring the source's trees at positions `sample` of its lines onto the reference's lines, from each start.

    Point-to-line least squares (Chen & Medioni 1992, doi:10.1016/0262-8856(92)90066-C), reweighted: one round for each
    of the `widths`, metres, beyond which a line is not believed to be a tree's own.
    """
    model = next(m for m in Model if m.kind is start.template)
    ways = WAYS[: model.parameters - 2]
    points, tangent = source.smooth[sample], source.tangent[sample]
    k, m = len(start), len(points)
    linear, shift, tight = start.linear, start.shift, start.tight
    reach = BESIDE * reference.distance
    for width in widths:
        moved = points @ linear.transpose(0, 2, 1) + shift[:, None]
        ahead = tangent @ linear.transpose(0, 2, 1)
        feet = reference.feet(moved.reshape(-1, 2), ahead.reshape(-1, 2), reach)
        across = feet.across.reshape(k, m)
        found = feet.found.reshape(k, m)
        weight = np.where(found, np.exp(-0.5 * (across / width) ** 2), 0.0)
        tight = weight.sum(axis=1) / np.maximum(found.sum(axis=1), m / 4)
        centre = moved.mean(axis=1)
        arm = moved - centre[:, None]
        size = np.maximum(np.sqrt((arm**2).sum(axis=(1, 2)) / m), 1e-6)[:, None, None, None]
        # Displacements (k, m, 2, parameters) per unit of each parameter, all of them of the size of a metre.
        basis = np.empty((k, m, 2, 2 + len(ways)))
        basis[..., :2] = np.eye(2)
        basis[..., 2:] = np.einsum("wij,kmj->kmiw", ways, arm) / size
        normal = feet.normal.reshape(k, m, 2, 1)
        seen = (basis * normal).sum(axis=2)
        weighted = seen * weight[..., None]
        information = weighted.transpose(0, 2, 1) @ seen
        everything = (basis * weight[..., None, None]).reshape(k, 2 * m, -1)
        information += DAMPING * everything.transpose(0, 2, 1) @ basis.reshape(k, 2 * m, -1)
        information += 1e-9 * np.eye(information.shape[1])
        step = -np.linalg.solve(information, (weighted * across[..., None]).sum(axis=1)[..., None])[..., 0]
        change = np.eye(2) + np.einsum("kw,wij->kij", step[:, 2:] / size[:, 0, 0], ways)
        if model is Model.RIGID:
            change /= np.sqrt(np.linalg.det(change))[:, None, None]
        shift = (change @ (shift - centre)[..., None])[..., 0] + centre + step[:, :2]
        linear = change @ linear
    return replace(start, linear=linear, shift=shift, tight=tight)
