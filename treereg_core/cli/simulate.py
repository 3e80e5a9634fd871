"""`treereg simulate`: two survey folders with their truth."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from treereg_core.cli.completion import families
from treereg_core.cli.console import Quiet, Verbose, console
from treereg_core.cli.help import SCENE
from treereg_core.errors import UsageError
from treereg_core.io import SIMULATION_NAMES, OutputFolder
from treereg_core.settings import describe, parse_value, range_in_words, record
from treereg_core.simulate import FAMILIES, Scene, family_scene, write_simulation
from treereg_core.simulate import simulate as simulated


def flag(field: str) -> str:
    """The long option of a field."""
    return "--" + field.replace("_", "-")


def with_scene(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for every field of a scene, given to it as keywords."""
    own = [p for p in inspect.signature(command, eval_str=True).parameters.values() if p.kind is not p.VAR_KEYWORD]
    options = {field: scene_option(field, words) for field, words in describe(Scene).items()}
    added = [
        inspect.Parameter(field, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=option)
        for field, option in options.items()
    ]
    command.__signature__ = inspect.Signature([*own, *added])  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *added)}
    return command


def scene_option(field: str, words: dict[str, Any]) -> Any:
    """The annotation of one option; its text is read and checked by the scene itself."""
    allowed = range_in_words(words)
    help_text = words.get("description", "") + (f" ({allowed})" if allowed else "")
    default = words.get("default")
    below: dict[str, Any] = {"rich_help_panel": SCENE}
    if words.get("type") == "boolean":
        return Annotated[bool | None, typer.Option(f"{flag(field)}/--no-{flag(field)[2:]}", help=help_text, **below)]
    unit = "METRES" if words.get("unit") == "m" else "DEGREES" if words.get("unit") == "deg" else "VALUE"
    if "array" in words.get("type", ""):
        return Annotated[tuple[float, float] | None, typer.Option(flag(field), metavar="X Y", help=help_text, **below)]
    shown = "" if default is None else f" [default: {default}]"
    return Annotated[str | None, typer.Option(flag(field), metavar=unit, help=help_text + shown, **below)]


@with_scene
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Gets reference, source and truth.json.")],
    *,
    family: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", autocompletion=families, help=f"Instead of scene options: one of {', '.join(FAMILIES)}."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="The same seed gives the same surveys.")] = 0,
    rasters: Annotated[
        bool, typer.Option("--rasters/--no-rasters", help="An orthomosaic and elevations at 10 cm for both surveys.")
    ] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier simulate wrote.")] = False,
    verbose: Verbose = False,
    quiet: Quiet = False,
    **scene: Any,
) -> None:
    """Simulate two survey folders, DIR/reference and DIR/source, with the truth in DIR/truth.json."""
    given = {field: plain(value) for field, value in scene.items() if value is not None}
    if family is not None and given:
        raise UsageError(f"--family and {flag(next(iter(given)))} exclude each other; leave one out.")
    described = record(Scene, given, flag) if family is None else family_scene(family, seed)
    with OutputFolder(folder, overwrite=overwrite, names=SIMULATION_NAMES) as staging:
        console.share("simulate", 0)
        made = simulated(described, seed)
        write_simulation(made, staging, rasters=rasters, progress=painting)
    console.note(f"{len(made.reference)} and {len(made.source)} trees written to {folder}")


def painting(name: str, share: float) -> None:
    """How much of a survey's images is done."""
    console.share(f"paint {name}", share)


def plain(value: Any) -> Any:
    """A number where an option's text shows one."""
    return parse_value(value) if isinstance(value, str) else value
