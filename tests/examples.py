"""Runs the commands of a page in a folder of its own, on surveys that are made as the commands ask for them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from tests import pages
from treereg_core.cli import main
from treereg_core.registry import installed
from treereg_core.simulate import FAMILIES, Scene, Seasons, simulate_series, write_series

QUICK = "small_150"
"""The family that stands for all others in examples."""
LANGUAGES = {".py": "python", ".toml": "toml", ".csv": "csv"}
"""Files whose text the page itself shows, in its first block of that language."""
WORKED = (0, 3)
SCENE, SEED = Scene(trees=300, missed=0.04, false=0.04), 5


@dataclass(frozen=True)
class Orchard:
    """Eight surveys of one orchard, without rasters, and the files that a person would have of them."""

    folder: Path
    surveys: tuple[Path, ...]

    @classmethod
    def make(cls, folder: Path) -> Orchard:
        """Simulate it, and register the second survey onto the first."""
        surveys = write_series(simulate_series(SCENE, SEED, Seasons(surveys=8)), folder)
        assert main(["run", str(surveys[0]), str(surveys[1]), "--out", str(folder / "result"), "-q"]) == 0
        return cls(folder, surveys)

    def put(self, path: Path, page: Path) -> None:
        """Make the file `path`, by its ending, and the folder it is in."""
        path.parent.mkdir(parents=True, exist_ok=True)
        detections = self.surveys[1] / "raw-detections.geojson"
        if path.suffix == ".json":
            shutil.copy(self.folder / "result" / "registration.json", path)
        elif path.suffix == ".geojson":
            shutil.copy(detections, path)
        elif path.suffix in (".gpkg", ".shp"):
            import geopandas as gpd

            gpd.read_file(detections).to_file(path)
        elif path.suffix == ".tif":
            raster(path, detections)
        elif path.name == "orchards.csv":
            path.write_text(f"orchard,reference,source\nhome,{self.surveys[0]},{self.surveys[1]}\n", encoding="utf-8")
        elif path.suffix in LANGUAGES:
            path.write_text(pages.blocks(page, LANGUAGES[path.suffix])[0], encoding="utf-8")
        else:
            raise AssertionError(f"{pages.name(page)} uses {path}, and no example file of that kind is known")


def raster(path: Path, over: Path) -> None:
    """An image of one band over the ground of a vector file, a pixel to the metre."""
    import geopandas as gpd
    import numpy as np
    import rasterio
    from rasterio.transform import Affine

    west, south, east, north = gpd.read_file(over).to_crs("EPSG:32734").total_bounds
    size = {"width": int(east - west) + 1, "height": int(north - south) + 1}
    grid = Affine(1, 0, west, 0, -1, north)
    with rasterio.open(path, "w", "GTiff", **size, count=1, dtype="uint8", crs="EPSG:32734", transform=grid) as file:
        file.write(np.random.default_rng(0).integers(1, 255, (1, size["height"], size["width"]), dtype=np.uint8))


@dataclass
class Session:
    """One page's examples, in the working folder, from its first command to its last."""

    page: Path
    orchard: Orchard
    known: dict[str, Path] = field(default_factory=dict)
    made: set[str] = field(default_factory=set)
    names: dict[str, object] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The whole page."""
        return self.page.read_text(encoding="utf-8")

    def block(self, block: str) -> None:
        """Run a block; what earlier ones wrote makes place for what this one writes to the same folder."""
        if pages.is_script(block):
            self.script(block)
            return
        written = set()
        for words in pages.commands(block):
            if self.of_this_page(words) or self.elsewhere(words):
                continue
            out = self.prepare(words)
            if out in self.made - written:
                shutil.rmtree(out, ignore_errors=True)
            code = main(self.swift(words))
            assert code in WORKED, f"treereg {' '.join(words)} ends with {code}"
            written.add(out)
        self.made |= written

    def prepare(self, words: list[str]) -> str:
        """Make what a command reads and is not there yet; gives the folder that it writes to."""
        command = pages.COMMANDS[words[0]]
        for path in (Path(word) for word in words if word.endswith(".toml")):  # read while words are taken apart
            self.orchard.put(path, self.page)
        context = command.make_context(words[0], list(words[1:]))
        for parameter in command.params:
            value = context.params.get(parameter.name)
            values = value if isinstance(value, list | tuple) else [value]
            called = str(parameter.metavar or "")
            for path in (Path(str(v)) for v in values if v is not None and not Path(str(v)).exists()):
                if re.search("SURVEY|REFERENCE|SOURCE", called) and parameter.param_type_name == "argument":
                    self.survey(path)
                elif re.search(r"FILE|MANIFEST|\.json", called) and path.suffix and parameter.name != "out":
                    self.orchard.put(path, self.page)
        return str(context.params["folder"] if words[0] == "simulate" else context.params.get("out"))

    def swift(self, words: list[str]) -> list[str]:
        """A command as it is run: one trial of a small family, and rasters only where the page speaks of them."""
        if words[0] == "simulate" and f"{words[1]}/" not in "".join(re.findall(r"\S+\.tif", self.text)):
            return [*words, "--no-rasters"]
        if words[0] != "evaluate":
            return words
        named = {words[k + 1] for k, word in enumerate(words) if word == "--family"}
        assert named <= {family.name for family in FAMILIES.values()} | {family.group for family in FAMILIES.values()}
        return [*(QUICK if word in named else word for word in words), "--trials", "1", "--jobs", "1"]

    def survey(self, path: Path) -> None:
        """The next survey of the orchard, under the name that the page gives it."""
        assert len(self.known) < len(self.orchard.surveys), f"{self.page} names too many surveys"
        shutil.copytree(self.orchard.surveys[len(self.known)], path)
        self.known[str(path)] = path

    def of_this_page(self, words: list[str]) -> bool:
        """Whether a command needs a method that the reader has just written and installed: it only has to be one."""
        known = {entry.name for entry in installed().entries} | {"judge"}
        method = words[words.index("--method") + 1] if "--method" in words else ""
        asked = set(method.split("+")) if method else set(words[1:2]) if words[0] == "methods" else set()
        unknown = asked - known - {""}
        if not unknown:
            return False
        written = "\n".join(pages.blocks(self.page, "python"))
        classes = {
            re.sub(r"(?<!^)(?=[A-Z])", "_", c).lower() for c in re.findall(r"^class (\w+)", written, re.MULTILINE)
        }
        assert unknown <= classes, f"there is no method {', '.join(sorted(unknown))}"
        pages.COMMANDS[words[0]].make_context(words[0], list(words[1:]))
        return True

    def elsewhere(self, words: list[str]) -> bool:
        """Whether a command needs other machines: it only has to be one."""
        if "--scheduler" not in words:
            return False
        pages.COMMANDS[words[0]].make_context(words[0], list(words[1:]))
        return True

    def python(self, block: str) -> None:
        """Run a block of Python after the page's commands, unless it is a part of a plugin or of a test."""
        if re.search(r"^\s*(?:class|def) ", block, re.MULTILINE):
            return
        for name in re.findall(r'"(REFERENCE|SOURCE|20\d\d(?:-\d\d)?)"', block):
            if not Path(name).exists():
                self.survey(Path(name))
        for name in re.findall(r'"([\w/.-]+\.(?:json|geojson|gpkg|tif))"', block):
            if not Path(name).exists():
                self.orchard.put(Path(name), self.page)
        exec(block, self.names)

    def script(self, block: str) -> None:
        """Run a block that needs a shell, with three orchards in `farm/`, of which the last cannot be read."""
        for orchard in ("north", "south", "west"):
            for survey, name in zip(self.orchard.surveys, ("2023-03", "2024-02"), strict=False):
                shutil.copytree(survey, Path("farm") / orchard / name, dirs_exist_ok=True)
        (Path("farm") / "west" / "2024-02" / "raw-detections.geojson").write_text("{}", encoding="utf-8")
        place = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        done = subprocess.run(
            ["bash", "-c", block], env={**os.environ, "PATH": place}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
