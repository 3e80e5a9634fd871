"""What commands say: progress, warnings and errors on stderr, results on stdout, each as fits what it is read on."""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Annotated

import typer

from treereg_core.cli.streams import printing

if TYPE_CHECKING:
    from treereg_core.cli.bar import Bar

COLOUR = re.compile(r"(\x1b\[[0-9;]*m)")
"""What paints a terminal, and does nothing else to it."""
EVERY_S = 5.0
"""How often a count is told where no bar can show it, seconds."""


@dataclass
class Console:
    """How much one command says on stderr; set by `-v` and `-q` as they are read.

    On a terminal one bar at the foot shows what is being done; it goes away at the end. Elsewhere each thing that is
    begun is a line, as is a count now and then.
    """

    verbose: bool = False
    quiet: bool = False
    items: int = 0
    finished: int = 0
    _bar: Bar | None = None
    _begun_at: float = 0.0
    _told_at: float = 0.0

    def reset(self) -> None:
        """Back to the ordinary amount, for the next command of the same process."""
        self.end_bar()
        self.verbose = self.quiet = False
        self.items = self.finished = 0

    def progress(self, message: str) -> None:
        """What is being done; silent with `-q`."""
        if self.quiet:
            return
        if interactive(sys.stderr):
            self._draw("", message, self.finished / self.items if self.items else None)
        else:
            self.say(message)

    def note(self, message: str) -> None:
        """What was done, which stays to be read; silent with `-q`."""
        if not self.quiet:
            self.say(message)

    def share(self, what: str, done: float) -> None:
        """How much of something is done, from 0 to 1; only on a terminal."""
        if not self.quiet and interactive(sys.stderr):
            self._draw(what, what, min(done, 1.0))

    def count(self, what: str, done: int, total: int) -> None:
        """How many are done of work in many equal parts, told with none done first; with the time left."""
        now = time.monotonic()
        text = f"{what}: {done} of {total}"
        if not done:
            self._begun_at = self._told_at = now
        if interactive(sys.stderr) and not self.quiet:
            self._draw(what, text, done / total if total else 1.0)
        elif done and (done == total or now - self._told_at >= EVERY_S):
            self._told_at = now
            self.progress(f"{text}, {in_words((now - self._begun_at) / done * (total - done))} left")
        if done == total:
            self.end_bar()

    def _draw(self, kind: str, message: str, done: float | None) -> None:
        if self._bar is None:
            from treereg_core.cli.bar import Bar

            self._bar = Bar(plain(message))
            self._bar.start()
        self._bar.show(kind, plain(message), done)

    def end_bar(self) -> None:
        """Take the bar away, so that whatever comes next begins a line of its own."""
        if self._bar is not None:
            self._bar.stop()
        self._bar = None

    def warn(self, message: str) -> None:
        """Something a user should know; `-q` does not silence it."""
        self.say(message, ("warning:", "yellow"))

    def fail(self, error: BaseException, message: str) -> None:
        """One sentence on what went wrong; where in the code only with `-v`."""
        self.end_bar()
        if self.verbose:
            for line in "".join(traceback.format_exception(error)).splitlines():
                print(plain(line), file=sys.stderr)
        self.say(message if message.endswith((".", "?")) else f"{message}.", ("treereg:", "red"))

    def say(self, message: str, head: tuple[str, str] | None = None) -> None:
        """One line on stderr, behind a word in a colour where there is one."""
        self.end_bar()
        start = f"{painted(*head, stream=sys.stderr)} " if head else ""
        with suppress(OSError):  # where nobody can be told, the work goes on
            print(start + plain(message), file=sys.stderr, flush=True)

    def show(self, text: str) -> None:
        """The result for people, on stdout."""
        self.end_bar()
        with printing():
            for line in text.split("\n"):
                print("".join(part if COLOUR.fullmatch(part) else plain(part) for part in COLOUR.split(line)))

    def hand_over(self, document: bytes) -> None:
        """The result for programs, on stdout, just these bytes."""
        self.end_bar()
        with printing():
            typer.echo(document, nl=False)


def in_words(seconds: float) -> str:
    """A time that is still to come, in the unit that a person would use."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def interactive(stream: IO[str]) -> bool:
    """Whether a stream is a terminal on which something can be drawn again."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def coloured(stream: IO[str]) -> bool:
    """Whether a stream takes colours: never with NO_COLOR, always with FORCE_COLOR, else on a terminal."""
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or interactive(stream)


def painted(text: str, colour: str, stream: IO[str] | None = None) -> str:
    """A text in a colour, where the stream takes them; the stream is stdout unless said otherwise."""
    return typer.style(text, fg=colour, bold=True) if coloured(stream or sys.stdout) else text


def width(indent: int = 0) -> int | None:
    """How many columns stdout has beside an indent; None where it is no terminal, and lines may be of any length."""
    return shutil.get_terminal_size().columns - indent if sys.stdout.isatty() else None


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
