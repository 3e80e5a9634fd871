"""Order: what is to be done with one orchard, and how it is told whether that is done already."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path

from treereg_core import io
from treereg_core.batch.outcome import JUDGED, Outcome
from treereg_core.errors import InputError
from treereg_core.options import Options

RECORD = "batch.json"
SCHEMA = "treereg/batch-record/1"
DIGEST_BYTES = 16


@dataclass(frozen=True)
class Work:
    """What is to be done with every orchard. `plugins` names the distribution of each method."""

    options: Options
    plugins: Mapping[str, str]
    rasters: io.RasterOptions | None = None
    confidence_property: str = "confidence"
    force: bool = False

    @property
    def text(self) -> str:
        """Everything that results depend on."""
        rasters = asdict(replace(self.rasters, threads=1)) if self.rasters else None
        parts = (
            self.options.model_dump(mode="json", exclude={"threads", "memory"}),
            *(dict(self.plugins), rasters, self.confidence_property, self.force, metadata.version("treereg")),
        )
        return json.dumps(parts, sort_keys=True, default=str)


@dataclass(frozen=True)
class Limits:
    """What one orchard may take: `seconds`, and `memory_bytes` where the system can limit that; None: any."""

    seconds: float | None = None
    memory_bytes: int | None = None


@dataclass(frozen=True)
class Order:
    """One orchard, the folder of its results, and what is to be done."""

    orchard: str
    reference: Path
    source: Path
    folder: Path
    work: Work

    @property
    def digest(self) -> str:
        """Of the work and of the surveys' files: their places, sizes and times of change.

        `InputError` for a survey folder that cannot be used.
        """
        told = hashlib.blake2b(self.work.text.encode(), digest_size=DIGEST_BYTES)
        for survey in (self.reference, self.source):
            for file in io.find_files(survey).present:
                told.update(repr((str(file), io.stamp(file))).encode(errors="replace"))
        return told.hexdigest()

    @property
    def done(self) -> Outcome | None:
        """What came of it, when the folder holds all files of just this work on just these surveys."""
        try:
            record = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
            sizes = {name: (self.folder / name).stat().st_size for name in record["files"]}
            if record["schema"] != SCHEMA or record["digest"] != self.digest or record["files"] != sizes:
                return None
            outcome = Outcome.from_json(record["outcome"])
        except (InputError, OSError, LookupError, RecursionError, TypeError, ValueError):
            return None
        return outcome if outcome.verdict in JUDGED and outcome.orchard == self.orchard else None


def write_record(folder: Path, digest: str, outcome: Outcome) -> None:
    """Write beside the files of a registration what they were made of and what came of it."""
    sizes = {file.name: file.stat().st_size for file in sorted(folder.iterdir())}
    content = {"schema": SCHEMA, "digest": digest, "files": sizes, "outcome": outcome.to_json()}
    io.write_json(folder / RECORD, content)
