"""Memory: what the surveys of one orchard taught the methods that learn, and where each survey lies."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError, field_validator

from treereg_core import io
from treereg_core.errors import InputError
from treereg_core.features import FeatureSet
from treereg_core.learning import State
from treereg_core.survey import Frame, Survey
from treereg_core.transform import Affine, FloatArray, Rigid, Similarity

SCHEMA = "treereg/memory/"
VERSION = 1
LEAST_OVERLAP = 0.1
"""Of the smaller of two surveys' ground; those of one orchard share more, neighbouring orchards less."""
EDGE_M = 5.0
"""How far an orchard's ground reaches beyond the stems of its outermost trees."""

Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
Couple = tuple[Digest, Digest]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
Row = tuple[Number, Number, Number]


@dataclass(frozen=True, eq=False)
class Visit:
    """One survey as a memory sees it: by what it is known, and where it lies; `frame` is None for plain trees."""

    digest: str
    name: str
    xy: FloatArray
    frame: Frame | None

    @classmethod
    def of(cls, survey: Survey | FeatureSet) -> Self:
        """Of a survey that was read from files, or of plain trees."""
        if isinstance(survey, Survey):
            return cls(survey.digest, survey.path.absolute().name, survey.features.xy, survey.frame)
        arrays = (survey.xy, survey.confidence, survey.area)
        digest = hashlib.blake2b(b"".join(array.tobytes() for array in arrays), digest_size=16)
        return cls(digest.hexdigest(), "trees", survey.xy, None)

    @property
    def crs(self) -> str | None:
        """The CRS of the working frame."""
        return self.frame.crs if self.frame else None

    def full_from_working(self, crs: str | None) -> Affine:
        """Takes working coordinates to full ones in `crs`."""
        return io.full_from_frame(self.frame, crs) if self.frame and crs else Rigid.identity()

    def full_xy(self, crs: str | None) -> FloatArray:
        """The trees in full coordinates of `crs`, (n, 2) metres; infinite where that does not reach."""
        return io.full_coordinates(self.xy, self.frame, crs) if self.frame and crs else self.xy


class Record(BaseModel):
    """A part of the document."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Known(Record):
    """A survey whose place is known: `home_from_survey` (3x3) takes its full coordinates to the first reference's."""

    name: str
    home_from_survey: tuple[Row, Row, Row]

    @field_validator("home_from_survey")
    @classmethod
    def _usable(cls, matrix: tuple[Row, Row, Row]) -> tuple[Row, Row, Row]:
        Affine.from_matrix(matrix)
        return matrix

    @property
    def transform(self) -> Affine:
        """`home_from_survey`, of the narrowest kind that it is."""
        for kind in (Rigid, Similarity):
            try:
                return kind.from_matrix(self.home_from_survey)
            except ValueError:
                continue
        return Affine.from_matrix(self.home_from_survey)


class Knowledge(Record):
    """What one method knows.

    `by` is its distribution with the version that wrote this, `pairs` the digests of the registrations that taught it,
    in order; `before` is the state before the last of them, so that the last can be taught anew.
    """

    by: str
    pairs: tuple[Couple, ...]
    before: dict[str, Any]
    state: dict[str, Any]


class Memory(Record):
    """What an orchard's surveys taught.

    `home` is its first reference, in whose full coordinates in `crs` all places are told; `outline` (k, 2) is the
    ground that its trees cover, a convex polygon. `crs` is None for plain trees.
    """

    crs: str | None
    home: Digest
    outline: tuple[tuple[Number, Number], ...] = Field(min_length=1)
    surveys: dict[Digest, Known]
    methods: dict[str, Knowledge]

    @classmethod
    def begun(cls, reference: Visit) -> Self:
        """The memory of an orchard of which this is the first reference; it knows nothing else yet."""
        memory = cls(crs=reference.crs, home=reference.digest, outline=hull(reference), surveys={}, methods={})
        return memory.with_survey(reference, reference.full_from_working(reference.crs))

    def to_json(self) -> dict[str, Any]:
        """The document, as memory.json holds it."""
        return {"schema": f"{SCHEMA}{VERSION}", **self.model_dump(mode="json")}

    def home_from_working(self, visit: Visit) -> Affine | None:
        """Takes the working coordinates of a survey to the first reference's; None for one whose place is not known."""
        known = self.surveys.get(visit.digest)
        return known.transform @ visit.full_from_working(self.crs) if known else None

    def with_survey(self, visit: Visit, home_from_working: Affine) -> Self:
        """The memory with one more survey whose place is known, or with the newest word on one it knows."""
        home_from_survey = home_from_working @ visit.full_from_working(self.crs).inverse()
        if visit.digest == self.home:
            home_from_survey = Rigid.identity()
        known = Known(name=visit.name, home_from_survey=(home_from_survey.matrix + 0.0).tolist())
        return self.model_copy(update={"surveys": {**self.surveys, visit.digest: known}})

    def state(self, method: str, pair: Couple) -> State | None:
        """What a method knows without what this pair of surveys taught it; None when it cannot be told apart.

        What the last registration taught can be told apart from the rest, what an earlier one taught cannot.
        """
        known = self.methods.get(method)
        if known is None:
            return {}
        if known.pairs and same(known.pairs[-1], pair):
            return known.before
        return None if any(same(earlier, pair) for earlier in known.pairs) else known.state

    def taught(self, method: str, by: str, pair: Couple, before: State, state: State) -> Self:
        """The memory with what one more registration taught a method."""
        earlier = self.methods[method].pairs if method in self.methods else ()
        pairs = (*(other for other in earlier if not same(other, pair)), pair)
        knowledge = Knowledge(by=by, pairs=pairs, before=dict(before), state=dict(state))
        return self.model_copy(update={"methods": {**self.methods, method: knowledge}})


def load(folder: Path) -> Memory | None:
    """The memory in a folder, None where there is none yet. `InputError` for one that cannot be used."""
    document = io.read_memory(folder)
    if document is None:
        return None
    path = folder / io.MEMORY
    number = re.fullmatch(re.escape(SCHEMA) + r"([1-9][0-9]{0,8})", str(document.pop("schema", "")))
    if number is None:
        io.damaged(path, f"it does not begin with the schema {SCHEMA}{VERSION}")
    if int(number[1]) > VERSION:
        raise InputError(f"{path} was written by a later version of treereg; update treereg, or begin a new folder.")
    try:
        memory = Memory(**document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        io.damaged(path, f"{'.'.join(map(str, first['loc']))[:80]}: {first['msg']}")
    if memory.crs is not None:
        io.parse_crs(memory.crs, path)
    return memory


def check_methods(folder: Path, memory: Memory, plugins: Mapping[str, str]) -> None:
    """Refuse what another method of the same name, or a later version of it, has learned."""
    for method, now in plugins.items():
        by = memory.methods[method].by if method in memory.methods else now
        if by.rpartition(" ")[0] != now.rpartition(" ")[0]:
            raise InputError(f"{folder}: {method} was that of {by}, not of {now}; begin a new folder.")
        if release(by) > release(now):
            raise InputError(f"{folder}: {method} learned this with {by}; update {now}, or begin a new folder.")


def release(by: str) -> tuple[int, ...]:
    """The numbers of the version in a distribution's name and version."""
    return tuple(int(number) for number in re.findall(r"\d{1,9}", by.rpartition(" ")[2])[:3])


def check_orchard(folder: Path, memory: Memory, reference: Visit, source: Visit) -> None:
    """Refuse the memory of another orchard than that of the reference. Surveys that it knows need no look."""
    if (memory.crs is None) != (reference.frame is None):
        kinds = ("plain trees", "surveys with a CRS")
        of, given = kinds if memory.crs is None else kinds[::-1]
        raise InputError(f"{folder} is a memory of {of}, not of {given}; begin a new folder.")
    if {reference.digest, source.digest} & memory.surveys.keys():
        return
    import shapely

    here = reference.full_xy(memory.crs)
    if not np.isfinite(here).all():
        _refuse(folder, f"it is in {memory.crs:.40}, which does not reach {reference.name}")
    ground, home = (
        shapely.buffer(shapely.convex_hull(shapely.multipoints(xy)), EDGE_M) for xy in (here, list(memory.outline))
    )
    apart = float(shapely.distance(ground, home))
    if apart > 0:
        _refuse(folder, f"{reference.name} lies {apart:,.0f} m from it")
    overlap = float(shapely.area(shapely.intersection(ground, home)) / min(shapely.area(ground), shapely.area(home)))
    if overlap < LEAST_OVERLAP:
        _refuse(folder, f"{reference.name} shares only {overlap:.0%} of its ground")


def _refuse(folder: Path, why: str) -> NoReturn:
    raise InputError(f"{folder} is the memory of another orchard ({why}); give this orchard's memory, or a new folder.")


def same(pair: Couple, other: Couple) -> bool:
    """Whether two pairs of digests are of the same two surveys, whichever is the reference."""
    return set(pair) == set(other)


def hull(visit: Visit) -> tuple[tuple[float, float], ...]:
    """The corners of the convex polygon around a survey's trees, full coordinates, to the millimetre."""
    import shapely

    corners = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(visit.full_xy(visit.crs))))
    return tuple((x, y) for x, y in np.round(corners, 3).tolist())


def plain_state(state: object) -> dict[str, Any]:
    """A state as it will come back from the file. `ValueError` or `TypeError` for one that JSON cannot hold."""
    if not isinstance(state, Mapping):
        raise TypeError("its state is not a mapping")
    document = json.loads(json.dumps(dict(state), allow_nan=False))
    io.check_value([[[document]]])
    return dict(document)
