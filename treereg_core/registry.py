"""The registry: which methods, recipes and evaluators are installed, and why the broken ones are not.

Plugins are read one by one, each by a plugin manager of its own, so that a broken one takes no other along. Pluggy's
own loader stops at the first error, and drops the second of two entry points of one name.
"""

from __future__ import annotations

import difflib
import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import cast

import pluggy

from treereg_core import hookspecs
from treereg_core.errors import InputError, PluginError, TreeregError, UsageError
from treereg_core.evaluator import Evaluator
from treereg_core.method import CoarseAligner, FeatureFilter, Method, PointMatcher, RowDetector, RowMatcher
from treereg_core.network import Network
from treereg_core.recipe import Recipe

STAGES = (FeatureFilter, RowDetector, RowMatcher, PointMatcher)
"""The roles that can stand in an expression."""
OFFERS: dict[str, tuple[type, ...]] = {
    "treereg_methods": (*STAGES, CoarseAligner),
    "treereg_evaluators": (Evaluator,),
    "treereg_recipes": (Recipe,),
}
FILES = "TREEREG_PLUGINS"
"""The environment variable that names plugin files to be used as if they were installed, parted like those of PATH."""
RESERVED = frozenset({"identity", "judge", "nearest_rows", "pipeline", "read", "start", "write"})
"""Words that mean something else in options and results."""


@dataclass(frozen=True)
class Entry:
    """One row of `treereg methods`: what is offered, by whom; `problem` says why it cannot be used.

    The distribution of what a plugin file offers is the file, and its version the word `(file)`.
    """

    name: str
    role: str
    distribution: str
    version: str
    offer: type[Method] | Recipe | None = None
    problem: str | None = None

    @property
    def origin(self) -> str:
        """Distribution and version, `treereg-x 0.1.0`."""
        return f"{self.distribution} {self.version}".strip()

    @property
    def description(self) -> str:
        """One line on what it is."""
        if self.problem:
            return self.problem
        if isinstance(self.offer, Recipe):
            return self.offer.description
        return (inspect.getdoc(self.offer) or "").partition("\n")[0]


@dataclass(frozen=True)
class Registry:
    """Everything that plugins offer, sorted by role and name."""

    entries: tuple[Entry, ...]

    def under(self, entries: Iterable[Entry]) -> Registry:
        """This registry with further entries, which hide those of the same names."""
        own = tuple(entries)
        names = {entry.name for entry in own}
        return Registry(sorted_by_role([*own, *(entry for entry in self.entries if entry.name not in names)]))

    def names(self, *kinds: type) -> list[str]:
        """The usable names whose offer is of one of these kinds (roles or `Recipe`)."""
        return [entry.name for entry in self.entries if entry.problem is None and is_of(entry.offer, kinds)]

    def origins(self, method: str, stages: Iterable[str]) -> dict[str, str]:
        """The distribution of each stage of an expression, and of each recipe that it names, by name."""
        words = (word.strip() for word in method.split("+"))
        return {name: self.entry(name).origin for name in sorted({*stages, *words})}

    def entry(self, name: str, wanted: tuple[type, ...] = (Method, Recipe)) -> Entry:
        """What stands under this name. `UsageError` when nothing does, `PluginError` when it is broken.

        `wanted` are the kinds of which the error may name others.
        """
        named = [entry for entry in self.entries if entry.name == name]
        found = min(named, key=lambda entry: entry.problem is not None, default=None)
        if found is None:
            raise UsageError(self._unknown(name, self.names(*wanted)))
        if found.problem:
            raise PluginError(f"{name!r} cannot be used: {found.problem}")
        return found

    def method(self, name: str) -> type[Method]:
        """The class of this name. `UsageError` for an unknown name or a recipe's."""
        offer = self.entry(name).offer
        if not isinstance(offer, type):
            raise UsageError(f"{name!r} is a recipe, where a method is wanted")
        return offer

    @staticmethod
    def _unknown(name: str, usable: list[str]) -> str:
        distribution = "treereg-" + name.replace("_", "-")
        if distribution in published():
            return f"{name!r} is not installed; install it with `pip install {distribution}`"
        near = difflib.get_close_matches(name.lower(), usable, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"installed are: {', '.join(usable) or 'none'}"
        return f"there is no method {name!r}; {hint}"


def is_of(offer: type[Method] | Recipe | None, kinds: tuple[type, ...]) -> bool:
    """Whether an offer is a class of these roles or, when `Recipe` is asked for, a recipe."""
    return issubclass(offer, kinds) if isinstance(offer, type) else isinstance(offer, kinds)


@cache
def published() -> frozenset[str]:
    """Distributions that treereg's own extras name: plugins that exist, installed or not."""
    try:
        wanted = metadata.requires("treereg") or []
    except metadata.PackageNotFoundError:
        return frozenset()
    return frozenset(re.split(r"[^A-Za-z0-9._-]", line)[0] for line in wanted if "extra ==" in line)


def installed() -> Registry:
    """The registry of this environment.

    Plugin files that the environment variable `TREEREG_PLUGINS` names go before what is installed. What is installed is
    read once, such a file again when it was changed. `InputError` when a file cannot be read, `PluginError` when it is
    broken.
    """
    paths = [Path(text) for text in os.environ.get(FILES, "").split(os.pathsep) if text]
    return with_files(*((path, path.resolve(), path.stat().st_mtime_ns if path.exists() else 0) for path in paths))


@cache
def with_files(*files: tuple[Path, Path, int]) -> Registry:
    """The registry of all distributions, under plugin files: each its path as given, in full, and when it changed."""
    if files:
        own = [entry for path, _, _ in files for entry in from_file(path)]
        return with_files().under(without_duplicates(own))
    return load(metadata.entry_points(group=hookspecs.GROUP))


def load(entry_points: Iterable[metadata.EntryPoint]) -> Registry:
    """The registry of what these entry points name. Never raises for a plugin's fault: that becomes an entry."""
    entries: list[Entry] = []
    for point in entry_points:
        distribution = point.dist.name if point.dist else "?"
        blank = Entry(point.name, "plugin", distribution, point.dist.version if point.dist else "")
        try:
            entries += offers(point.load(), blank)
        except (Exception, SystemExit) as error:
            entries.append(replace(blank, problem=f"{blank.origin} cannot be loaded: {in_words(error)}"))
    return Registry(sorted_by_role(without_duplicates(entries)))


def sorted_by_role(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """Entries in the order of `treereg methods`."""
    return tuple(sorted(entries, key=lambda entry: (entry.role, entry.name)))


def from_file(path: Path) -> tuple[Entry, ...]:
    """What a plugin in a single Python file offers. `InputError` when it cannot be read, `PluginError` when broken."""
    name = "treereg_plugin_file_" + re.sub(r"\W", "_", str(path))
    spec = importlib.util.spec_from_file_location(name, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise InputError(f"{path}: there is no such Python file; give the path of a plugin's .py file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # pydantic and pickle look classes up by their module
    try:
        spec.loader.exec_module(module)
        return tuple(offers(module, Entry(path.stem, "plugin", str(path), "(file)")))
    except (Exception, SystemExit) as error:
        raise PluginError(f"{path} cannot be loaded: {in_words(error)}") from error


def offers(plugin: object, blank: Entry) -> Iterator[Entry]:
    """The entries of one plugin. `PluginError` or any error of the plugin's own when it is broken."""
    manager = pluggy.PluginManager(hookspecs.GROUP)
    manager.add_hookspecs(hookspecs)
    for attribute in dir(plugin):
        check_spelling(attribute, plugin, manager)
    manager.register(plugin)
    hooks = manager.get_hookcallers(plugin) or []
    if not hooks:
        raise PluginError(f"it has none of the hooks {', '.join(OFFERS)}; mark one with @hookimpl")
    for hook in hooks:
        for offered in hook():
            for offer in offered:
                yield entry_of(offer, hook.name, blank)


def check_spelling(attribute: str, plugin: object, manager: pluggy.PluginManager) -> None:
    """Refuse a marked function that is no hook, and an unmarked one that was surely meant to be one."""
    marked = manager.parse_hookimpl_opts(plugin, attribute) is not None
    near = difflib.get_close_matches(attribute, OFFERS, n=1, cutoff=0.6 if marked else 0.85)
    if marked and attribute not in OFFERS:
        raise PluginError(f"there is no hook {attribute!r}; " + (f"did you mean {near[0]!r}?" if near else "remove it"))
    if not marked and near and inspect.isroutine(getattr(plugin, attribute, None)):
        raise PluginError(f"{attribute!r} is not marked with @hookimpl; write it as @hookimpl def {near[0]}()")


def entry_of(offer: object, hook: str, blank: Entry) -> Entry:
    """The entry of one offer, with its flaw as the problem when it has one."""
    name = getattr(offer, "name", None)
    label = name if isinstance(name, str) else getattr(offer, "__name__", blank.name)
    flaw = flaw_of(offer, OFFERS[hook])
    if flaw:
        return replace(blank, name=label, problem=f"{label} of {blank.origin} breaks the contract: {flaw}")
    if isinstance(offer, Recipe):
        return replace(blank, name=label, role="recipe", offer=offer)
    method = cast("type[Method]", offer)
    return replace(blank, name=label, role=method.role, offer=method)


def flaw_of(offer: object, kinds: tuple[type, ...]) -> str | None:
    """What is wrong with an offer, in words; None when it is usable."""
    name = getattr(offer, "name", None)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        return f"its name is {name!r}, where lower-case letters, digits and underscores are wanted"
    if name in RESERVED:
        return f"the name {name!r} is reserved"
    if isinstance(offer, Recipe) and Recipe in kinds:
        return None
    if not isinstance(offer, type) or not issubclass(offer, kinds):
        return f"it is not one of {', '.join(kind.__name__ for kind in kinds)}"
    if not issubclass(offer, Method):
        return "it is not a method"
    if sum(issubclass(offer, kind) for kind in (*STAGES, CoarseAligner, Evaluator)) > 1:
        return "it plays more than one role"
    if inspect.isabstract(offer):
        return f"it does not define {', '.join(sorted(offer.__abstractmethods__))}"
    if not offer.model_config.get("frozen") or offer.model_config.get("extra") != "forbid":
        return "its settings are not frozen or it takes unknown ones"
    if not isinstance(offer.network, Network | None):
        return "its network is not a `treereg_core.network.Network`"
    try:
        offer()
    except Exception as error:
        return f"it cannot be made with its own defaults ({in_words(error)})"
    return None


def without_duplicates(entries: list[Entry]) -> Iterator[Entry]:
    """The entries, those that share a name made into one that names all who offer it."""
    for name in dict.fromkeys(entry.name for entry in entries if entry.problem is None):
        same = [entry for entry in entries if entry.name == name and entry.problem is None]
        if len(same) == 1:
            yield same[0]
        else:
            givers = " and ".join(entry.origin for entry in same)
            problem = f"{name!r} is offered by {givers}; keep one of them"
            yield replace(same[0], distribution=", ".join(e.distribution for e in same), version="", problem=problem)
    yield from (entry for entry in entries if entry.problem is not None)


def in_words(error: BaseException) -> str:
    """An error as one line of bearable length: its text, and its kind where it is not one of ours."""
    text = "".join(c if c.isprintable() else "?" for c in " ".join(str(error).split())) or "no message"
    text = text if len(text) <= 200 else text[:197] + "..."
    return text if isinstance(error, TreeregError) else f"{type(error).__name__}: {text}"
