"""Coherent point drift over tree centroids."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from treereg_core.errors import NoRegistration
from treereg_core.method import Context, PointMatcher, Registration
from treereg_core.pair import Pair
from treereg_core.transform import Model
from treereg_cpd.drift import Drift

# Tree spacings: a placement that moves less from round to round is settled.
SETTLED = 1e-6
# Pairs less likely than this are left out of what is returned.
UNLIKELY = 1e-6


class Cpd(PointMatcher):
    """Coherent point drift (Myronenko & Song 2010, doi:10.1109/TPAMI.2010.46) by the library pycpd, rigid, scale 1.

    The source's trees are the centres of a mixture of Gaussians that all have one spread, the reference's are drawn
    from it or are strangers; expectation maximisation moves the centres as one body. It begins at the placement that it
    is given, with `reach` as the spread, which shrinks as the fit gets better. Lengths are in tree spacings, since
    pycpd's even density of strangers is one to the unit of area.

    Good from a start within about half the tree spacing; like all matchers of points it is blind to the lattice, and
    ends a tree or a row over from a start that is further off. Each tree is compared with each other tree, so time and
    memory (40 bytes for each such pair) grow with the product of both surveys: 1,500 trees each are a matter of seconds
    and 0.1 GB, 3,000 of four times that. More than `most_trees` are refused; `icp` is the method for them. Matched rows
    count through the placement that they give. Raises `NoRegistration` where it has not settled, or has no pairs left.
    """

    name = "cpd"
    models: ClassVar[frozenset[Model]] = frozenset({Model.RIGID})

    outliers: float = Field(
        0.3, ge=0, lt=1, description="share of the reference's trees that are taken for strangers (w in the paper)"
    )
    reach: float = Field(
        0.4,
        gt=0,
        le=10,
        description="spread of partners about each other at the start, as a standard deviation per axis",
        json_schema_extra={"unit": "tree spacings"},
    )
    rounds: int = Field(100, ge=1, le=10000, description="most rounds before it is said not to settle")
    most_trees: int = Field(3000, ge=3, le=20000, description="surveys with more trees than this are refused")

    def register(self, pair: Pair, context: Context) -> Registration:
        """Drift the source from its placement onto the reference, until nothing moves any more."""
        reference, source = pair.reference, pair.source
        unit = reference.spacing
        if min(len(reference), len(source)) < 3 or unit == 0:
            raise NoRegistration("there are too few trees")
        most = max(len(reference), len(source))
        if most > self.most_trees:
            raise NoRegistration(f"{most} trees are more than the {self.most_trees} of cpd.most_trees; icp takes them")
        centre = reference.xy.mean(axis=0)
        drift = Drift(
            X=(reference.xy - centre) / unit,
            Y=(pair.reference_from_source(source.xy) - centre) / unit,
            weight=np.outer(source.weight, reference.weight),
            sigma=self.reach,
            w=self.outliers,
        )
        try:
            if all(drift.round() > SETTLED for _ in range(self.rounds)):
                raise NoRegistration(f"it has not settled after {self.rounds} rounds")
            j, i = np.nonzero(drift.P > UNLIKELY)
            fitted = context.model.fit(source.xy[j], reference.xy[i], drift.P[j, i])
        except ValueError as error:
            raise NoRegistration(str(error)) from None
        return Registration(fitted, np.column_stack([reference.ids[i], source.ids[j]]), drift.P[j, i])
