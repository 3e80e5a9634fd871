"""Everything together, as a plugin of treereg: rows by ants, matched by a network, and trees that a network trusts."""

from treereg_core import hookimpl
from treereg_core.recipe import Recipe

__all__ = ["treereg_recipes"]

COMBINED = Recipe(
    name="combined",
    expression="aco+bn_rows+bn_landmarks+icp",
    description="ant-colony rows of all trees, matched by a network, ICP within the row pairs on a network's landmarks "
    "(treereg's founding proposal, section 3.3.3)",
    settings={"bn_landmarks": {"threshold": 0.15}},
)


@hookimpl
def treereg_recipes() -> list[Recipe]:
    """The recipes of this distribution."""
    return [COMBINED]
