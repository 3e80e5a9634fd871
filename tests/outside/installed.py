"""The outside plugin as an installed distribution: its metadata made from its own pyproject.toml."""

from __future__ import annotations

import tomllib
from importlib import metadata
from pathlib import Path

HOME = Path(__file__).parent


def entry_points(folder: Path) -> list[metadata.EntryPoint]:
    """Write the distribution's metadata into a folder and read it back; the plugin is on the path (conftest.py)."""
    install(HOME, folder)
    return [point for found in metadata.distributions(path=[str(folder)]) for point in found.entry_points]


def install(home: Path, folder: Path) -> None:
    """Write the metadata of the distribution whose pyproject.toml is in `home` into a folder."""
    project = tomllib.loads((home / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    lines = (
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in project["entry-points"].items()
    )
    (info / "entry_points.txt").write_text("\n".join(lines))
