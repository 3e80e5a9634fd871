"""Recipe: a name for a method expression with settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Recipe:
    """A name that stands for an expression of methods, each with the settings given here.

    - `name`: what a user types, by the rules of a method's name.
    - `expression`: names of methods joined by `+`; no recipe among them.
    - `description`: one line for `treereg methods`.
    - `settings`: by method and setting; what the user sets goes before.
    """

    name: str
    expression: str
    description: str
    settings: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
