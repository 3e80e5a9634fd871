"""The commands in one application, and what becomes of their errors."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import Annotated

import typer

from treereg_core.cli.apply import apply
from treereg_core.cli.batch import batch
from treereg_core.cli.check import check
from treereg_core.cli.console import console
from treereg_core.cli.evaluate import evaluate
from treereg_core.cli.help import Command, Commands, examples
from treereg_core.cli.methods import methods
from treereg_core.cli.misregister import misregister
from treereg_core.cli.report import report
from treereg_core.cli.rows import rows
from treereg_core.cli.run import run
from treereg_core.cli.series import series
from treereg_core.cli.simulate import simulate
from treereg_core.cli.streams import Unprinted, abandon_stdout, printing
from treereg_core.errors import TreeregError

app = typer.Typer(
    name="treereg",
    help="Lays one drone survey of an orchard exactly over another, tree on tree, and says when it cannot.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    invoke_without_command=True,
    cls=Commands,
    epilog=examples(""),
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"treereg {metadata.version('treereg')}")
        raise typer.Exit


@app.callback()
def _treereg(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Lays one drone survey of an orchard exactly over another, tree on tree, and says when it cannot."""
    if context.invoked_subcommand is None:
        print(context.get_help())


for _command, _words in (
    (run, "Register one survey folder onto another."),
    (apply, "Move files of the source survey by a transform that was found."),
    (methods, "List what is installed, or the settings of one method."),
    (check, "Run the contract's laws on a method or a plugin."),
    (rows, "Find and number the planting rows of one survey."),
    (report, "Make the page of a run again."),
    (series, "Register surveys of one orchard over time, and follow every tree."),
    (batch, "Register many orchards, on this machine or on a Dask cluster."),
    (evaluate, "Compare methods on the same trials with known misplacements."),
    (misregister, "Copy a survey folder, turned and shifted by a known transform."),
    (simulate, "Make two survey folders whose truth is known."),
):
    app.command(short_help=_words, cls=Command, epilog=examples(_command.__name__))(_command)


def carry_out(arguments: Sequence[str] | None) -> int:
    """Carry out one command and give its exit code; every error becomes one sentence on stderr."""
    console.reset()
    if isinstance(sys.stdout, io.TextIOWrapper):  # a letter that the terminal does not know must not end a run
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.platform == "win32":
        import colorama

        colorama.just_fix_windows_console()
    try:
        code = app(args=arguments, prog_name="treereg", standalone_mode=False)
        with printing():
            sys.stdout.flush()
        return code or 0
    except TreeregError as error:
        console.fail(error, str(error))
        return 2
    except typer.TyperException as error:
        console.fail(error, usage_sentence(error))
        return 2
    except typer.Abort:
        return 130
    except Unprinted as error:
        console.fail(error, str(error))
        return 1
    except BrokenPipeError:  # nobody reads stdout any more
        abandon_stdout()
        return 1
    except OSError as error:
        console.fail(error, f"the system refused ({error.strerror or error}); mend that and run it again")
        return 1
    except Exception as error:
        text = " ".join(str(error).split()) or "no message"
        console.fail(error, f"a fault of treereg or a plugin, please report it ({type(error).__name__}: {text})")
        return 1
    finally:
        console.end_bar()


def usage_sentence(error: typer.TyperException) -> str:
    """What is wrong with the command line, and which help or file tells more."""
    message = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    parameter = getattr(error, "param", None)
    message = message.replace(". Did you", "; did you")
    near = getattr(error, "possibilities", None)
    if near:
        return f"{message.partition(' (')[0]}; did you mean {near[0]!r}?"
    if context is None or message.endswith("?"):
        return message
    if parameter is not None and parameter.name in (context.default_map or {}):
        source = context.get_parameter_source(parameter.name)
        if source is not None and source.name == "DEFAULT_MAP":
            return f"{context.params.get('config')}: {message}"
    return f"{message.rstrip('.')}; see '{context.command_path} --help'"
