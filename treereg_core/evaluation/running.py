"""Running trials: spread over processes, each kept as it finishes, those that are there already left out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treereg_core.evaluation.case import Source
from treereg_core.evaluation.log import Log
from treereg_core.evaluation.trial import CRASHED, Trial, died, run_trial
from treereg_core.options import Options
from treereg_core.processes import ProcessDied, Processes, Progress, spread


@dataclass(frozen=True)
class Study:
    """Which trials are wanted: every setup of options on the same cases, so many of each name."""

    source: Source
    setups: tuple[Options, ...]
    seeds: range

    @property
    def cases(self) -> list[tuple[str, int]]:
        """Names and seeds, seed by seed, so that an interrupted study has cases of every name."""
        return [(name, seed) for seed in self.seeds for name in self.source.names]


def run_all(study: Study, out: Path | None, jobs: int, progress: Progress) -> list[Trial]:
    """All trials of a study; with `out`, a CSV file that gets each as it finishes, and whose trials are not repeated.

    `UsageError` when the file holds trials of something else, `InputError` when it cannot be used.
    """
    log = Log(out, study) if out else None
    trials = list(log.trials) if log else []
    # a crash may be mended by now
    trials = [trial for trial in trials if trial.verdict != CRASHED]
    done = {(trial.method, trial.start, trial.name, trial.seed) for trial in trials}
    tasks = []
    for name, seed in study.cases:
        left = [o for o in study.setups if (o.method, o.start, name, seed) not in done]
        if left:
            tasks.append((study.source, name, seed, left))
    for found in spread(run_case, tasks, jobs, progress, outliving):
        trials += found
        kept = [trial for trial in found if trial.verdict != CRASHED]
        if log and kept:
            log.append(kept)
    crashed = [trial for trial in trials if trial.verdict == CRASHED]
    if log and crashed:  # last, for the first one of a log says which figures there are
        log.append(crashed)
    return in_order(trials, study)


def run_case(source: Source, name: str, seed: int, setups: Sequence[Options]) -> list[Trial]:
    """All setups on one case."""
    case = source.case(name, seed)
    return [run_trial(options, case) for options in setups]


def outliving(processes: Processes, call: Callable[..., list[Trial]], task: tuple[Any, ...]) -> list[Trial]:
    """All setups on one case; each by itself once they killed their process, so that the others are not lost."""
    *case, setups = task
    try:
        return processes.call(call, task)
    except ProcessDied as death:
        if len(setups) > 1:
            return [trial for options in setups for trial in outliving(processes, call, (*case, [options]))]
        _, name, seed = case
        print(f"{name} seed {seed}: {death}", file=sys.stderr, flush=True)
        return [died(setups[0], name, seed)]


def in_order(trials: Sequence[Trial], study: Study) -> list[Trial]:
    """Trials in the order of the study, whatever finished first; those that it does not want left out."""
    by_key = {(t.method, t.start, t.name, t.seed): t for t in trials}
    keys = ((o.method, o.start, *case) for o in study.setups for case in study.cases)
    return [by_key[key] for key in keys if key in by_key]
