"""The confidence filter."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from treereg_core.features import FeatureSet
from treereg_core.method import Context, FeatureFilter
from treereg_core.pair import Pair


class ConfidenceFilter(FeatureFilter):
    """Keeps the trees that the detector is sure of (treereg's founding proposal, section 3.2.1).

    A fixed threshold is what was proposed, but detectors differ: real orchards' mean confidence runs from 0.3 to 0.9,
    so that 0.9 empties some. When fewer than `least` of a survey's trees would pass, its most confident `least` pass
    instead. `share` keeps the most confident share and asks for no threshold.
    """

    name = "confidence"
    needs_pair = False

    threshold: float = Field(0.9, ge=0, le=1, description="trees of at least this confidence pass")
    share: float | None = Field(
        None, gt=0, le=1, description="instead of a threshold: this share of each survey's trees, the most confident"
    )
    least: float = Field(
        0.5, ge=0, le=1, description="at least this share of a survey's trees passes whatever the threshold"
    )

    def select(self, pair: Pair, context: Context) -> Pair:
        """Both surveys less the trees whose confidence is too low."""
        return pair.narrow(self._confident(pair.reference, context), self._confident(pair.source, context))

    def _confident(self, features: FeatureSet, context: Context) -> FeatureSet:
        passing = int((features.confidence >= self.threshold).sum())
        floor = int(np.ceil((self.least if self.share is None else self.share) * len(features)))
        if self.share is None and passing >= floor:
            return features.take(features.confidence >= self.threshold)
        if self.share is None:
            context.progress(
                f"only {passing} of {len(features)} trees reach confidence {self.threshold:g}: "
                f"the {floor} most confident are used"
            )
        # Ties at the cut all pass, so that the order of trees in the file decides nothing.
        cut = np.sort(features.confidence)[len(features) - floor] if floor else np.inf
        return features.take(features.confidence >= cut)
