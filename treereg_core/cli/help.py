"""How `--help` looks: options under headings, and examples that work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from typer.core import TyperCommand, TyperGroup

MATCHING, RASTERS, SCENE = "Matching", "Rasters", "Scene"
"""Headings of options."""

EXAMPLES: Mapping[str, Sequence[str]] = {
    "": (
        "treereg run",
        "treereg run 2024 2025 --out registered",
        "treereg methods icp",
    ),
    "run": (
        "treereg run",
        "treereg run 2024 2025 --out registered",
        "treereg run 2024 2025 --method confidence+icp --set confidence.share=0.5",
        "treereg run 2024 2025 --georeference-sd 3 --json",
    ),
    "apply": (
        "treereg apply registered/registration.json 2025/dem_10cm.tif --out moved",
        "treereg apply registered/registration.json 2025/raw-detections.geojson \\\n    --force --out moved-by-force",
    ),
    "methods": ("treereg methods", "treereg methods aco", "treereg methods --json"),
    "check": ("treereg check icp", "treereg check confidence+icp"),
    "rows": ("treereg rows 2024 --out rows-2024.geojson",),
    "series": ("treereg series 2023 2024 2025 --out years",),
    "evaluate": (
        "treereg evaluate 2024 2025 --method icp --method aco+icp --trials 20",
        "treereg evaluate --family small_150 --trials 10 --out small",
    ),
    "misregister": (
        "treereg misregister 2025 --out moved --seed 7",
        "treereg misregister 2025 --out turned --rotation 1.5 --translation -3 2",
    ),
    "simulate": (
        "treereg simulate orchard --trees 800 --missed 0.2 --rotation any",
        "treereg simulate narrow --family overlap_25 --seed 7 --no-rasters",
    ),
}
"""Of each command, and of treereg alone, what people type; the folders are surveys."""


def examples(command: str) -> str | None:
    """The examples of a command as the end of its help."""
    return "\n".join(EXAMPLES.get(command, ())) or None


def write_examples(epilog: str | None, formatter: Any) -> None:
    """Write examples as they stand: they are to be copied, so no line is broken."""
    if epilog:
        with formatter.section("Examples"):
            formatter.write("".join(f"  {line}\n" for line in epilog.splitlines()))


class Commands(TyperGroup):
    """All commands."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples."""
        write_examples(self.epilog, formatter)


class Command(TyperCommand):
    """A command whose options stand under the headings that they name (`rich_help_panel`), the others first."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """The arguments as they were named."""
        arguments = [p for p in self.get_params(ctx) if p.param_type_name == "argument"]
        return [str(self.options_metavar), *(named(argument) for argument in arguments)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, then options, heading by heading."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            if parameter.param_type_name == "argument":
                sections["Arguments"].append((named(parameter), record[1].removesuffix("[required]").rstrip()))
            else:
                sections.setdefault(getattr(parameter, "rich_help_panel", None) or "Options", []).append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples."""
        write_examples(self.epilog, formatter)


def named(argument: Any) -> str:
    """An argument as a person writes it, in brackets when it may be left out."""
    name = str(argument.metavar)
    return name if argument.required or name.startswith("[") else f"[{name}]"
