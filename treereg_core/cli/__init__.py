"""The command line, one file per command.

Exit codes: 0 done, 1 a failure on our side, 2 bad usage or input, 3 worked but not accepted, 130 interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command line and give its exit code; an interruption while modules load is one too."""
    try:
        from treereg_core.cli.app import carry_out

        return carry_out(arguments)
    except KeyboardInterrupt:
        return 130
