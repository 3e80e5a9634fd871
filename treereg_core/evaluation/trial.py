"""One trial: a case registered by one method from one start, and compared with its truth."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from treereg_core.api import execute
from treereg_core.evaluation.case import NONE, Case
from treereg_core.evaluator import Evaluator
from treereg_core.options import Options
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.registry import installed
from treereg_core.result import Result
from treereg_core.transform import Rigid

CRASHED = "crashed"


@dataclass(frozen=True)
class Trial:
    """One row. Errors in metres, RMS over the source's true trees; NaN where there is none.

    - `setup`: a digest of all other options; `name` and `seed` of the case.
    - `right`: as `Case.right` has it; the errors there count the distortion (`bend`), in the columns they do not.
    - `rotation_deg`, `translation_m`: how far the files' own georeference was off; `misplaced`: by how much the
      source's true trees, RMS.
    - `figures`: what the evaluators say, by `evaluator.figure`; NaN for None.
    """

    method: str
    start: str
    setup: str
    name: str
    seed: int
    trees: int
    rotation_deg: float
    translation_m: float
    misplaced: float
    verdict: str
    matched: int = 0
    right: bool = False
    failure_probability: float = 1.0
    error: float = NONE
    fit_error: float = NONE
    bend: float = NONE
    expected_rms: float = NONE
    ci_low: float = NONE
    ci_high: float = NONE
    rival_log_odds: float = NONE
    start_s: float = NONE
    match_s: float = NONE
    judge_s: float = NONE
    figures: Mapping[str, float] = field(default_factory=dict)

    @property
    def accepted(self) -> bool:
        """Whether the judge accepted the placement."""
        return self.verdict == "accepted"

    @property
    def silent(self) -> bool:
        """Whether it is wrong in silence: accepted though wrong."""
        return self.accepted and not self.right

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval of the expected error holds the true one."""
        return self.ci_low <= self.error <= self.ci_high

    @property
    def seconds(self) -> float:
        """All the work, reading aside."""
        return self.start_s + self.match_s + self.judge_s


def setup(options: Options) -> str:
    """A digest of everything in the options that a trial depends on, method and start apart."""
    rest = options.model_dump_json(exclude={"method", "start", "threads"})
    return hashlib.blake2b(rest.encode(), digest_size=4).hexdigest()


def run_trial(options: Options, case: Case) -> Trial:
    """Register and compare, on one thread. A fault of the code under test makes a trial with the verdict `crashed`."""
    problem, (rotation_deg, translation_m) = case.problem, case.misplaced
    about: dict[str, Any] = {
        "method": options.method,
        "start": options.start,
        "setup": setup(options),
        "name": case.name,
        "seed": case.seed,
        "trees": len(problem.source),
        "rotation_deg": rotation_deg,
        "translation_m": translation_m,
        "misplaced": case.error(Rigid.identity()),
    }
    clock = Clock()
    try:
        result = execute(plan_of(options), (problem.reference, problem.source), clock)
    except Exception as fault:
        print(f"{case.name} seed {case.seed}: {type(fault).__name__}: {fault}", file=sys.stderr, flush=True)
        return Trial(**about, verdict=CRASHED)
    said = result.judgement
    expected = said.expected_error
    return Trial(
        **about,
        verdict=said.verdict.value,
        matched=len(said.matches.pairs),
        right=case.right(said.transform),
        failure_probability=said.failure_probability,
        error=case.error(said.transform),
        fit_error=case.fit_error,
        bend=case.bend,
        expected_rms=expected.rms if expected else NONE,
        ci_low=expected.ci95[0] if expected else NONE,
        ci_high=expected.ci95[1] if expected else NONE,
        rival_log_odds=said.rivals[0].log_odds if said.rivals else NONE,
        start_s=clock.seconds["start"],
        match_s=sum(clock.seconds.values()) - clock.seconds["start"] - clock.seconds["judge"],
        judge_s=clock.seconds["judge"],
        figures=figures(result, case),
    )


def died(options: Options, name: str, seed: int) -> Trial:
    """The trial of a method that took its process along, so that nothing is known of the case."""
    return Trial(
        method=options.method,
        start=options.start,
        setup=setup(options),
        name=name,
        seed=seed,
        trees=0,
        rotation_deg=NONE,
        translation_m=NONE,
        misplaced=NONE,
        verdict=CRASHED,
    )


def plan_of(options: Options) -> Plan:
    """The plan of these options with one thread, made once in a process."""
    return _plan(options.model_dump_json())


@cache
def _plan(options: str) -> Plan:
    return plan_for(Options.model_validate_json(options).model_copy(update={"threads": 1}), installed())


@cache
def evaluators() -> tuple[Evaluator, ...]:
    """All installed evaluators, with their defaults."""
    registry = installed()
    offers = (registry.method(name) for name in registry.names(Evaluator))
    return tuple(offer() for offer in offers if issubclass(offer, Evaluator))


def plugins(setups: Iterable[Options]) -> dict[str, str]:
    """The distribution of every method in these options and of every evaluator, by name."""
    registry = installed()
    found = {name: registry.entry(name).origin for name in registry.names(Evaluator)}
    for options in setups:
        found |= plan_of(options).plugins
    return dict(sorted(found.items()))


def figures(result: Result, case: Case) -> dict[str, float]:
    """What every evaluator says of a result, by `evaluator.figure`; NaN for None."""
    found = {}
    for evaluator in evaluators():
        for name, value in evaluator.score(result.judgement, case.problem).items():
            found[f"{evaluator.name}.{name}"] = NONE if value is None else float(value)
    return found
