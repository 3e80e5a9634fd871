"""Coherent point drift, as a plugin of treereg."""

from treereg_core import hookimpl
from treereg_core.method import Method
from treereg_cpd.cpd import Cpd

__all__ = ["Cpd", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Cpd]
