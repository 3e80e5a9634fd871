"""The command line, one file per command.

Exit codes: 0 done, 1 a failure on our side, 2 bad usage or input, 3 worked but not accepted, 130 interrupted.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out one command line and give its exit code; an interruption while modules load is one too.

    So is a request to end (SIGTERM), as schedulers send it: a run that ends early cleans up after itself.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from treereg_core.cli.streams import open_all

        open_all()
        from treereg_core.cli.app import carry_out

        return carry_out(arguments)
    except KeyboardInterrupt:
        return 130
