"""The commands put together, and what becomes of their errors."""

import sys
from collections.abc import Sequence
from importlib.util import find_spec

import typer
from typer import TyperException

import lab
from lab.cli.check import check
from lab.cli.compare import compare
from lab.cli.ekf_slam import ekf_slam
from lab.cli.forecast import forecast
from lab.cli.output import RunError, Stopped
from lab.cli.release import release
from lab.cli.run import run
from lab.cli.simulate import simulate
from lab.errors import InputError

FAILED, MISUSED, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    name="slam-lab",
    help="A toy SLAM laboratory: how many particles buy how much accuracy?",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(simulate)
app.command()(run)
app.command()(compare)
app.command()(forecast)
app.command()(ekf_slam)
app.command()(check)
if find_spec("lab.release"):  # the students' copy of the laboratory has none
    app.command()(release)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"slam-lab {lab.__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Compare particle filters with the exact Kalman filter on a toy SLAM problem."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), nl=False)
        raise typer.Exit(MISUSED)


def execute(arguments: Sequence[str] | None) -> tuple[int, str]:
    """Run a command.

    Returns
    -------
    status : int
        For the process to leave with.
    message : str
        What the person who typed the command got wrong, in one sentence; empty when nothing.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C, from the keyboard or from a solver.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal cannot show is no reason to stop
    status = MISUSED
    try:
        status = app(arguments, prog_name="slam-lab", standalone_mode=False) or 0
        if status == INTERRUPTED:  # typer swallows what caused it
            raise KeyboardInterrupt
        return status, ""
    except InputError as error:
        message = str(error)
    except RunError as error:
        message, status = str(error), FAILED
    except Stopped as error:
        message, status = str(error), INTERRUPTED
    except TyperException as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
    except OSError as error:
        message = f"{error.filename or 'The output'} cannot be written: {error.strerror or error}."
    return status, f"{message.rstrip('.')}."
