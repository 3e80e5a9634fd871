"""What goes to stderr: progress, warnings, and errors in one sentence."""

from __future__ import annotations

import sys
import traceback
from dataclasses import dataclass
from typing import Annotated

import typer


@dataclass
class Console:
    """How much one command says on stderr; set by `-v` and `-q` as they are read."""

    verbose: bool = False
    quiet: bool = False
    shown: str = ""

    def reset(self) -> None:
        """Back to the ordinary amount, for the next command of the same process."""
        self.verbose = self.quiet = False
        self.shown = ""

    def progress(self, message: str) -> None:
        """What is being done; silent with `-q`."""
        if not self.quiet:
            self.say(message)

    def share(self, what: str, done: float) -> None:
        """How much of something is done, from 0 to 1: one line that changes, and only on a terminal."""
        if self.quiet or not sys.stderr.isatty():
            return
        text = f"{what} {min(done, 1.0):4.0%}"
        if text != self.shown:
            print(f"\r{plain(text)}", end="", file=sys.stderr, flush=True)
        self.shown = text
        if done >= 1:
            self.end_line()

    def end_line(self) -> None:
        """Whatever comes next begins a line of its own."""
        if self.shown:
            print(file=sys.stderr, flush=True)
        self.shown = ""

    def warn(self, message: str) -> None:
        """Something a user should know; `-q` does not silence it."""
        self.say(f"warning: {message}")

    def fail(self, error: BaseException, message: str) -> None:
        """One sentence on what went wrong; where in the code only with `-v`."""
        if self.verbose:
            traceback.print_exception(error, file=sys.stderr)
        self.say(f"treereg: {message}" if message.endswith((".", "?")) else f"treereg: {message}.")

    def say(self, message: str) -> None:
        """One line on stderr."""
        self.end_line()
        print(plain(message), file=sys.stderr, flush=True)


def plain(message: str) -> str:
    """A text in which what a terminal would obey (line ends, escapes in a name) is shown, not carried out."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)


console = Console()


def _set_verbose(value: bool) -> None:
    console.verbose = value


def _set_quiet(value: bool) -> None:
    console.quiet = value


Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", "-v", callback=_set_verbose, is_eager=True, help="Say where an error arose, with traceback."
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", callback=_set_quiet, is_eager=True, help="No progress on stderr.")
]
