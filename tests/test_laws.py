"""The laws themselves: each catches a method that breaks it, and `check` reports what they find."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

import pytest

from tests import test_contracts
from tests.broken import CREDULOUS_JUDGE, HONEST_JUDGE, Anonymous, Lazy
from treereg_core.judgement import Judgement
from treereg_core.method import Context, Method, Registration
from treereg_core.pair import Pair
from treereg_core.testing import check, laws, laws_for
from treereg_core.testing.laws import wholes
from treereg_core.testing.using import judgement_of
from treereg_core.transform import Rigid


class Credulous:
    """A judge who accepts the first candidate, or where the files say when there is none."""

    def judge(self, pair: Pair, candidates: Sequence[Registration], context: Context, max_failure: float) -> Judgement:
        return judgement_of(candidates[0].transform if candidates else Rigid.identity())


@pytest.mark.parametrize(
    ("module", "law", "method", "happened"),
    [pytest.param(*case, id=f"{case[1]}[{type(case[2]).__name__}]") for case in HONEST_JUDGE],
)
def test_a_law_catches_a_method_that_breaks_it(module: str, law: str, method: Method, happened: str) -> None:
    with pytest.raises(AssertionError, match=f"^{law}: ") as broken:
        getattr(getattr(laws, module), law)(method)
    assert happened in str(broken.value)


@pytest.mark.parametrize(
    ("module", "law", "method", "happened"),
    [pytest.param(*case, id=f"{case[1]}[{type(case[2]).__name__}]") for case in CREDULOUS_JUDGE],
)
def test_a_law_catches_a_judge_who_accepts_everything(
    module: str, law: str, method: Method, happened: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wholes, "Judge", Credulous)
    test_a_law_catches_a_method_that_breaks_it(module, law, method, happened)


def test_every_law_has_a_method_that_breaks_it() -> None:
    every = {(law.__module__.rpartition(".")[2], law.__name__) for role in laws.BY_ROLE.values() for law in role}
    assert {case[:2] for case in (*HONEST_JUDGE, *CREDULOUS_JUDGE)} == every


def test_every_law_that_was_written_applies_to_a_role() -> None:
    modules = (laws.settings, laws.conduct, laws.filters, laws.aligners, laws.rows, laws.matchers, laws.wholes)
    written = {
        (module.__name__, name)
        for module in (*modules, laws.evaluators, laws.learners)
        for name, value in vars(module).items()
        if hasattr(value, "__wrapped__") and value.__module__ == module.__name__ and not hasattr(value, "cache_info")
    }
    applied = {(law.__module__, law.__name__) for role in laws.BY_ROLE.values() for law in role}
    assert written == applied


def test_check_reports_every_law_and_goes_on_after_a_broken_one() -> None:
    results = list(check(Lazy()))
    assert [result.name.replace(" ", "_") for result in results] == [law.__name__ for law in laws_for(Lazy())]
    broken = {result.name: result.message for result in results if not result.passed}
    assert broken["it finds a copy anywhere"].startswith("turned by 13 degrees: ")
    assert "too few trees are no crash and no number" in broken
    assert any(result.passed for result in results)
    source = next(result for result in check(Anonymous()) if "source" in result.name)
    assert (source.passed, source.message) == (False, "it has no docstring of its own")


def test_a_law_that_cannot_be_tried_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object) -> None:
        raise wholes.TreeregError("nothing is installed")

    monkeypatch.setattr(wholes, "aligner_named", missing)
    wholes.default_aligner.cache_clear()
    (matcher,) = {type(m): m for m in test_contracts.SUBJECTS.values() if m.name == "mutual"}.values()
    skipped = {result.name for result in check(matcher) if result.skipped}
    assert "an ordinary orchard is accepted and right" in skipped
    wholes.default_aligner.cache_clear()


def test_the_laws_need_neither_pytest_nor_hypothesis() -> None:
    code = "import sys, treereg_core.testing; print({'pytest', 'hypothesis'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"
