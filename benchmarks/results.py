"""Every method from every start on every family of simulated surveys, for `docs/methods-compared.md`.

    python -m benchmarks.results --out results --seeds 30 --first-seed 800000

Runs what is missing of the trials in the folder, which `treereg evaluate` could have written, and writes the page's
tables anew between its marks; the text around them is left as it is.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.methods import tables
from benchmarks.pages import filled
from benchmarks.processes import told
from treereg_core.cli.evaluate import families_of, setups_of
from treereg_core.errors import TreeregError
from treereg_core.evaluation import Families, Study, run_all
from treereg_core.evaluation.files import evaluation_folder, write_evaluation
from treereg_core.evaluation.trial import CRASHED
from treereg_core.simulate import FAMILIES

PAGE = Path(__file__).parents[1] / "docs" / "methods-compared.md"
STARTS = ("coarse", "identity")
METHODS = (
    *("icp", "confidence+icp", "bn_landmarks+icp", "aco", "aco+icp", "aco+bn_rows", "aco+bn_rows+icp", "combined"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials that are missing and write the page."""
    options = parser().parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    try:
        source = Families(families_of(options.family or list(FAMILIES)))
        study = Study(source, setups_of({"settings": {}}, ([*METHODS, *(options.method or ())], STARTS), None), seeds)
        said = f"{len(source.names)} families; pairs of surveys of each: {len(seeds)}."
        with evaluation_folder(options.out, (), overwrite=False) as log:
            trials = run_all(study, log, options.jobs, told)
            write_evaluation(study, [said], trials, log)
    except TreeregError as error:
        print(error, file=sys.stderr)
        return 2
    text = f"```\n{command(options)}\n```\n\n{said}\n\n{tables(trials)}"
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), {"results": text}), encoding="utf-8")
    return 1 if any(trial.verdict == CRASHED for trial in trials) else 0


def command(options: argparse.Namespace) -> str:
    """What makes these tables anywhere."""
    words = ["--out", "results", "--seeds", str(options.seeds), "--first-seed", str(options.first_seed)]
    for name in ("family", "method"):
        words += [word for value in getattr(options, name) or () for word in (f"--{name}", value)]
    return shlex.join(["uv", "run", "python", "-m", "benchmarks.results", *words])


def parser() -> argparse.ArgumentParser:
    """The command line."""
    formatter = argparse.RawDescriptionHelpFormatter
    made = argparse.ArgumentParser(prog="python -m benchmarks.results", description=__doc__, formatter_class=formatter)
    add = made.add_argument
    add("--out", type=Path, required=True, metavar="FOLDER", help="the trials, and an evaluation of them")
    add("--seeds", type=int, default=20, metavar="N", help="pairs of surveys of each family (default 20)")
    add("--first-seed", type=int, default=0, metavar="K", help="seeds from here on (default 0)")
    add("--family", action="append", metavar="NAME", help="a family or group; repeatable; default: all")
    add("--method", action="append", metavar="EXPR", help="one more method; repeatable")
    add("--jobs", type=int, default=2, metavar="N", help="processes, one thread each (default 2)")
    return made


if __name__ == "__main__":
    sys.exit(main())
