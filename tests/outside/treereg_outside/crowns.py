"""Keeps the trees with the largest crowns."""

import numpy as np
from pydantic import Field

from treereg_core import hookimpl
from treereg_core.features import FeatureSet
from treereg_core.method import Context, FeatureFilter, Method
from treereg_core.pair import Pair


class LargeCrowns(FeatureFilter):
    """Keeps the largest crowns: the proposal's filter (section 3.2.1) with crown area for confidence.

    Good where young replants are placed less exactly than grown trees.
    """

    name = "large_crowns"
    needs_pair = False

    share: float = Field(0.7, gt=0, le=1, description="share of each survey's trees that is kept, the largest")

    def select(self, pair: Pair, context: Context) -> Pair:
        """Both surveys less their smallest trees."""
        return pair.narrow(self._largest(pair.reference), self._largest(pair.source))

    def _largest(self, features: FeatureSet) -> FeatureSet:
        if len(features) == 0:
            return features
        return features.take(features.area >= np.quantile(features.area, 1 - self.share))


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this file."""
    return [LargeCrowns]
