"""The command line: ``rotorid analyze | report | inspect | plot | export | frequency | tune | prove | serve ...``.

Commands stand in files by what they are for; heavy packages are imported inside the commands, so that help and usage
errors come at once.
"""

import logging
import os
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.completion import install_callback, show_callback
from typer.core import TyperCommand, TyperGroup, TyperOption

from pipeline.execution.machine import collect_seldom
from rotorid.cli.analyze import analyze
from rotorid.cli.craft import bench, bifilar, craft
from rotorid.cli.look import export, inspect, plot
from rotorid.cli.output import INTERRUPTED, NOT_POSSIBLE, OK, SOME_FAILED, WRONG_USAGE, fail, guard_terminal
from rotorid.cli.reporting import compare, report, schema
from rotorid.cli.serve import backup, mcp, restore, serve, tokens, worker
from rotorid.cli.simulate import simulate
from rotorid.cli.tune import design, frequency, prove, tune
from rotorid.cli.values import AsGiven, in_words


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


class Commands(Group):
    """All commands, listed by what they are for."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list for each purpose."""
        ours = {command.__name__: purpose for purpose, own in _COMMANDS.items() for command in own}
        for purpose in _COMMANDS:
            names = [name for name in self.list_commands(ctx) if ours.get(name, "Serve") == purpose]
            with formatter.section(purpose):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(80)) for name in names])


class Command(TyperCommand):
    """A command that imports Pydantic only for options whose values must be converted."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Convert what the command line gives."""
        for parameter in self.get_params(ctx):
            AsGiven.serve(parameter)
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="rotorid",
    cls=Commands,
    help="From Pixhawk/ArduPilot flight logs to models of the craft, with a report that says what they are worth.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Help as plain text: to draw boxes around it, Rich would take longer to import than help may take to come.
    rich_markup_mode=None,
    # Our own options below: Typer's have no default, for which it imports Pydantic whatever the command.
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

#: Commands in the order in which people use them, by what they are for; each with what it does in so few words that a
#: narrow terminal shows them all.
_COMMANDS: dict[str, dict[Callable[..., object], str]] = {
    "Analyse": {
        analyze: "Logs to trajectories, models and a report.",
        report: "Show a report made before, or open its page.",
        compare: "What changed between two reports.",
    },
    "Look": {
        inspect: "Show what happened in a log and what is in it.",
        plot: "Plot any fields of a log over time.",
        export: "Write messages and tables as files for other programs.",
    },
    "Tune": {
        tune: "Gains that the flights support, or why none.",
        prove: "Predicted against measured after a change of gains.",
        design: "What to fly next, as files for the autopilot.",
        frequency: "Frequency responses and rate dynamics.",
    },
    "Know a craft": {
        craft: "Physical parameters of a craft by every method.",
        bench: "Thrust and torque coefficients from a thrust stand.",
        bifilar: "Moment of inertia from a bifilar pendulum.",
        simulate: "Fly a case of the papers, or run models.json.",
    },
    "Serve": {
        serve: "Start the web service.",
        worker: "Analyse for a service on another computer.",
        backup: "Write a whole service into one file.",
        restore: "Bring such a file back.",
        mcp: "Answer an assistant's questions about flights.",
        schema: "JSON Schema of report.json or models.json.",
    },
}
for _commands in _COMMANDS.values():
    for _command, _summary in _commands.items():
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
        from logparse import MissingDataError, RotoridError
        from pipeline.config import ConfigError

        # A log that was read and lacks what is asked of it is no failure.
        statuses = {ConfigError: WRONG_USAGE, MissingDataError: NOT_POSSIBLE, RotoridError: SOME_FAILED}
        for kind, status in statuses.items():
            if isinstance(error, kind):
                fail(str(error), status)
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
