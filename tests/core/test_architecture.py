"""Who imports whom: the rules of the house, read from the imports themselves."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = ROOT / "treereg_core"
PLUGINS = sorted((ROOT / "plugins").glob("*/treereg_*"))
RUNNER = {
    f"treereg_core.{name}"
    for name in (
        *("api", "application", "cli", "description", "detection", "expression", "heights", "io", "judge", "memory"),
        "notebook",
        *("options", "outlines", "outputs", "pipeline", "plan", "recall", "registry", "report", "result", "rows"),
        *("settings", "simulate", "survey", "survey_copy", "survey_rasters", "testing"),
    )
}
"""What runs methods, reads files and judges: not for plugins. The rest of the core is public."""
HEAVY = {"geopandas", "pyogrio", "rasterio", "pyarrow", "pyproj", "shapely", "pandas", "pgmpy", "matplotlib"}


def files_of(package: Path) -> list[Path]:
    return sorted(package.rglob("*.py"))


def module_of(path: Path, package: Path) -> str:
    parts = path.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, top_level: bool = False) -> Iterator[str]:
    """What a file imports, in dots; what stands under TYPE_CHECKING does not run and is left out."""
    nodes: list[ast.AST] = list(ast.parse(path.read_text(encoding="utf-8")).body)
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            nodes += node.orelse
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif not (top_level and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)):
            nodes += ast.iter_child_nodes(node)


def names_of_methods() -> set[str]:
    return {path.parents[1].name for path in (ROOT / "plugins").glob("*/treereg_*/__init__.py")}


@pytest.mark.parametrize("path", files_of(CORE), ids=lambda path: module_of(path, CORE))
def test_the_core_imports_no_plugin_and_names_no_method(path: Path) -> None:
    plugins = {package.name for package in PLUGINS}
    assert not {name.split(".")[0] for name in imports(path)} & plugins
    strings = {
        node.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    named = {part for string in strings if " " not in string for part in string.split("+")} & names_of_methods()
    assert not named, f"the core names {named}"


@pytest.mark.parametrize("package", PLUGINS, ids=lambda package: package.name)
def test_a_plugin_imports_no_plugin_and_only_the_public_core(package: Path) -> None:
    others = {other.name for other in PLUGINS} - {package.name}
    for path in files_of(package):
        names = set(imports(path))
        assert not {name.split(".")[0] for name in names} & others, f"{path} imports another plugin"
        private = {name for name in names if ".".join(name.split(".")[:2]) in RUNNER or "._" in name}
        assert not private, f"{path} imports {private}"


@pytest.mark.parametrize("package", [CORE, *PLUGINS], ids=lambda package: package.name)
def test_no_import_circles(package: Path) -> None:
    modules = {module_of(path, package): path for path in files_of(package)}
    below = {
        name: {other if other in modules else other.rpartition(".")[0] for other in imports(path)} & modules.keys()
        for name, path in modules.items()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " > ".join([*trail[trail.index(name) :], name])
        if name not in done:
            for other in sorted(below[name]):
                visit(other, (*trail, name))
            done.add(name)

    for name in modules:
        visit(name, ())


def test_only_io_imports_the_libraries_of_files() -> None:
    for path in files_of(CORE):
        if CORE / "io" not in path.parents:
            heavy = {name.split(".")[0] for name in imports(path)} & {"geopandas", "pyogrio", "rasterio"}
            assert not heavy, f"{path} imports {heavy}"


@pytest.mark.parametrize("package", [CORE, *PLUGINS], ids=lambda package: package.name)
def test_heavy_libraries_are_imported_where_they_are_used(package: Path) -> None:
    for path in files_of(package):
        heavy = {name.split(".")[0] for name in imports(path, top_level=True)} & HEAVY
        assert not heavy, f"{path} imports {heavy} at its top"


@pytest.mark.parametrize("arguments", [["--help"], ["methods"], ["run", "--help"]])
def test_looking_around_imports_nothing_heavy(arguments: list[str]) -> None:
    code = f"import sys; from treereg_core.cli import main; main({arguments!r}); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.split())
    assert "typer" in loaded
    assert not loaded & HEAVY
