"""Landmarks by a Bayesian network, as a plugin of treereg."""

from treereg_bn_landmarks.landmarks import Landmarks
from treereg_core import hookimpl
from treereg_core.method import Method

__all__ = ["Landmarks", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Landmarks]
