"""How long the command line takes to start, against the imports that any such program would need.

python -m benchmarks.startup
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.table import table

TREEREG = str(Path(sys.executable).with_name("treereg"))
YARDSTICK = (sys.executable, "-c", "import numpy, scipy.spatial, pydantic, typer")
COMMANDS = ((TREEREG, "--help"), (TREEREG, "methods"))


def main() -> int:
    """Run all commands in turn, over and over, and print the table."""
    parser = argparse.ArgumentParser(
        "benchmarks.startup", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=15, metavar="N", help="runs of each command (default 15)")
    runs = parser.parse_args().runs
    everything = (YARDSTICK, *COMMANDS)
    for command in everything:
        seconds(command)
    taken = [[seconds(command) for command in everything] for _ in range(runs)]
    medians = [statistics.median(column) for column in zip(*taken, strict=True)]
    rows = [
        (" ".join([Path(command[0]).name, *command[1:]]), f"{median:.3f} s", f"{median / medians[0]:.2f}")
        for command, median in zip(everything, medians, strict=True)
    ]
    print(table(("command", "median", "ratio"), rows))
    return 0


def seconds(command: Sequence[str]) -> float:
    """How long one run takes. `CalledProcessError` when it fails."""
    begin = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


if __name__ == "__main__":
    sys.exit(main())
