"""Weighs each tree by how sure the detector is of it."""

from pydantic import Field

from treereg_core.features import FeatureSet
from treereg_core.method import Context, FeatureFilter
from treereg_core.pair import Pair


class Template(FeatureFilter):
    """Weighs each tree by its confidence, as in weighted least squares (Aitken 1936, doi:10.1017/S0370164600014346).

    Good where false detections are the unsure ones: all trees stay, and those count less.
    """

    name = "template"
    needs_pair = False

    power: float = Field(1.0, ge=0, le=4, description="the weight is the confidence to this power; 0: all count alike")

    def select(self, pair: Pair, context: Context) -> Pair:
        """Both surveys with all their trees, and other weights."""
        return pair.narrow(self._weighed(pair.reference), self._weighed(pair.source))

    def _weighed(self, features: FeatureSet) -> FeatureSet:
        return features.replace(weight=features.weight * features.confidence**self.power)
