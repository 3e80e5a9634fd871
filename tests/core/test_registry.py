"""The registry with plugins of every kind, good and broken, as installed distributions on the import path."""

from __future__ import annotations

import pickle
import sys
from importlib import metadata
from pathlib import Path

import pytest

from treereg_core import registry
from treereg_core.errors import InputError, PluginError, UsageError
from treereg_core.method import PointMatcher
from treereg_core.registry import Registry

GOOD = '''
from treereg_core import hookimpl
from treereg_core.method import PointMatcher

class Near(PointMatcher):
    """Finds near trees."""
    name = "{name}"
    def register(self, pair, context):
        raise NotImplementedError

@hookimpl
def treereg_methods():
    return [Near]
'''


FUTURE = "from __future__ import annotations\nfrom typing import Optional\n"


class Site:
    """A folder of made-up distributions."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, distribution: str, code: str, entry_point: str = "x") -> None:
        module = "plugin_" + distribution.replace("-", "_")
        (self.folder / f"{module}.py").write_text(code)
        info = self.folder / f"{distribution.replace('-', '_')}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n")
        (info / "entry_points.txt").write_text(f"[treereg]\n{entry_point} = {module}\n")

    def registry(self) -> Registry:
        found = metadata.distributions(path=[str(self.folder)])
        return registry.load([point for d in found for point in d.entry_points])


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = set(sys.modules)
    yield Site(tmp_path)
    for name in set(sys.modules) - before:
        if name.startswith("plugin_"):
            del sys.modules[name]


def test_a_good_plugin_is_listed_with_its_distribution(site: Site) -> None:
    site.add("treereg-near", GOOD.format(name="near"))
    (entry,) = site.registry().entries
    assert (entry.name, entry.role, entry.distribution, entry.version) == (
        "near",
        "point matcher",
        "treereg-near",
        "1.2",
    )
    assert entry.description == "Finds near trees."
    assert issubclass(site.registry().method("near"), PointMatcher)


def test_two_distributions_may_share_an_entry_point_name(site: Site) -> None:
    site.add("one", GOOD.format(name="first"))
    site.add("two", GOOD.format(name="second"))
    assert site.registry().names(PointMatcher) == ["first", "second"]


def test_a_duplicate_method_name_is_refused_naming_both_distributions(site: Site) -> None:
    site.add("one", GOOD.format(name="near"))
    site.add("two", GOOD.format(name="near"), entry_point="y")
    site.add("three", GOOD.format(name="other"), entry_point="z")
    found = site.registry()
    assert found.names(PointMatcher) == ["other"]
    with pytest.raises(PluginError, match=r"offered by .*(one 1\.2 and two 1\.2|two 1\.2 and one 1\.2); keep one"):
        found.entry("near")


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("raise RuntimeError('first line\\nsecond')", "RuntimeError: first line"),
        ("import sys; sys.exit('gone')", "SystemExit: gone"),
        ("def (", "SyntaxError"),
        ("x = 1", "none of the hooks"),
        ("def treereg_methods(): return []", "not marked with @hookimpl"),
        (GOOD.replace("treereg_methods", "treereg_metods"), "did you mean 'treereg_methods'"),
        (GOOD.replace("def treereg_methods()", "def treereg_methods(extra)"), "extra"),
        (GOOD.replace("return [Near]", "raise KeyError('lost')"), "KeyError: 'lost'"),
        (GOOD.replace("return [Near]", "return 3"), "TypeError"),
        (GOOD.replace("return [Near]", "return [Near()]"), "it is not one of"),
        (GOOD.replace("return [Near]", "return [int]"), "its name is None"),
        (GOOD.replace("{name}", "Not A Name"), "lower-case letters"),
        (GOOD.replace("{name}", "judge"), "reserved"),
        (GOOD.replace("    def register", "    def other"), "does not define register"),
        (GOOD.replace("    def register", "    reach: float\n    def register"), "its own defaults"),
        (GOOD.replace("    def register", "    model_config = {'frozen': False}\n    def register"), "not frozen"),
        (GOOD.replace("    def register", "    network = {'nodes': ()}\n    def register"), "its network is not"),
        (GOOD.replace("treereg_methods", "treereg_evaluators"), "it is not one of Evaluator"),
    ],
)
def test_a_broken_plugin_is_an_entry_that_says_why_and_kills_no_other(site: Site, code: str, reason: str) -> None:
    site.add("bad", code.replace("{name}", "broken"))
    site.add("good", GOOD.format(name="near"))
    found = site.registry()
    assert found.names(PointMatcher) == ["near"]
    (broken,) = [entry for entry in found.entries if entry.problem]
    assert broken.distribution == "bad"
    assert broken.problem is not None
    assert reason in broken.problem
    assert "bad 1.2" in broken.problem
    with pytest.raises(PluginError, match="cannot be used"):
        found.entry(broken.name)


def test_a_broken_plugin_does_not_hide_a_good_method_of_its_entry_points_name(site: Site) -> None:
    site.add("bad", "import nowhere_to_be_found", entry_point="near")
    site.add("good", GOOD.format(name="near"))
    assert site.registry().entry("near").distribution == "good"


def test_an_unknown_name_gets_the_nearest(site: Site) -> None:
    site.add("good", GOOD.format(name="nearest"))
    with pytest.raises(UsageError, match="did you mean 'nearest'"):
        site.registry().entry("neerest")
    with pytest.raises(UsageError, match="installed are: nearest"):
        site.registry().entry("zzz")


def test_a_published_plugin_that_is_not_installed_comes_with_the_line_that_installs_it(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "published", lambda: frozenset({"treereg-far-away"}))
    with pytest.raises(UsageError, match="pip install treereg-far-away"):
        site.registry().entry("far_away")


def test_the_extras_of_the_distribution_name_its_plugins() -> None:
    assert {"treereg-icp", "treereg-coarse"} <= registry.published()


def test_a_plugin_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(
        FUTURE + GOOD.format(name="mine").replace("    def", "    reach: Optional[float] = 1.0\n    def", 1)
    )
    (entry,) = registry.from_file(path)
    assert (entry.name, entry.problem) == ("mine", None)
    assert isinstance(entry.offer, type)
    assert pickle.loads(pickle.dumps(entry.offer(reach=2.0))) == entry.offer(reach=2.0)
    path.write_text("import nowhere_to_be_found")
    with pytest.raises(PluginError, match=r"mine\.py cannot be loaded: ModuleNotFoundError"):
        registry.from_file(path)
    with pytest.raises(InputError, match="no such Python file"):
        registry.from_file(tmp_path / "absent.py")


def test_the_core_offers_its_evaluator_through_the_same_door() -> None:
    entry = registry.installed().entry("truth")
    assert (entry.role, entry.distribution) == ("evaluator", "treereg")


def test_the_problem_of_a_plugin_is_one_line_that_a_terminal_can_show(site: Site) -> None:
    site.add("one", "raise RuntimeError('lost\\nin \\x1b[31m red')")
    site.add("two", GOOD.format(name="near").replace("treereg_methods", "treereg_method"))
    problems = sorted(entry.problem or "" for entry in site.registry().entries)
    assert problems == [
        "one 1.2 cannot be loaded: RuntimeError: lost in ?[31m red",
        "two 1.2 cannot be loaded: there is no hook 'treereg_method'; did you mean 'treereg_methods'?",
    ]
