"""The rules of the folder that a command writes into."""

from __future__ import annotations

import os

import pytest

from treereg_core.errors import InputError, UsageError
from treereg_core.io import OutputFolder
from treereg_core.io.output import DEFAULT_OUT


def tree(folder):
    """Every path below a folder, with the text of its files."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def run(path, text="new", **options):
    """A run that writes two files, one of them in a folder of its own."""
    with OutputFolder(path, **options) as staging:
        (staging / "registration.json").write_text(text)
        (staging / "demonstration" / "source").mkdir(parents=True)
        (staging / "demonstration" / "source" / "raw-detections.geojson").write_text(text)


def written(text="new"):
    return {
        "demonstration": None,
        "demonstration/source": None,
        "demonstration/source/raw-detections.geojson": text,
        "registration.json": text,
    }


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("prepared", [False, True])
def test_a_new_or_empty_folder(here, prepared):
    if prepared:
        (here / "a" / "b").mkdir(parents=True)
    run(here / "a" / "b")
    assert tree(here) == {"a": None, "a/b": None, **{f"a/b/{name}": text for name, text in written().items()}}


def test_the_default_place_again(here):
    run(DEFAULT_OUT, "old")
    (DEFAULT_OUT / "tree_matches.geojson").write_text("old")
    run(DEFAULT_OUT)
    assert tree(DEFAULT_OUT) == written()


def test_the_default_place_with_a_file_of_somebody(here):
    run(DEFAULT_OUT, "old")
    (DEFAULT_OUT / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"notes\.txt.*--overwrite"):
        run(DEFAULT_OUT)
    assert tree(DEFAULT_OUT) == {**written("old"), "notes.txt": "mine"}


def test_any_other_place_again_needs_overwrite(here):
    run(here / "x", "old")
    with pytest.raises(UsageError, match=r"x is in use.*--overwrite"):
        run(here / "x")
    assert tree(here / "x") == written("old")
    run(here / "x", overwrite=True)
    assert tree(here / "x") == written()


def test_overwrite_removes_every_file_of_an_earlier_run_and_no_other(here):
    run(here / "x", "old")
    others = {"notes.txt": "mine", "demonstration/notes.txt": "mine", "sub/registration.json": "mine"}
    (here / "x" / "sub").mkdir()
    for name in [*others, "report.html"]:
        (here / "x" / name).write_text("mine")
    with OutputFolder(here / "x", overwrite=True) as staging:
        (staging / "registration.json").write_text("new")
    assert tree(here / "x") == {"demonstration": None, "sub": None, **others, "registration.json": "new"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("earlier", [False, True])
def test_a_run_that_ends_early_leaves_everything_as_it_was(here, error, earlier):
    if earlier:
        run(here / "x", "old")
    before = tree(here)

    def half_a_run():
        with OutputFolder(here / "x", overwrite=True) as staging:
            (staging / "registration.json").write_text("half")
            raise error

    with pytest.raises(error):
        half_a_run()
    assert tree(here) == before


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize(("earlier", "step"), [(False, 0), *((True, step) for step in range(5))])
@pytest.mark.parametrize("late", [False, True])
def test_an_arrival_that_fails_is_undone(here, monkeypatch, error, earlier, step, late):
    if earlier:
        run(here / "x", "old")
    before = tree(here)
    replace, calls = os.replace, []

    def failing(source, target):
        calls.append(target)
        if len(calls) != step + 1:
            replace(source, target)
            return
        if late and earlier:
            replace(source, target)
        raise error

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(InputError if isinstance(error, OSError) else KeyboardInterrupt):
        run(here / "x", overwrite=True)
    assert tree(here) == before


def test_never_an_input_folder_nor_one_that_contains_it(here):
    survey = here / "orchard" / "survey"
    survey.mkdir(parents=True)
    (here / "link").symlink_to(survey)
    for place in (survey, here / "orchard", here, here / "link", survey / ".." / "survey"):
        with pytest.raises(UsageError, match="input folder"):
            run(place, inputs=[survey], overwrite=True)
    run(survey / "out", inputs=[survey])
    run(here / "orchard" / "survey2", inputs=[survey])


def test_a_file_in_the_place_of_the_folder(here):
    (here / "file").write_text("")
    with pytest.raises(UsageError, match="is a file"):
        run(here / "file", overwrite=True)
    with pytest.raises(InputError, match="cannot be written"):
        run(here / "file" / "out")
    assert tree(here) == {"file": ""}


def test_a_folder_in_the_place_of_a_file(here):
    (here / "x" / "registration.json").mkdir(parents=True)
    with pytest.raises(InputError, match="cannot be written"):
        run(here / "x")
    assert tree(here) == {"x": None, "x/registration.json": None}


def test_what_a_killed_run_left_aside_is_no_file_of_anybody(here):
    DEFAULT_OUT.mkdir()
    OutputFolder(DEFAULT_OUT).__enter__()
    run(DEFAULT_OUT)
    assert (DEFAULT_OUT / "registration.json").read_text() == "new"


def test_other_commands_name_their_own_files(here):
    run(here / "x", "old")
    with OutputFolder(here / "x", overwrite=True, names=["*.csv"]) as staging:
        (staging / "trials.csv").write_text("new")
    assert tree(here / "x") == {**written("old"), "trials.csv": "new"}
