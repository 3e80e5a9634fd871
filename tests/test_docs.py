"""What the pages say must be so: links lead somewhere, commands and options exist, examples work."""

import re
import shlex
from pathlib import Path

import pytest
import typer

from treereg_core.cli import main
from treereg_core.cli.app import app

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("plugins/*/README.md")])
COMMANDS = dict(typer.main.get_command(app).commands)
OPTIONS = {
    name: {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    | {"-h", "--help"}
    for name, command in COMMANDS.items()
}
ELSEWHERE = {"--check", "--all-packages", "--fix", "--keep-going", "--out"}
"""Options of other tools that the pages mention in passing."""

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def blocks(page, language=""):
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def command_lines(page):
    for block in blocks(page):
        for line in block.splitlines():
            found = re.search(r"(?:^|&& )(?:uv run )?treereg (.*)", line)
            if found:
                yield shlex.split(found[1])


@pages
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{target} is not there"


@pages
def test_commands_and_their_options_exist(page):
    for words in command_lines(page):
        assert words[0] in COMMANDS, f"there is no command {words[0]}"
        given = {word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-z]", word)}
        assert given <= OPTIONS[words[0]], f"treereg {' '.join(words)}"


@pages
def test_options_in_the_text_exist(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    mentioned = {option for span in re.findall(r"`([^`]+)`", prose) for option in re.findall(r"--[a-z][a-z-]+", span)}
    assert mentioned <= set().union(*OPTIONS.values()) | ELSEWHERE


def test_every_command_and_every_option_of_run_is_described():
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"## treereg {name}" not in text] == []
    long = {option for option in OPTIONS["run"] if option.startswith("--")} - {"--help", "--quiet", "--verbose"}
    assert {option for option in long if option not in text} == set()


def test_every_page_is_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if page.parent.name == "docs" and f"({page.name})" not in index] == ["index.md"]


def test_the_readmes_test_command_is_what_ci_runs():
    command = next(line for block in blocks(ROOT / "README.md") for line in block.splitlines() if "pytest" in line)
    install, run = command.split(" && ")
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert install == "pip install uv"
    assert run in script.splitlines()


def test_the_readme_shows_what_the_demonstration_prints(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "--method", "icp"]) == 0
    printed, shown = capsys.readouterr().out, blocks(ROOT / "README.md")[1]
    assert shape(shown) == shape(printed)


def test_the_examples_in_python_and_toml_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", ".", "--family", "small_150", "--no-rasters"]) == 0
    example = blocks(ROOT / "README.md", "python")[0]
    exec(example.replace("REFERENCE", "reference").replace("SOURCE", "source"))
    assert "Verdict.ACCEPTED" in capsys.readouterr().out
    Path("options.toml").write_text(blocks(ROOT / "docs" / "commands.md", "toml")[0], encoding="utf-8")
    assert main(["run", "reference", "source", "--config", "options.toml", "--out", "out", "--json"]) in (0, 3)
    assert '"share": 0.5' in capsys.readouterr().out


def shape(text):
    """A text with its numbers, which may differ in the last digit from machine to machine, made alike."""
    return re.sub(r"[+-]?\d+(\.\d+)?(e-?\d+)?", "0", text)


def test_the_plugin_of_the_guide_keeps_every_law(tmp_path):
    path = tmp_path / "large.py"
    path.write_text(blocks(ROOT / "docs" / "plugins.md", "python")[0], encoding="utf-8")
    assert main(["check", str(path)]) == 0
