"""The pages, what stands in their blocks, and the commands that they show."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import typer

from treereg_core.cli.app import app

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path for glob in ("*.md", "docs/**/*.md", "plugins/*/README.md", "examples/**/*.md") for path in ROOT.glob(glob)
)
TREEREG = typer.main.get_command(app)
COMMANDS = dict(TREEREG.commands)
SHELL = ("", "sh", "bash", "console")
"""Languages of blocks that a person would paste into a shell; most say none."""
OF_THE_SHELL = re.compile(r"^\s*(?:for|while|if|set)\b|\$", re.MULTILINE)


def name(page: Path) -> str:
    """A page as people know it."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str = "") -> list[str]:
    """The code blocks of a page in a language, without their fences."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{re.escape(language)}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def shell_blocks(page: Path) -> list[str]:
    """The blocks that show commands of treereg, in the order of the page."""
    text = page.read_text(encoding="utf-8")
    found = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [block for language, block in found if language in SHELL and (commands(block) or is_script(block))]


def commands(block: str) -> list[list[str]]:
    """The words after `treereg` of each command in a block; lines that end in a backslash go on."""
    lines = re.sub(r"\\\n\s*", " ", block).splitlines()
    found = (re.match(r"(?:.*&& )?(?:uv run )?treereg (.*)", line.strip()) for line in lines)
    return [shlex.split(match[1], comments=True) for match in found if match]


def is_script(block: str) -> bool:
    """Whether a block runs treereg by more than the shell's plain words, such as a loop."""
    return bool(re.search(r"\btreereg [a-z]+ ", block) and OF_THE_SHELL.search(block))


def mentioned(page: Path) -> list[list[str]]:
    """The words after `treereg` of each command that the text itself names, in single backticks."""
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    return [shlex.split(words) for words in re.findall(r"`treereg ([^`]+)`", prose)]
