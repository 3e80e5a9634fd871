"""A Bayesian network that says which rows of two surveys are the same, as a plugin of treereg."""

from __future__ import annotations

from treereg_bn_rows.matcher import BnRows
from treereg_core import hookimpl
from treereg_core.method import Method

__all__ = ["BnRows", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [BnRows]
