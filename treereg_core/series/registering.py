"""Registering a series: each survey onto the first, in the order of time, learning from each."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from treereg_core import io
from treereg_core.api import execute
from treereg_core.errors import InputError, UsageError
from treereg_core.method import silent
from treereg_core.options import Options
from treereg_core.pipeline import Clock
from treereg_core.plan import Plan, plan_for
from treereg_core.registry import installed
from treereg_core.result import Result
from treereg_core.series.history import History
from treereg_core.series.places import Places
from treereg_core.settings import record
from treereg_core.survey import Frame, Survey
from treereg_core.transform import Affine, Rigid


@dataclass(frozen=True, eq=False)
class Member:
    """One survey of a series and what came of it.

    `survey` is None for one that cannot be used, and `problem` the sentence that says why. `result` is its registration
    onto the first survey; None for that one.
    """

    folder: Path
    survey: Survey | None = None
    result: Result | None = None
    problem: str = ""

    @property
    def name(self) -> str:
        """The name of its folder."""
        return name_of(self.folder)

    @property
    def transform(self) -> Affine | None:
        """Takes its working coordinates to the first survey's; None unless it was accepted."""
        if self.result is None:
            return None if self.survey is None else Rigid.identity()
        return self.result.transform if self.result.accepted else None

    @property
    def word(self) -> str:
        """`reference`, the verdict, or `unusable`."""
        if self.survey is None:
            return "unusable"
        return self.result.judgement.verdict.value if self.result else "reference"


@dataclass(frozen=True, eq=False)
class Series:
    """A series of surveys, registered onto the first, and its trees.

    - `members`: the surveys in the order given.
    - `history`: the trees over those of them that were accepted, the first included; `places`: their rows.
    """

    plan: Plan
    members: tuple[Member, ...]
    history: History
    places: Places

    @property
    def accepted(self) -> tuple[Member, ...]:
        """The first survey, and those that were accepted: the surveys of the history."""
        return tuple(member for member in self.members if member.transform is not None)

    @property
    def frame(self) -> Frame:
        """The working frame of the first survey, which all places are told in."""
        first = self.members[0].survey
        assert first is not None
        return first.frame


def register_series(
    surveys: Sequence[str | Path],
    *,
    memory: str | Path,
    method: str | None = None,
    settings: dict[str, dict[str, object]] | None = None,
    seed: int = 0,
) -> Series:
    """Register survey folders, in the order of time, onto the first: the same as `treereg series`, as an object.

    `memory` is a new or empty folder for what each teaches the next; it is the only thing that is written. `method`
    defaults to the best measured for series. Raises `InputError` when the first survey cannot be used, `UsageError` for
    options that cannot be; another survey that cannot be used is a member that says so.
    """
    folders = [Path(survey) for survey in surveys]
    check_folders(folders)
    given = {"method": method, "settings": settings, "memory": memory, "seed": seed}
    options = record(Options, {name: value for name, value in given.items() if value is not None}, str)
    return carry_out(plan_for(options, installed()), folders)


def name_of(folder: Path) -> str:
    """The name of a survey folder, also of one that is given as `.` or by a path through `..`."""
    return Path(os.path.abspath(folder)).name


def check_folders(folders: Sequence[Path]) -> None:
    """Raise `UsageError` unless these are two folders or more, each given once, of different names that can be told."""
    if len(folders) < 2:
        raise UsageError("a series is of two surveys or more; give their folders in the order of time.")
    for k, folder in enumerate(folders):
        name = name_of(folder)
        if not folder.is_dir():
            raise UsageError(f"{folder} is not a folder; give survey folders in the order of time.")
        if not name or not name.isprintable() or name.startswith("."):
            raise UsageError(f"{folder} has no name that surveys can be told apart by; rename it.")
        for other in folders[:k]:
            if other.resolve() == folder.resolve():
                raise UsageError(f"{other} and {folder} are one folder; give each survey once.")
            if name_of(other) == name:
                raise UsageError(f"{other} and {folder} have the same name, which tells surveys apart; rename one.")


def carry_out(
    plan: Plan,
    folders: Sequence[Path],
    confidence_property: str = "confidence",
    progress: Callable[[str], None] = silent,
    done: Callable[[Member], None] = lambda member: None,
) -> Series:
    """Carry out a plan on every survey; `done` is told of each member as it is finished."""
    members: list[Member] = []

    def said(text: str) -> None:
        progress(f"[{len(members) + 1}/{len(folders)}] {name_of(folders[len(members)])}: {text}")

    surveys = io.read_series(folders, confidence_property=confidence_property)
    for folder in folders:
        said("read")
        members.append(_member(plan, folder, next(surveys), members, said))
        done(members[-1])
    progress("trees")
    history = History.of([(m.survey.features, m.transform) for m in members if m.survey and m.transform])
    return Series(plan, tuple(members), history, Places.of(history, plan, progress))


def _member(
    plan: Plan, folder: Path, read: Survey | InputError, before: Sequence[Member], progress: Callable[[str], None]
) -> Member:
    """What comes of one survey after others."""
    if isinstance(read, InputError):
        return Member(folder, problem=str(read))
    twin = next((member for member in before if member.survey and member.survey.digest == read.digest), None)
    if twin:
        return Member(folder, problem=f"{read.detections} holds the detections of {twin.name} again; give each once.")
    if not before:
        return Member(folder, read)
    assert before[0].survey is not None
    try:
        return Member(folder, read, execute(plan, (before[0].survey, read), Clock(), progress))
    except InputError as error:
        return Member(folder, problem=str(error))
