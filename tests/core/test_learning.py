"""Learning: what an accepted run tells the methods that learn, what they keep, and what a later run knows of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.core.methods import METHODS, Columns, Middle, Nearest, Sure
from treereg_core.api import execute
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.learning import Learner, Outcome, State
from treereg_core.memory import load
from treereg_core.method import Context, Method, Registration
from treereg_core.options import Options
from treereg_core.pair import Pair
from treereg_core.pipeline import Clock
from treereg_core.plan import plan_for
from treereg_core.registry import Entry, Registry
from treereg_core.result import Result
from treereg_core.rows import NearestRows
from treereg_core.simulate import Scene, Simulation, simulate
from treereg_core.transform import Rigid

CLEAR = Scene(trees=300, jitter=0.1, area_persistence=0.9, shift_sd=0.2, rotation_sd=0.1)
HEARD: list[Outcome] = []
KNEW: list[tuple[dict[str, Any], Any]] = []


class Counting(Nearest, Learner):
    """Nearest trees; it counts its lessons, of which each older one weighs half."""

    name = "counting"
    bonus: int = 0

    def register(self, pair: Pair, context: Context) -> Registration:
        KNEW.append((dict(context.memory), context.home_from_reference))
        if "damage" in context.memory.get(self.name, {}):
            raise InputError("what counting knew is damaged; remove it")
        return super().register(pair, context)

    def learn(self, outcome: Outcome, state: State) -> State:
        HEARD.append(outcome)
        return {
            "weight": state.get("weight", 0) / 2 + 1 + self.bonus,
            "matches": [*state.get("matches", []), len(outcome.matches)],
        }

    def export(self, state: State) -> Mapping[str, str]:
        return {"counting.xml": f"<weight>{state['weight']}</weight>\n", "more.txt": "text\n"}


class Attentive(Middle, Learner):
    """An aligner that learns."""

    name = "attentive"

    def learn(self, outcome: Outcome, state: State) -> State:
        return {"lessons": state.get("lessons", 0) + 1}


class RowsOfAll(NearestRows):
    name = "rows_of_all"


class Faulty(Counting):
    name = "faulty"
    fault: str = "raise"

    def learn(self, outcome: Outcome, state: State) -> State:
        match self.fault:
            case "raise":
                raise RuntimeError("it broke")
            case "nan":
                return {"share": float("nan")}
            case "array":
                return {"counts": np.zeros(3)}
            case "list":
                return ["no mapping"]  # type: ignore[return-value]
            case "huge":
                return {"text": "x" * (65 * 2**20)}
        return {}

    def export(self, state: State) -> Mapping[str, str]:
        return {"../out.xml": "text"} if self.fault == "export" else {}


def registry(version: str = "1.0", distribution: str = "test") -> Registry:
    methods: tuple[type[Method], ...] = (*METHODS, Counting, Attentive, RowsOfAll, Faulty)
    return Registry(tuple(Entry(m.name, m.role, distribution, version, m) for m in methods))


@pytest.fixture(autouse=True)
def _forget() -> None:
    HEARD.clear()
    KNEW.clear()


@pytest.fixture(scope="module")
def orchard() -> Simulation:
    return simulate(CLEAR, 4)


def later(made: Simulation, seed: int) -> FeatureSet:
    """A further survey of the same orchard: the source of a simulation, its trees nudged."""
    nudge = np.random.default_rng(seed).normal(0, 0.05, made.source.xy.shape)
    return made.source.replace(xy=made.source.xy + nudge)


def run(
    reference: FeatureSet, source: FeatureSet, memory: Path | None, said: list[str] | None = None, **options: Any
) -> Result:
    given = {"method": "counting", "start": "identity", "memory": memory, "threads": 1, **options}
    progress = said.append if said is not None else lambda _: None
    return execute(plan_for(Options(**given), registry()), (reference, source), Clock(), progress)


def state(folder: Path, method: str = "counting") -> dict[str, Any]:
    memory = load(folder)
    assert memory is not None
    return memory.methods[method].state


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != ".lock"}


def test_an_accepted_run_teaches_and_the_next_one_knows(orchard: Simulation, tmp_path: Path) -> None:
    memory = tmp_path / "deep" / "memory"
    first = run(orchard.reference, orchard.source, memory)
    assert first.accepted
    assert not first.warnings
    assert "learn" in first.timings
    assert KNEW[0][0] == {"counting": {}}
    assert sorted(files(memory)) == ["counting-more.txt", "counting.xml", "memory.json"]
    (heard,) = HEARD
    assert first.transform is not None
    assert heard.pair.reference_from_source == first.transform
    assert (len(heard.pair.reference), len(heard.pair.source)) == (len(orchard.reference), len(orchard.source))
    np.testing.assert_array_equal(heard.matches, first.judgement.matches.pairs)
    assert heard.home_from_reference == Rigid.identity()
    run(orchard.reference, later(orchard, 1), memory)
    assert KNEW[1][0] == {"counting": {"weight": 1.0, "matches": [len(heard.matches)]}}
    assert state(memory)["weight"] == 1.5
    assert (memory / "counting.xml").read_text() == "<weight>1.5</weight>\n"


def test_without_a_memory_nothing_is_learned_or_written(
    orchard: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(orchard.reference, orchard.source, None).accepted
    assert KNEW == [({}, None)]
    assert not HEARD
    assert not list(tmp_path.iterdir())


def test_a_rerun_gives_the_same_bytes_and_teaches_nothing_twice(orchard: Simulation, tmp_path: Path) -> None:
    said = []
    for _ in range(3):
        said.append({**run(orchard.reference, orchard.source, tmp_path).to_json(), "timings_s": None})
        said.append(files(tmp_path))
    assert said[0] == said[2] == said[4]
    assert said[1] == said[3] == said[5]
    assert all(known == ({"counting": {}}, Rigid.identity()) for known in KNEW)


def test_the_last_pair_with_other_settings_replaces_what_it_taught(orchard: Simulation, tmp_path: Path) -> None:
    second = later(orchard, 1)
    run(orchard.reference, orchard.source, tmp_path)
    run(orchard.reference, second, tmp_path)
    run(orchard.reference, second, tmp_path, settings={"counting": {"bonus": 10}})
    assert state(tmp_path)["weight"] == 0.5 + 11
    assert len(state(tmp_path)["matches"]) == 2
    memory = load(tmp_path)
    assert memory is not None
    assert len(memory.methods["counting"].pairs) == 2


def test_an_earlier_pair_stays_as_it_was_taught(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    run(orchard.reference, later(orchard, 1), tmp_path)
    before, said = files(tmp_path), list[str]()
    assert run(orchard.reference, orchard.source, tmp_path, said, settings={"counting": {"bonus": 10}}).accepted
    assert "learn: counting has learned from these surveys before" in said
    assert state(tmp_path)["weight"] == 1.5
    assert files(tmp_path)["memory.json"] == before["memory.json"]


def test_the_same_surveys_the_other_way_round_are_no_further_evidence(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    run(orchard.source, orchard.reference, tmp_path)
    assert state(tmp_path)["weight"] == 1.0


def test_a_survey_on_itself_teaches_nothing(orchard: Simulation, tmp_path: Path) -> None:
    said: list[str] = []
    assert run(orchard.reference, orchard.reference, tmp_path, said).accepted
    assert not HEARD
    memory = load(tmp_path)
    assert memory is not None
    assert (list(memory.surveys), memory.methods) == ([memory.home], {})


def test_what_is_not_accepted_changes_nothing(orchard: Simulation, tmp_path: Path) -> None:
    strange = simulate(CLEAR.model_copy(update={"same_orchard": False}), 9).source
    assert not run(orchard.reference, strange, tmp_path / "new").accepted
    assert not (tmp_path / "new").exists()
    run(orchard.reference, orchard.source, tmp_path)
    before = files(tmp_path)
    HEARD.clear()
    assert not run(orchard.reference, strange, tmp_path).accepted
    assert not run(orchard.reference, later(orchard, 1), tmp_path, max_failure=0.0).accepted
    assert files(tmp_path) == before
    assert not HEARD


def test_places_are_known_in_the_first_references_frame(orchard: Simulation, tmp_path: Path) -> None:
    first = run(orchard.reference, orchard.source, tmp_path)
    run(orchard.source, later(orchard, 1), tmp_path)
    home = KNEW[1][1]
    assert first.transform is not None
    np.testing.assert_allclose(home.matrix, first.transform.matrix, atol=1e-12)
    assert HEARD[1].home_from_reference == home
    memory = load(tmp_path)
    assert memory is not None
    assert len(memory.surveys) == 3


def test_a_new_reference_onto_which_a_known_survey_is_laid_becomes_known(orchard: Simulation, tmp_path: Path) -> None:
    first, new = run(orchard.reference, orchard.source, tmp_path), later(orchard, 1)
    second = run(new, orchard.source, tmp_path)
    assert KNEW[1][1] is None
    assert first.transform is not None
    assert second.transform is not None
    expected = first.transform @ second.transform.inverse()
    assert HEARD[1].home_from_reference is not None
    np.testing.assert_allclose(HEARD[1].home_from_reference(new.xy), expected(new.xy), atol=1e-9)
    run(new, later(orchard, 2), tmp_path)
    np.testing.assert_allclose(KNEW[2][1](new.xy), expected(new.xy), atol=1e-9)


def test_two_unknown_surveys_of_the_orchard_teach_but_have_no_place(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    assert run(later(orchard, 1), later(orchard, 2), tmp_path).accepted
    assert (KNEW[1][1], HEARD[1].home_from_reference) == (None, None)
    assert state(tmp_path)["weight"] == 1.5
    memory = load(tmp_path)
    assert memory is not None
    assert len(memory.surveys) == 2


def test_matched_rows_are_learned_from_whole(orchard: Simulation, tmp_path: Path) -> None:
    width = {"columns": {"width": 1.0}, "sure": {"least": 0.6}}
    said = run(orchard.reference, orchard.source, tmp_path, method="columns+rows_of_all+sure+counting", settings=width)
    assert said.accepted
    rows = HEARD[0].pair.rows
    assert rows is not None
    assert len(rows.matches)
    whole = Columns(width=1.0).detect(orchard.reference, Context())
    assert [row.tolist() for row in rows.reference.trees] == [row.tolist() for row in whole.trees]
    thinned = Sure(least=0.6).select(HEARD[0].pair, Context())
    assert thinned.rows is not None
    assert sum(map(len, thinned.rows.reference.trees)) < sum(map(len, whole.trees))
    run(orchard.reference, orchard.source, tmp_path / "plain")
    assert HEARD[1].pair.rows is None


def test_the_aligner_learns_too(orchard: Simulation, tmp_path: Path) -> None:
    assert run(orchard.reference, orchard.source, tmp_path, start="attentive").accepted
    assert state(tmp_path, "attentive") == {"lessons": 1}
    assert state(tmp_path)["weight"] == 1.0


def test_methods_that_took_no_part_keep_what_they_know(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path, start="attentive")
    run(orchard.reference, later(orchard, 1), tmp_path)
    assert (state(tmp_path, "attentive"), state(tmp_path)["weight"]) == ({"lessons": 1}, 1.5)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("raise", "RuntimeError: it broke"),
        ("nan", "ValueError"),
        ("array", "TypeError"),
        ("list", "not a mapping"),
        ("export", "cannot be the name of a file"),
    ],
)
def test_a_method_that_cannot_learn_costs_neither_registration_nor_memory(
    fault: str, words: str, orchard: Simulation, tmp_path: Path
) -> None:
    settings = {"faulty": {"fault": fault}}
    result = run(orchard.reference, orchard.source, tmp_path, method="counting+faulty", settings=settings)
    assert result.accepted
    (warning,) = result.warnings
    assert warning.startswith("faulty could not learn (")
    assert words in warning
    memory = load(tmp_path)
    assert memory is not None
    assert set(memory.methods) == {"counting"}
    assert not (tmp_path.parent / "out.xml").exists()


def test_a_memory_that_would_grow_too_large_is_left_as_it_was(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    before = files(tmp_path)
    settings = {"faulty": {"fault": "huge"}}
    result = run(orchard.reference, later(orchard, 1), tmp_path, method="faulty", settings=settings)
    assert result.accepted
    assert "larger than 64 MB" in result.warnings[0]
    assert files(tmp_path) == before


def test_what_another_run_learned_in_the_meantime_stays(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    second, third = later(orchard, 1), later(orchard, 2)
    meanwhile: list[str] = []

    def progress(message: str) -> None:
        if message == "judge" and not meanwhile:
            meanwhile.append(message)
            run(orchard.reference, third, tmp_path)

    options = Options(method="counting", start="identity", memory=tmp_path, threads=1)
    assert execute(plan_for(options, registry()), (orchard.reference, second), Clock(), progress).accepted
    assert state(tmp_path)["weight"] == 1.75
    memory = load(tmp_path)
    assert memory is not None
    assert len(memory.surveys) == 4


def test_a_memory_damaged_in_the_meantime_costs_no_registration(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    options = Options(method="counting", start="identity", memory=tmp_path, threads=1)
    plan = plan_for(options, registry())

    def progress(message: str) -> None:
        if message == "judge":
            (tmp_path / "memory.json").write_text("{")

    result = execute(plan, (orchard.reference, later(orchard, 1)), Clock(), progress)
    assert result.accepted
    assert result.warnings[0].startswith("nothing was learned: ")
    assert (tmp_path / "memory.json").read_text() == "{"


def test_a_method_that_cannot_use_what_it_knows_says_where_it_stands(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    path = tmp_path / "memory.json"
    path.write_text(path.read_text().replace('"weight"', '"damage"'))
    with pytest.raises(InputError, match=r"memory\.json: what counting knew is damaged; remove it"):
        run(orchard.reference, later(orchard, 1), tmp_path)


def test_what_another_or_a_later_method_learned_is_refused(orchard: Simulation, tmp_path: Path) -> None:
    run(orchard.reference, orchard.source, tmp_path)
    options = Options(method="counting", start="identity", memory=tmp_path)
    for later_one in ("1.0.1", "1.1", "2"):
        plan_for(options, registry(later_one))
    with pytest.raises(InputError, match=r"counting learned this with test 1\.0; update test 0\.9"):
        plan_for(options, registry("0.9"))
    with pytest.raises(InputError, match=r"counting was that of test 1\.0, not of other 1\.0"):
        plan_for(options, registry(distribution="other"))
    plan_for(options.model_copy(update={"method": "nearest"}), registry("0.9"))


def test_a_method_cannot_change_what_the_memory_holds(orchard: Simulation, tmp_path: Path) -> None:
    class Vandal(Counting):
        name = "counting"

        def learn(self, outcome: Outcome, state: State) -> State:
            new = super().learn(outcome, state)
            state.clear()  # type: ignore[attr-defined]
            return new

    vandals = Registry(tuple(replace(e, offer=Vandal) if e.name == "counting" else e for e in registry().entries))
    options = Options(method="counting", start="identity", memory=tmp_path, threads=1)
    for source in (orchard.source, later(orchard, 1)):
        execute(plan_for(options, vandals), (orchard.reference, source), Clock())
    memory = load(tmp_path)
    assert memory is not None
    assert memory.methods["counting"].before["weight"] == 1.0
    json.dumps(memory.to_json(), allow_nan=False)
