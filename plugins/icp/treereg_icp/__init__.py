"""Iterative closest point and the confidence filter, as plugins of treereg."""

from treereg_core import hookimpl
from treereg_core.method import Method
from treereg_icp.confidence import ConfidenceFilter
from treereg_icp.icp import Icp

__all__ = ["ConfidenceFilter", "Icp", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Icp, ConfidenceFilter]
