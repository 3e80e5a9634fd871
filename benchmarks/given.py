"""Trials in files that `benchmarks.accuracy --out` or `treereg evaluate` wrote."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from treereg_core.errors import UsageError
from treereg_core.evaluation import Trial
from treereg_core.evaluation.log import read


def read_trials(paths: Iterable[Path]) -> list[Trial]:
    """All trials in these files. `UsageError` for a file that cannot be read or holds something else."""
    trials: list[Trial] = []
    for path in paths:
        try:
            trials += read(path)[1]
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}; give a file of trials from accuracy --out.") from None
    return trials


def trials_given(program: str, description: str | None) -> list[Trial]:
    """The trials in the files on the command line of a benchmark; leaves with code 2 when one cannot be read."""
    parser = argparse.ArgumentParser(
        program, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE.csv", help="trials from benchmarks.accuracy --out")
    try:
        return read_trials(parser.parse_args().files)
    except UsageError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
