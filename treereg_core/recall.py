"""Recall: what a memory says to one run, and what an accepted run adds to it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from treereg_core import io
from treereg_core.errors import InputError, in_words
from treereg_core.features import FeatureSet, IntArray
from treereg_core.learning import Learner, Outcome, State
from treereg_core.memory import Couple, Memory, Visit, check_orchard, load, plain_state
from treereg_core.method import Context
from treereg_core.pair import Pair
from treereg_core.plan import Plan
from treereg_core.survey import Survey
from treereg_core.transform import Affine


@dataclass(frozen=True, eq=False)
class Recall:
    """The memory of an orchard, in a folder, as a run of two of its surveys sees it.

    What these two surveys themselves taught last is left out, so that a run that is repeated gives the same result, and
    no survey is a witness to itself.
    """

    folder: Path
    memory: Memory
    reference: Visit
    source: Visit

    @classmethod
    def of(cls, folder: Path, reference: Survey | FeatureSet, source: Survey | FeatureSet) -> Self:
        """The memory in a folder; a new one begins with this reference. `InputError` for one of another orchard."""
        return cls.read(folder, Visit.of(reference), Visit.of(source))

    @classmethod
    def read(cls, folder: Path, reference: Visit, source: Visit) -> Self:
        """The same of two surveys as a memory sees them."""
        memory = load(folder) or Memory.begun(reference)
        check_orchard(folder, memory, reference, source)
        return cls(folder, memory, reference, source)

    @property
    def pair(self) -> Couple:
        """The digests of the two surveys."""
        return self.reference.digest, self.source.digest

    @property
    def home_from_reference(self) -> Affine | None:
        """Takes the reference's working coordinates to the first reference's; None where its place is not known."""
        return self.memory.home_from_working(self.reference)

    def inform(self, context: Context, plan: Plan) -> Context:
        """The context with what the methods of a plan know."""
        memory = {name: self.state(name) for name in plan.learners}
        return replace(context, memory=memory, home_from_reference=self.home_from_reference)

    def state(self, method: str) -> State:
        """What a method knows, as far as possible without what these two surveys taught it."""
        state = self.memory.state(method, self.pair)
        return self.memory.methods[method].state if state is None else state

    def placed(self, reference_from_source: Affine) -> Self:
        """The memory with the places of both surveys, where one of them was known."""
        home = self.home_from_reference
        if home is None:
            source = self.memory.home_from_working(self.source)
            if source is None:
                return self
            home = source @ reference_from_source.inverse()
        memory = self.memory.with_survey(self.reference, home)
        return replace(self, memory=memory.with_survey(self.source, home @ reference_from_source))

    def learn(self, plan: Plan, pair: Pair, matches: IntArray, progress: Callable[[str], None]) -> tuple[str, ...]:
        """Add what an accepted registration teaches, and give a sentence for each thing that went wrong.

        `pair` holds all usable trees at the accepted placement, and the rows that were matched; `matches` (k, 2) ids.
        The memory is read again, so that what another run has added in the meantime stays.
        """
        try:
            with io.memory_lock(self.folder):
                now = self.read(self.folder, self.reference, self.source).placed(pair.reference_from_source)
                lesson = Lesson(plan, now, Outcome(pair, matches, now.home_from_reference))
                memory, exports, warnings = lesson.taught(progress)
                io.write_memory(self.folder, memory.to_json(), exports)
        except InputError as error:
            return (f"nothing was learned: {error}",)
        return warnings


@dataclass(frozen=True, eq=False)
class Lesson:
    """One accepted registration, to be taught to all methods of a plan that learn."""

    plan: Plan
    recall: Recall
    outcome: Outcome

    def taught(self, progress: Callable[[str], None]) -> tuple[Memory, dict[str, str], tuple[str, ...]]:
        """The memory after it, files for other programs by name, and a sentence for each method that failed.

        Of a method that fails the memory keeps what it knew before.
        """
        memory, exports, warnings = self.recall.memory, dict[str, str](), list[str]()
        for name, learner in self.plan.learners.items():
            before = self.recall.memory.state(name, self.recall.pair)
            if len(set(self.recall.pair)) < 2:
                progress(f"learn: a survey laid on itself teaches {name} nothing")
                continue
            if before is None:
                progress(f"learn: {name} has learned from these surveys before")
                continue
            progress(f"learn: {name}")
            try:
                state = plain_state(learner.learn(self.outcome, plain_state(before)))
                exports |= exported(name, learner, state)
            except Exception as error:  # a plugin's fault must not cost the registration
                warnings.append(f"{name} could not learn ({in_words(error)}); its memory stays as it was.")
                continue
            memory = memory.taught(name, self.plan.plugins[name], self.recall.pair, before, state)
        return memory, exports, tuple(warnings)


@contextmanager
def memory_named(folder: Path | None) -> Iterator[None]:
    """Names the memory's file in the error of a method that cannot use what it finds there."""
    try:
        yield
    except InputError as error:
        if folder is None:
            raise
        raise InputError(f"{folder / io.MEMORY}: {error}") from error


def exported(method: str, learner: Learner, state: State) -> dict[str, str]:
    """A method's files for other programs, text by name; each name begins with the method's."""
    files = {}
    for name, text in learner.export(plain_state(state)).items():
        file = name if name.startswith(method) else f"{method}-{name}"
        if not re.fullmatch(r"[\w.-]{1,100}", file) or file == io.MEMORY or not isinstance(text, str):
            raise ValueError(f"{name!r:.100} cannot be the name of a file beside the memory")
        files[file] = text
    return files
