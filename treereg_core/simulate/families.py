"""Families of scenes: the named conditions that tests, benchmarks and `treereg simulate --family` share."""

from __future__ import annotations

import difflib
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from treereg_core.errors import UsageError
from treereg_core.simulate.scene import Scene
from treereg_core.simulate.simulation import Simulation, simulate

Group = Literal["ordinary", "hard", "frontier", "absent"]
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class Family:
    """A kind of scene. `scene(rng)` draws one: what the family is about is fixed, the rest varies a little.

    Groups: `ordinary` and `hard` are to be solved, `frontier` as far as possible; in `absent` there is no truth to be
    found and nothing may be accepted.
    """

    name: str
    group: Group
    description: str
    scene: Callable[[np.random.Generator], Scene]


def family_scene(name: str, seed: int) -> Scene:
    """The scene of a family for this seed. Raises `UsageError` for an unknown family."""
    if name not in FAMILIES:
        near = difflib.get_close_matches(name, FAMILIES, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"choose one of {', '.join(FAMILIES)}."
        raise UsageError(f"There is no family {name!r}: {hint}")
    return FAMILIES[name].scene(np.random.default_rng([zlib.crc32(name.encode()), seed]))


def simulate_family(name: str, seed: int) -> Simulation:
    """Two surveys of the family's scene for this seed. Raises `UsageError` for an unknown family."""
    return simulate(family_scene(name, seed), seed)


def _orchard(rng: np.random.Generator) -> dict[str, Any]:
    """What varies from one orchard to the next, whatever the family."""
    return {
        "trees": round(1500 * rng.uniform(0.9, 1.1)),
        "row_spacing": 5.5 * rng.uniform(0.9, 1.15),
        "spacing": 3.0 * rng.uniform(0.9, 1.2),
        "planting_jitter": rng.uniform(0.12, 0.2),
        "gaps": rng.uniform(0.02, 0.09),
        "holes": int(rng.integers(0, 4)),
        "crown_cover": rng.uniform(0.25, 0.45),
        "area_variation": rng.uniform(0.22, 0.38),
        "area_persistence": rng.uniform(0.5, 0.7),
        "vigour": rng.uniform(0.08, 0.25),
        "growth": rng.uniform(1.0, 1.3),
        "confidence": rng.uniform(0.4, 0.88),
        "confidence_information": rng.uniform(0.3, 0.6),
    }


_FAR: Settings = {"shift_sd": 15.0, "rotation": "any"}
_BARE: Settings = {"outline": "rectangle", "holes": 0}
_HEAVY_NOISE: Settings = {"missed": 0.35, "false": 0.35, "jitter": 0.45}
_PERFECT: Settings = {
    "periodic": True,
    "dead": 0.0,
    "jitter": 0.0,
    "missed": 0.0,
    "false": 0.0,
    "split": 0.0,
    "merged": 0.0,
}


def _typical(**settings: Any) -> Callable[[np.random.Generator], Scene]:
    return lambda rng: Scene(**{**_orchard(rng), **settings})


def _small(trees: int, **settings: Any) -> Callable[[np.random.Generator], Scene]:
    return lambda rng: Scene(**{**_orchard(rng), "trees": trees, "holes": int(rng.integers(0, 2)), **settings})


def _dense(trees: int, split: float, merged: float) -> Callable[[np.random.Generator], Scene]:
    def scene(rng: np.random.Generator) -> Scene:
        settings = {
            "trees": round(trees * rng.uniform(0.95, 1.05)),
            "row_spacing": 3.5 * rng.uniform(0.95, 1.1),
            "spacing": 1.5 * rng.uniform(0.95, 1.1),
            "planting_jitter": rng.uniform(0.07, 0.12),
            "jitter": 0.15,
            "split": split,
            "merged": merged,
        }
        return Scene(**{**_orchard(rng), **settings, **_FAR})

    return scene


def _square(rng: np.random.Generator) -> Scene:
    side = 6.0 * rng.uniform(0.95, 1.05)
    return Scene(**{**_orchard(rng), "row_spacing": side, "spacing": side, **_FAR})


def _curved(rng: np.random.Generator) -> Scene:
    return Scene(**{**_orchard(rng), "curve": rng.uniform(6, 20), **_FAR})


def _paths(rng: np.random.Generator) -> Scene:
    settings = {"paths": int(rng.integers(2, 4)), "path_width": rng.uniform(4, 7)}
    return Scene(**{**_orchard(rng), **settings, **_FAR})


def _contour(rng: np.random.Generator) -> Scene:
    return Scene(**{**_orchard(rng), "contour": rng.uniform(2, 4), **_FAR})


def _headlands(rng: np.random.Generator) -> Scene:
    settings = {"outline": "rectangle", "headlands": int(rng.integers(1, 3))}
    return Scene(**{**_orchard(rng), **settings, **_FAR})


def _double_hedgerow(rng: np.random.Generator) -> Scene:
    settings = {
        "row_spacing": 7.0 * rng.uniform(0.95, 1.1),
        "hedgerow": 2.0 * rng.uniform(0.9, 1.15),
        "spacing": 2.2 * rng.uniform(0.9, 1.1),
    }
    return Scene(**{**_orchard(rng), **settings, **_FAR})


def _different(rng: np.random.Generator) -> Scene:
    settings = _orchard(rng)
    outline = "rectangle" if rng.random() < 0.5 else "irregular"
    scale = 1.0 if rng.random() < 0.5 else rng.uniform(0.75, 1.3)
    return Scene(**{**settings, "outline": outline, "same_orchard": False, "other_scale": scale, **_FAR})


def _periodic_crops(rng: np.random.Generator) -> Scene:
    trees = round(rng.uniform(3000, 5000))  # of which a window shows about a third
    windows = {"trees": trees, "crop": "windows", "overlap": rng.uniform(0.4, 0.8)}
    return Scene(**{**_orchard(rng), **_PERFECT, **windows, **_FAR})


def _periodic_turn(rng: np.random.Generator) -> Scene:
    return Scene(**{**_orchard(rng), **_PERFECT, **_FAR})


_ALL = (
    Family("shift_06", "ordinary", "shifts of 0.6 m sd", _typical(shift_sd=0.6)),
    Family("shift_3", "ordinary", "shifts of 3 m sd", _typical(shift_sd=3.0)),
    Family("shift_15", "ordinary", "shifts of 15 m sd", _typical(shift_sd=15.0)),
    Family("rotation_3", "ordinary", "rotations of 3 degrees sd", _typical(rotation_sd=3.0)),
    Family("rotation_any", "ordinary", "any rotation", _typical(**_FAR)),
    Family(
        "noisy",
        "ordinary",
        "20 % missed, 20 % false, 0.35 m jitter",
        _typical(missed=0.2, false=0.2, jitter=0.35, **_FAR),
    ),
    Family("curved", "ordinary", "curved rows", _curved),
    Family("bare_rectangle", "ordinary", "a rectangle with 3 % gaps", _typical(**_BARE, gaps=0.03, **_FAR)),
    Family("overlap_60", "ordinary", "60 % overlap", _typical(overlap=0.6, **_FAR)),
    Family("distortion_035", "ordinary", "a smooth distortion of 0.35 m", _typical(distortion=0.35, **_FAR)),
    Family("dense_8000", "ordinary", "8,000 trees at 3.5 x 1.5 m", _dense(8000, split=0.02, merged=0.03)),
    Family("small_150", "ordinary", "150 trees", _small(150, **_FAR)),
    Family("small_150_near", "ordinary", "150 trees, shifts of 3 m sd", _small(150, shift_sd=3.0)),
    Family("square_any", "ordinary", "a square lattice turned any way", _square),
    Family("paths", "ordinary", "two or three paths across the rows", _paths),
    Family("contour", "ordinary", "rows that follow a slope, swaying by 2 to 4 m", _contour),
    Family("headlands", "ordinary", "a rectangle with one or two rows across at both ends", _headlands),
    Family("double_hedgerow", "ordinary", "staggered double rows, 2 m apart, every 7 m", _double_hedgerow),
    Family(
        "dense",
        "ordinary",
        "1,500 trees at 3.5 x 1.5 m, 4 % split and 4 % merged",
        _dense(1500, split=0.04, merged=0.04),
    ),
    Family(
        "heavy_noise",
        "hard",
        "65 % detected, 35 % false, 0.45 m jitter",
        _typical(**_HEAVY_NOISE, **_FAR),
    ),
    Family("overlap_50", "hard", "half overlap", _typical(overlap=0.5, **_FAR)),
    Family("overlap_25", "hard", "a quarter overlap", _typical(overlap=0.25, **_FAR)),
    Family("rectangle_05", "hard", "a rectangle with 0.5 % gaps", _typical(**_BARE, gaps=0.005, **_FAR)),
    Family("silent_areas", "hard", "areas that say nothing", _typical(area_persistence=0.0, **_FAR)),
    Family("distortion_1", "hard", "a smooth distortion of 1 m", _typical(distortion=1.0, **_FAR)),
    Family(
        "ends_67",
        "frontier",
        "each misses a different end, two thirds of the orchard shared",
        _typical(crop="ends", overlap=0.8, **_FAR),
    ),
    Family(
        "ends_33",
        "frontier",
        "each misses a different end, one third of the orchard shared",
        _typical(crop="ends", overlap=0.5, **_FAR),
    ),
    Family(
        "heavy_overlap_40",
        "frontier",
        "heavy noise and 40 % overlap",
        _typical(**_HEAVY_NOISE, overlap=0.4, **_FAR),
    ),
    Family(
        "half_rectangle_silent",
        "frontier",
        "a bare rectangle, half overlap, areas that say nothing",
        _typical(**_BARE, gaps=0.03, overlap=0.5, area_persistence=0.0, **_FAR),
    ),
    Family("small_60", "frontier", "60 trees", _small(60, **_FAR)),
    Family("distortion_2", "frontier", "a smooth distortion of 2 m", _typical(distortion=2.0, **_FAR)),
    Family("different", "absent", "two different orchards, half of them with the same spacing", _different),
    Family("periodic_crops", "absent", "differing crops of one perfect lattice", _periodic_crops),
    Family("periodic_turn", "absent", "a block that a half turn leaves the same", _periodic_turn),
)

FAMILIES: Mapping[str, Family] = MappingProxyType({family.name: family for family in _ALL})
GROUPS = tuple(dict.fromkeys(family.group for family in _ALL))
"""How families are put together: by how much they ask for."""
