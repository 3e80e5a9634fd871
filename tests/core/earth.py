"""Simulated surveys as folders anywhere on earth, in any CRS, and the real command on them."""

from __future__ import annotations

import io as streams
import json
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyproj

from treereg_core.cli import main
from treereg_core.features import FeatureSet
from treereg_core.simulate import Simulation
from treereg_core.simulate.canopy import canopies
from treereg_core.transform import Affine, FloatArray, Rigid

WGS84 = "OGC:CRS84"


@dataclass(frozen=True)
class Place:
    """Where the middle of the orchard lies, degrees, and how far its frame is turned against north there."""

    longitude: float
    latitude: float
    turn_deg: float = 0.0

    def lonlat(self, xy: FloatArray) -> FloatArray:
        """Points (..., 2) of the orchard's frame, metres, to WGS 84."""
        return through(WGS84, self._local, Rigid.turn(self.turn_deg)(xy.reshape(-1, 2))).reshape(xy.shape)

    def at(self, lonlat: FloatArray) -> FloatArray:
        """And back."""
        return Rigid.turn(-self.turn_deg)(through(self._local, WGS84, lonlat))

    @property
    def _local(self) -> str:
        return f"+proj=aeqd +lat_0={self.latitude!r} +lon_0={self.longitude!r} +datum=WGS84 +units=m"


@lru_cache(maxsize=256)
def transformer(target: str, source: str) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(source, target, always_xy=True)


def through(target: str, source: str, xy: FloatArray) -> FloatArray:
    return np.column_stack(transformer(target, source).transform(*xy.T))


CERES = Place(19.31, -33.37)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A survey to be written: its trees' outlines (n, k, 2) in the orchard's frame, metres, and confidences (n,)."""

    rings: FloatArray
    confidence: FloatArray

    @classmethod
    def of(cls, features: FeatureSet, seed: int) -> Drawn:
        return cls(canopies(features, np.random.default_rng(seed)), features.confidence)

    def write(self, folder: Path, place: Place = CERES, crs: str = WGS84) -> Path:
        """The survey's folder; with WGS 84 as RFC 7946 says, else with a `crs` member."""
        rings = place.lonlat(self.rings)
        rings = rings if crs == WGS84 else through(crs, WGS84, rings.reshape(-1, 2)).reshape(rings.shape)
        assert np.isfinite(rings).all()
        features = [
            {
                "type": "Feature",
                "properties": {"confidence": confidence},
                "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
            }
            for ring, confidence in zip(rings.tolist(), self.confidence.tolist(), strict=True)
        ]
        members = {} if crs == WGS84 else {"crs": {"type": "name", "properties": {"name": crs}}}
        folder.mkdir()
        text = json.dumps({"type": "FeatureCollection", **members, "features": features})
        (folder / "raw-detections.geojson").write_text(text)
        return folder


@dataclass(frozen=True)
class Ran:
    """What came of a run: exit code, registration.json, what stderr said, the moved features where it was accepted."""

    code: int
    registration: dict[str, Any]
    told: str
    registered: dict[str, Any] | None

    @property
    def verdict(self) -> str:
        return str(self.registration["verdict"])

    @property
    def accepted(self) -> bool:
        return self.verdict == "accepted"

    @property
    def matrix(self) -> FloatArray:
        """`reference_from_source` in full coordinates of the working CRS."""
        return np.array(self.registration["transform"]["matrix"])

    def moved(self, xy: FloatArray, place: Place = CERES) -> FloatArray:
        """Points (n, 2) of the source in the orchard's frame, to where the run puts them in it."""
        crs = self.registration["crs"]
        full = through(crs, WGS84, place.lonlat(xy))
        return place.at(through(WGS84, crs, Affine(self.matrix[:2, :2], tuple(self.matrix[:2, 2]))(full)))


def run(reference: Path, source: Path, *more: str) -> Ran:
    """`treereg run` on two folders."""
    out = reference.parent / "out"
    told = streams.StringIO()
    with redirect_stderr(told), redirect_stdout(streams.StringIO()):
        code = main(["run", str(reference), str(source), "--no-report", "--overwrite", "--out", str(out), *more])
    assert "Traceback" not in told.getvalue()
    if code == 2:
        assert told.getvalue().splitlines()[-1].startswith("treereg: ")
        return Ran(code, {}, told.getvalue(), None)
    found = json.loads((out / "registration.json").read_text())
    assert code == (0 if found["verdict"] == "accepted" else 3)
    moved = out / "detections_registered.geojson"
    return Ran(code, found, told.getvalue(), json.loads(moved.read_text()) if moved.exists() else None)


@contextmanager
def written(
    surveys: tuple[Drawn, Drawn], place: Place = CERES, crs: tuple[str, str] = (WGS84, WGS84)
) -> Iterator[tuple[Path, Path]]:
    """The folders of reference and source."""
    with TemporaryDirectory() as folder:
        names = ("reference", "source")
        yield tuple(  # type: ignore[misc]
            survey.write(Path(folder) / name, place, system)
            for survey, name, system in zip(surveys, names, crs, strict=True)
        )


def ran(surveys: tuple[Drawn, Drawn], place: Place = CERES, crs: tuple[str, str] = (WGS84, WGS84)) -> Ran:
    """The real command on surveys that are written for it."""
    with written(surveys, place, crs) as folders:
        return run(*folders)


def drawn(simulation: Simulation) -> tuple[Drawn, Drawn]:
    return Drawn.of(simulation.reference, simulation.seed), Drawn.of(simulation.source, simulation.seed + 1)


def rms(a: FloatArray, b: FloatArray) -> float:
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))
