"""The pipeline: a flat map of a pair over the stages of an expression, itself a point matcher."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import SerializeAsAny

from treereg_core.errors import NoRegistration
from treereg_core.features import WORTH_THREADS, FeatureSet
from treereg_core.method import (
    Context,
    FeatureFilter,
    Method,
    PointMatcher,
    Registration,
    RowDetector,
    RowMatcher,
)
from treereg_core.pair import MatchedRows, Pair, Rows
from treereg_core.row_trees import along_rows
from treereg_core.rows import NearestRows
from treereg_core.threads import concurrently

NO_MATCHES = np.empty((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class Clock:
    """Adds up the seconds spent by name: `with clock("read"): ...`."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Time a block, also when it raises."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


@dataclass(frozen=True, eq=False)
class State:
    """Where the fold stands: the pair, the last fit to it, and the rows as they were matched, before any filter."""

    pair: Pair
    registration: Registration | None = None
    rows: MatchedRows | None = None


@dataclass(frozen=True, eq=False)
class Candidate:
    """What came out of the last stage: a registration, and the matched rows that it went through, if any."""

    registration: Registration
    rows: MatchedRows | None = None


class Pipeline(PointMatcher):
    """Stages in running order as one point matcher; the source of each is its own docstring.

    Make it with `Pipeline.of`, which adds the default row matcher where an expression has a row detector alone.
    """

    name = "pipeline"
    stages: tuple[SerializeAsAny[Method], ...]

    @classmethod
    def of(cls, stages: Sequence[Method]) -> Pipeline:
        """The pipeline of these stages, with the row matcher of nearest summed distances where rows have none."""
        full = list(stages)
        detector = next((place for place, stage in enumerate(full) if isinstance(stage, RowDetector)), None)
        if detector is not None and not any(isinstance(stage, RowMatcher) for stage in full):
            matcher = next((place for place, s in enumerate(full) if isinstance(s, PointMatcher)), len(full))
            full.insert(matcher, NearestRows())
        return cls(stages=tuple(full))

    def register(self, pair: Pair, context: Context) -> Registration:
        """The first result from where the pair lies now. Raises `NoRegistration` when a stage finds nothing."""
        return Run(self.stages, context).results(pair)[0].registration

    def registrations(self, starts: Sequence[Pair], context: Context, clock: Clock | None = None) -> list[Registration]:
        """The results from all starts, in their order; a start from which a stage finds nothing gives none."""
        return [candidate.registration for candidate in self.candidates(starts, context, clock)[0]]

    def candidates(
        self, starts: Sequence[Pair], context: Context, clock: Clock | None = None
    ) -> tuple[list[Candidate], str]:
        """The same results with the rows that each went through, and why the last start without one had none."""
        run = Run(self.stages, context, clock or Clock())
        found: list[Candidate] = []
        why = ""
        for start in starts:
            try:
                found += run.results(start)
            except NoRegistration as reason:
                why = str(reason)
                context.progress(f"one start gave nothing: {why}")
        return found, why


@dataclass(frozen=True)
class Run:
    """One pass of several starts through the same stages; rows of the same trees are detected once."""

    stages: tuple[Method, ...]
    context: Context
    clock: Clock = field(default_factory=Clock)
    rows: dict[bytes, Rows] = field(default_factory=dict)

    def results(self, pair: Pair) -> list[Candidate]:
        """What comes out of the last stage, at least one. Raises `NoRegistration` when nothing does."""
        states = [State(pair)]
        reason = NoRegistration("the stages gave no result")
        for stage in self.stages:
            after: list[State] = []
            for state in states:
                try:
                    with self.clock(stage.name):
                        after += self.step(stage, state)
                except NoRegistration as dropped:
                    reason = dropped
            states = after
        if not states:
            raise reason
        return [Candidate(s.registration or self.by_rows(s.pair), s.rows) for s in states]

    def step(self, stage: Method, state: State) -> list[State]:
        """What one stage makes of one state."""
        pair = state.pair
        match stage:
            case FeatureFilter():
                return [replace(state, pair=stage.select(pair, self.context))]
            case RowDetector():
                rows = MatchedRows(*self.detect_both(stage, pair), NO_MATCHES)
                return [State(Pair(pair.reference, pair.source, pair.reference_from_source, rows))]
            case RowMatcher():
                return [State(matched, rows=matched.rows) for matched in stage.match(pair, self.context)]
            case PointMatcher():
                registration = stage.register(pair, self.context)
                return [State(pair.at(registration.transform), registration, state.rows)]
        raise TypeError(f"{stage.name} of the role {stage.role} cannot be a stage of a pipeline")

    def detect_both(self, detector: RowDetector, pair: Pair) -> tuple[Rows, Rows]:
        """The rows of reference and source; those of large surveys at the same time, where there are threads for it."""
        large = min(len(pair.reference), len(pair.source)) >= WORTH_THREADS
        threads = self.context.threads if large else 1
        both = (pair.reference, pair.source)
        reference, source = concurrently(lambda features: self.detect(detector, features), both, threads)
        return reference, source

    def detect(self, detector: RowDetector, features: FeatureSet) -> Rows:
        """The rows of one survey, remembered by detector and features."""
        digest = hashlib.blake2b(f"{detector.name} {detector.model_dump_json()}".encode())
        arrays = (features.ids, features.xy, features.confidence, features.area, features.weight)
        for array in (*arrays, *features.attributes.values()):
            digest.update(array.tobytes())
        key = digest.digest()
        if key not in self.rows:
            self.rows[key] = detector.detect(features, self.context)
        return self.rows[key]

    def by_rows(self, pair: Pair) -> Registration:
        """The result of an expression without a point matcher: the fit to the trees along the matched rows."""
        return along_rows(pair, self.context)
