"""The filter of large crowns."""

import numpy as np
from pydantic import Field

from treereg_core.features import FeatureSet
from treereg_core.method import Context, FeatureFilter
from treereg_core.pair import Pair


class LargeCrowns(FeatureFilter):
    """Keeps the largest crowns: the proposal's filter (section 3.2.1) with crown area for confidence."""

    name = "large_crowns"
    needs_pair = False

    share: float = Field(0.7, gt=0, le=1, description="share of each survey's trees that is kept, the largest")

    def select(self, pair: Pair, context: Context) -> Pair:
        return pair.narrow(self._largest(pair.reference), self._largest(pair.source))

    def _largest(self, features: FeatureSet) -> FeatureSet:
        if len(features) == 0:
            return features
        return features.take(features.area >= np.quantile(features.area, 1 - self.share))
