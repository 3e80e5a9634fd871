"""treereg lays one drone survey of an orchard exactly over another, tree on tree, and says when it cannot."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from treereg_core.api import register
    from treereg_core.detection import detect_rows
    from treereg_core.features import FeatureSet
    from treereg_core.hookspecs import hookimpl

__all__ = ["FeatureSet", "detect_rows", "hookimpl", "register"]

_HOMES = {
    "FeatureSet": "treereg_core.features",
    "detect_rows": "treereg_core.detection",
    "hookimpl": "treereg_core.hookspecs",
    "register": "treereg_core.api",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for, so that importing the package stays quick."""
    if name not in _HOMES:
        raise AttributeError(f"module 'treereg_core' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
