"""What the pages say must be so: links lead somewhere, commands and options exist, examples work."""

import re

import pytest
import typer

from benchmarks.method_settings import filled
from tests.examples import Orchard, Session
from tests.pages import COMMANDS, PAGES, ROOT, TREEREG, blocks, commands, mentioned, name, shell_blocks
from treereg_core.cli import main
from treereg_core.registry import installed

OPTIONS = {
    name: {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    | {"-h", "--help"}
    for name, command in COMMANDS.items()
}
OWN = {option for parameter in TREEREG.params for option in parameter.opts}
"""Options of treereg itself."""
ELSEWHERE = {"--check", "--all-packages", "--fix", "--keep-going", "--out"}
ELSEWHERE |= {"--exclude-editable", "--disable-pip", "--no-deps"}
"""Options of other tools that the pages mention in passing."""

pages = pytest.mark.parametrize("page", PAGES, ids=name)


@pytest.fixture(scope="session")
def orchard(tmp_path_factory):
    return Orchard.make(tmp_path_factory.mktemp("orchard"))


@pages
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{target} is not there"


@pytest.mark.parametrize("page", [p for p in PAGES if shell_blocks(p) or blocks(p, "python")], ids=name)
def test_commands_and_python_work(page, orchard, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    session = Session(page, orchard)
    for block in shell_blocks(page):
        session.block(block)
    for block in blocks(page, "python"):
        session.python(block)
    printed = shape(capsys.readouterr().out)
    for block in blocks(page, "text"):
        if re.match("accepted:|ambiguous:|failed:", block):
            assert shape(block) in printed


@pytest.mark.parametrize(
    ("command", "seen"),
    [
        ("treereg run 2023 2024 --no-such-option", "No such option"),
        ("treereg simulate orchard --trees many", "ends with 2"),
        ("uv run treereg methods nothing", "there is no method nothing"),
        ("treereg run 2023 2024 --method icp+nothing", "there is no method nothing"),
        ("treereg run 2023 2024 --out 2023", "ends with 2"),
        ('for year in 2024; do treereg rows "$year" --no-such-option; done', "No such option"),
    ],
)
def test_a_command_that_does_not_work_is_seen(command, seen, orchard, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n\n```\n{command}\n```\n", encoding="utf-8")
    with pytest.raises((AssertionError, typer.TyperException), match=seen):
        Session(page, orchard).block(shell_blocks(page)[0])


@pages
def test_commands_in_the_text_and_their_options_exist(page):
    for words in [*mentioned(page), *(words for block in shell_blocks(page) for words in commands(block))]:
        assert words[0] in {*COMMANDS, *OWN, "--help", "COMMAND"}, f"there is no command {words[0]}"
        given = {word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-z]", word)}
        assert given <= OPTIONS.get(words[0], {"--help"}), f"treereg {' '.join(words)}"


@pages
def test_options_in_the_text_exist(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    mentioned = {option for span in re.findall(r"`([^`]+)`", prose) for option in re.findall(r"--[a-z][a-z-]+", span)}
    assert mentioned <= set().union(*OPTIONS.values()) | OWN | ELSEWHERE


def test_every_command_and_every_option_of_run_is_described():
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"## treereg {name}" not in text] == []
    long = {option for option in OPTIONS["run"] if option.startswith("--")} - {"--help", "--quiet", "--verbose"}
    assert {option for option in long if option not in text} == set()


def test_every_page_is_in_the_index():
    docs = ROOT / "docs"
    index = (docs / "index.md").read_text(encoding="utf-8") + (docs / "api" / "index.md").read_text(encoding="utf-8")
    inside = [page for page in PAGES if docs in page.parents and page.name != "index.md"]
    names = {page: page.relative_to(docs / "api" if page.parent.name == "api" else docs).as_posix() for page in inside}
    assert [page for page, name in names.items() if f"({name})" not in index] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "methods"], ids=name)
def test_the_settings_of_a_method_are_those_of_its_record(page):
    assert filled(page) == page.read_text(encoding="utf-8"), "uv run python -m benchmarks.method_settings"


def test_every_method_and_recipe_has_a_page():
    methods = {entry.name for entry in installed().entries if entry.role != "evaluator"}
    assert {page.stem for page in PAGES if page.parent.name == "methods"} == methods


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


def shape(text):
    """A text with its numbers, which may differ in the last digit from machine to machine, made alike."""
    return re.sub(r"[+-]?\d+(\.\d+)?(e-?\d+)?", "0", text)


def test_the_plugins_of_the_guide_keep_every_law(tmp_path):
    plugins = [
        block
        for block in blocks(ROOT / "docs" / "plugins.md", "python")
        if "@hookimpl" in block and "treereg_outside" not in block
    ]
    assert len(plugins) == 2
    for k, block in enumerate(plugins):
        path = tmp_path / f"plugin_{k}.py"
        path.write_text(block, encoding="utf-8")
        assert main(["check", str(path)]) == 0
