"""Mutual nearest neighbours, straight rows and large crowns, as a plugin of treereg."""

from treereg_core import hookimpl
from treereg_core.method import Method
from treereg_core.recipe import Recipe
from treereg_outside.crowns import LargeCrowns
from treereg_outside.mutual import Mutual
from treereg_outside.straight_rows import StraightRows

__all__ = ["LargeCrowns", "Mutual", "StraightRows", "treereg_methods", "treereg_recipes"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [LargeCrowns, StraightRows, Mutual]


@hookimpl
def treereg_recipes() -> list[Recipe]:
    """Its recipes."""
    return [
        Recipe(
            "outside",
            "straight_rows+large_crowns+mutual",
            "mutual nearest neighbours among the larger trees of straight rows",
            {"large_crowns": {"share": 0.8}},
        )
    ]
