"""Records of settings in the API: their settings as a list, in place of a signature that nobody can read."""

import re
from inspect import isclass
from typing import TypeGuard

from pydantic import BaseModel
from sphinx.application import Sphinx

from treereg_core.settings import describe, range_in_words


def is_record(thing: object) -> TypeGuard[type[BaseModel]]:
    """Whether it is a class of records."""
    return isclass(thing) and issubclass(thing, BaseModel) and thing is not BaseModel


def signature(
    app: Sphinx, what: str, name: str, thing: object, options: object, text: str | None, returns: str | None
) -> tuple[str, str | None] | None:
    """None of its own for a record; defaults that are no Python are made such, so that names in it lead somewhere."""
    if is_record(thing):
        return "", None
    return (plain(text), returns and plain(returns)) if text else None


def plain(text: str) -> str:
    """A signature in which every default is Python, and every alias a name."""
    text = re.sub(r"<function (\w+)>", r"\1", text.replace("<factory>", "..."))
    return re.sub(r"~?(?:\w+\.)*TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def settings(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """The settings of a record after its docstring."""
    for setting, known in describe(thing).items() if is_record(thing) else ():
        words = [f"- `{setting}`"]
        if "default" in known:
            words.append(f"= `{known['default']}`")
        allowed = range_in_words(known) or known.get("unit", "")
        words.append(f"({allowed})" if allowed else "")
        lines.append(" ".join(filter(None, words)) + (f": {known['description']}" if "description" in known else ""))
    lines.append("")


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx."""
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-process-docstring", settings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
