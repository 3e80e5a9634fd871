"""The global search, as a plugin of treereg."""

from treereg_coarse.coarse import Coarse
from treereg_core import hookimpl
from treereg_core.method import Method

__all__ = ["Coarse", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Coarse]
