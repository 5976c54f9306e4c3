"""The command line: ``rotorid analyze | report | inspect | plot | export | frequency | tune | prove | serve ...``.

Each command is a file in `rotorid.cli`; heavy packages are imported inside the commands, so that help and usage
errors come at once.
"""

import logging
import os
import sys
from collections.abc import Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.completion import install_callback, show_callback
from typer.core import TyperCommand, TyperGroup, TyperOption

from pipeline.execution.memory import collect_seldom
from rotorid.cli.analyze import analyze
from rotorid.cli.as_given import AsGiven
from rotorid.cli.backup import backup, restore
from rotorid.cli.bench import bench
from rotorid.cli.bifilar import bifilar
from rotorid.cli.compare import compare
from rotorid.cli.craft import craft
from rotorid.cli.design import design
from rotorid.cli.exits import INTERRUPTED, OK, SOME_FAILED, WRONG_USAGE, fail
from rotorid.cli.export import export
from rotorid.cli.frequency import frequency
from rotorid.cli.inspect import inspect
from rotorid.cli.mcp import mcp
from rotorid.cli.output import guard_terminal
from rotorid.cli.plot import plot
from rotorid.cli.prove import prove
from rotorid.cli.report import report
from rotorid.cli.schema import schema
from rotorid.cli.serve import serve
from rotorid.cli.simulate import simulate
from rotorid.cli.token import tokens
from rotorid.cli.tune import tune
from rotorid.cli.wording import in_words
from rotorid.cli.worker import worker


class Group(TyperGroup):
    """Commands whose help comes at once.

    Typer's own ``--help`` has no default: where it is not given, as before a command, Pydantic is imported to find that
    nothing is of the right type.
    """

    def get_help_option(self, ctx: Any) -> TyperOption | None:
        """Return the option, not asked for unless it is given."""
        option = super().get_help_option(ctx)
        if option is not None:
            option.default = False
        return option

    def invoke(self, ctx: Any) -> Any:
        """Run a command; what is wrong with a value is said in words of the field."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = in_words(error) or error.message
            raise


class Command(TyperCommand):
    """A command that imports Pydantic only for options whose values must be converted."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Convert what the command line gives."""
        for parameter in self.get_params(ctx):
            AsGiven.serve(parameter)
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="rotorid",
    cls=Group,
    help="From Pixhawk/ArduPilot flight logs to models of the craft, with a report that says what they are worth.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Help as plain text: to draw boxes around it, Rich would take longer to import than help may take to come.
    rich_markup_mode=None,
    # Our own options below: Typer's have no default, for which it imports Pydantic whatever the command.
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# In the order in which people use them, which is the order of the help; each with what it does in so few words that a
# narrow terminal shows them all.
for _command, _summary in (
    (analyze, "Logs to trajectories, models and a report."),
    (report, "Show a report made before, or open its page."),
    (compare, "What changed between two reports."),
    (inspect, "Show what is in a log and what to log better."),
    (plot, "Plot any fields of a log over time."),
    (export, "Write messages and tables as files for other programs."),
    (frequency, "Frequency responses and rate dynamics, from chirps or flying."),
    (craft, "Physical parameters of a craft by every method."),
    (bench, "Thrust and torque coefficients from a thrust stand."),
    (bifilar, "Moment of inertia from a bifilar pendulum."),
    (tune, "Gains that the flights support, or why none."),
    (design, "What to fly next, as files for the autopilot."),
    (prove, "Predicted against measured after a change of gains."),
    (simulate, "Fly a case of the papers, or run models.json."),
    (schema, "JSON Schema of report.json or models.json."),
    (serve, "Start the web service."),
    (backup, "Write a whole service into one file."),
    (restore, "Bring such a file back."),
    (worker, "Analyse for a service on another computer."),
    (mcp, "Answer an assistant's questions about flights."),
):
    app.command(cls=Command, short_help=_summary)(_command)
app.add_typer(tokens, cls=Group, short_help="Make, list and revoke the service's tokens.")


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line; whatever happens, the user reads a sentence and not a traceback.

    `arguments` are those of the process unless they are given.
    """
    # Our matrices are small: more BLAS threads than one only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    collect_seldom()
    guard_terminal()
    debug = bool(os.environ.get("ROTORID_DEBUG"))
    logging.basicConfig(level=logging.DEBUG if debug else logging.CRITICAL, stream=sys.stderr)
    try:
        app(arguments)
    except BrokenPipeError:
        # Whoever read our output has seen enough; nothing may be written at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(SOME_FAILED)
    except OSError as error:
        fail(f"{error.filename or 'output'}: {error.strerror or error}", SOME_FAILED)
    except KeyboardInterrupt:
        fail("interrupted", INTERRUPTED)
    except Exception as error:
        from logparse import RotoridError
        from pipeline.errors import ConfigError

        if isinstance(error, RotoridError):
            fail(str(error), WRONG_USAGE if isinstance(error, ConfigError) else SOME_FAILED)
        if debug:
            raise
        fail(
            f"unexpected {type(error).__name__}: {error}. This is a bug in rotorid; please report it "
            "(ROTORID_DEBUG=1 shows where it happened).",
            SOME_FAILED,
        )
    sys.exit(OK)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"rotorid {version('rotorid')}")
        raise typer.Exit


@app.callback()
def rotorid(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    _install: Annotated[
        bool,
        typer.Option(
            "--install-completion", callback=install_callback, help="Let the current shell complete commands."
        ),
    ] = False,
    _show: Annotated[
        bool,
        typer.Option("--show-completion", callback=show_callback, help="Show what that would add to the shell."),
    ] = False,
) -> None:
    """From Pixhawk/ArduPilot flight logs to models of the craft, with a report that says what they are worth."""
