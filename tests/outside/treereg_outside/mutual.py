"""Trimmed ICP over mutual nearest neighbours."""

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from treereg_core.errors import NoRegistration
from treereg_core.method import Context, PointMatcher, Registration
from treereg_core.pair import Pair


class Mutual(PointMatcher):
    """Trimmed ICP over mutual nearest neighbours (Chetverikov et al. 2005, doi:10.1016/j.imavis.2004.05.007)."""

    name = "mutual"

    reach: float = Field(0.6, gt=0, le=5, description="farthest pair", json_schema_extra={"unit": "tree spacings"})
    rounds: int = Field(50, ge=1, le=500, description="most rounds before it stops")

    def register(self, pair: Pair, context: Context) -> Registration:
        """Pair trees that are each other's nearest and fit the model to them, until nothing moves any more."""
        reference, source = pair.reference, pair.source
        if min(len(reference), len(source)) < 3 or reference.spacing == 0:
            raise NoRegistration("there are too few trees")
        transform = pair.reference_from_source
        for _ in range(self.rounds):
            moved = transform(source.xy)
            distance, i = map(np.asarray, reference.tree.query(moved))
            back = np.asarray(cKDTree(moved).query(reference.xy)[1])
            j = np.flatnonzero((back[i] == np.arange(len(moved))) & (distance < self.reach * reference.spacing))
            if len(j) < 3:
                raise NoRegistration("fewer than three pairs are within reach")
            j = j[distance[j] <= 4 * np.median(distance[j]) + 1e-9]
            weights = reference.weight[i[j]] * source.weight[j]
            try:
                fitted = context.model.fit(source.xy[j], reference.xy[i[j]], weights)
            except ValueError as error:
                raise NoRegistration(str(error)) from None
            settled = np.abs(fitted(source.xy) - moved).max() < 1e-9
            transform = fitted
            if settled:
                break
        return Registration(transform, np.column_stack([reference.ids[i[j]], source.ids[j]]), weights)
