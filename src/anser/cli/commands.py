"""All commands, and the exit code of the one that was called."""

import gc
import os
import traceback
from typing import Annotated

import typer

import anser
from anser.cli import airframes
from anser.cli.caching import cache
from anser.cli.campaign_answers import compare
from anser.cli.campaign_answers import report as report_campaign
from anser.cli.campaigning import fly
from anser.cli.console import RefusedError, problem
from anser.cli.deep_stalling import deep_stall
from anser.cli.flights import plan, run
from anser.cli.grouping import offer_group
from anser.cli.interrupts import interrupts
from anser.cli.margins import margins
from anser.cli.offering import offer
from anser.cli.rare_events import rare
from anser.cli.reporting import export, figures, report
from anser.cli.scenario_files import check, convert, new, schema
from anser.cli.stepping import gallery, step
from anser.cli.surveying import envelope, robustness
from anser.cli.sweeping import sweep
from anser.cli.trimming import linearize, trim
from anser.cli.verifying import verify
from anser.scenario import ScenarioError

app = typer.Typer(
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    pretty_exceptions_enable=False,
    help="Fleets of fixed-wing aircraft that must be at moving places at the same time. Civil simulation only.",
    epilog="First steps:\n  anser new mine.toml\n  anser check mine.toml\n  anser run mine.toml\n\n"
    "anser COMMAND --help shows examples and exit codes; anser --install-completion teaches the shell the commands.",
)


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False) -> None:
    if version:
        typer.echo(f"anser {anser.__version__}")
        raise typer.Exit


for _command in (
    run,
    plan,
    sweep,
    rare,
    check,
    trim,
    linearize,
    deep_stall,
    step,
    gallery,
    envelope,
    margins,
    robustness,
    verify,
    report,
    export,
    figures,
    new,
    convert,
    schema,
    cache,
):
    offer(app, _command)
offer_group(
    app,
    "campaign",
    (fly, report_campaign, compare),
    "Fly a study, a scenario many times with its numbers dispersed; report on the flights; compare two campaigns.",
    (
        "anser campaign studies/how-surely.toml --out runs/how-surely",
        "anser campaign report runs/how-surely",
        "anser campaign compare runs/how-surely runs/windier",
    ),
)
offer_group(
    app,
    "aircraft",
    (airframes.show, airframes.list_, airframes.check, airframes.new),
    "Show an airframe; list those there are; check an aircraft file; write one to start from.",
    (
        "anser aircraft list",
        "anser aircraft show aerosonde --out aerosonde.png",
        "anser aircraft new my-uav.toml",
        "anser aircraft check my-uav.toml",
    ),
)


def exit_code() -> int:
    """Run the command of the command line; return its exit code.

    A file or folder that the system does not read or write is told in one message, as bad input is.
    """
    gc.set_threshold(200_000)  # tracing makes many small objects that live: collecting them again and again takes 10 %
    try:
        app()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception as error:
        if interrupts.arrived:  # what a library made of Ctrl-C
            raise
        if isinstance(error, ScenarioError | RefusedError):
            problem(str(error))
            return 2
        if isinstance(error, OSError):
            problem(_system_refusal(error))
            return 2
        traceback.print_exc()
        problem("internal fault of anser: please report the lines above together with the scenario")
        return 3
    return 0


def _system_refusal(error: OSError) -> str:
    """Message for a file, folder or connection that the system refused."""
    if error.filename is None:
        return f"arrived a refusal of the system ({error}); expected files and folders that can be read and written"
    name = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes | os.PathLike) else error.filename
    return f"{name}: arrived a file or folder that the system refuses ({error.strerror}); expected one that it takes"
