"""Planting rows by ant colony optimisation, as a plugin of treereg."""

from treereg_aco.aco import Aco
from treereg_core import hookimpl
from treereg_core.method import Method

__all__ = ["Aco", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Aco]
