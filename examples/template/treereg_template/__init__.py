"""What this distribution offers to treereg."""

from treereg_core import hookimpl
from treereg_core.method import Method
from treereg_template.template import Template

__all__ = ["Template", "treereg_methods"]


@hookimpl
def treereg_methods() -> list[type[Method]]:
    """The methods of this distribution."""
    return [Template]
