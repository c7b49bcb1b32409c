"""All commands and command groups of `anser`, and the exit code of the process.

A group runs its first command if the command line names none: `anser campaign STUDY`.
"""

import difflib
import os
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

from anser.cli import airframes
from anser.cli.app import COMMAND_IMPLIED, register_command
from anser.cli.cache import cache
from anser.cli.campaigns import compare, fly, rare
from anser.cli.campaigns import report as report_campaign
from anser.cli.console import InputError, print_problem
from anser.cli.flights import demo, plan, run
from anser.cli.identify import identify
from anser.cli.live import live
from anser.cli.margins import margins
from anser.cli.process import interrupts
from anser.cli.reports import export, figures, report
from anser.cli.scenario_files import check, convert, new, schema
from anser.cli.simulate import simulate
from anser.cli.steady_flight import deep_stall, linearize, trim
from anser.cli.step_tests import gallery, step
from anser.cli.surveys import envelope, robustness
from anser.cli.sweeps import sweep
from anser.cli.verification import verify
from anser.config.errors import ScenarioError
from anser.version import source_version


class DefaultCommandGroup(TyperGroup):
    """Command group that runs its first command if the command line names none.

    A first word that resembles a command's name, and is not an existing file, is reported as a misspelt command.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, after the default command has been inserted if no command is named."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            close = difflib.get_close_matches(args[0], self.commands)
            if not close or Path(args[0]).exists():
                args = [next(iter(self.commands)), *args]
                ctx.meta[COMMAND_IMPLIED] = True
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Return the completions of command names, and of the default command's first argument."""
        default_command = next(iter(self.commands.values()))
        completions = super().shell_complete(ctx, incomplete)
        argument = next((p for p in default_command.params if p.param_type_name == "argument"), None)
        return (
            completions
            if argument is None or incomplete.startswith("-")
            else completions + argument.shell_complete(ctx, incomplete)
        )


def register_group(
    app: typer.Typer, name: str, commands: Sequence[Callable[..., None]], summary: str, examples: Sequence[str]
) -> None:
    """Register commands (see `help_epilog`) as a group, the first as default; the help has `summary` and `examples`."""
    hint = f"anser {name} COMMAND --help shows the options and exit codes of one."
    lines = "\n".join(["Examples:", *(f"  {example}" for example in examples), "", hint])
    group = typer.Typer(cls=DefaultCommandGroup, no_args_is_help=True, help=summary, epilog=escape(lines))
    for command in commands:
        register_command(group, command)
    app.add_typer(group, name=name)


app = typer.Typer(
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
    pretty_exceptions_enable=False,
    help="Fleets of fixed-wing aircraft that must be at moving places at the same time. Civil simulation only.",
    epilog="First steps:\n  anser demo\n  anser new mine.toml\n  anser check mine.toml\n  anser run mine.toml\n\n"
    "anser COMMAND --help shows examples and exit codes; anser --install-completion teaches the shell the commands.",
)


@app.callback(invoke_without_command=True)
def _top(
    version: Annotated[bool, typer.Option("--version", help="Print version and commit, and stop.")] = False,
) -> None:
    if version:
        source = source_version()
        typer.echo(f"anser {source.version} (commit {source.commit})")
        raise typer.Exit


for _command in (
    demo,
    live,
    run,
    plan,
    sweep,
    rare,
    check,
    trim,
    simulate,
    identify,
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
    register_command(app, _command)
register_group(
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
register_group(
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
    """Run the command of the command line and return its exit code.

    Invalid input (`InputError`, `ScenarioError`) and errors of the operating system are printed as a message, with code
    2. Any other exception is printed with its traceback, with code 3.
    """
    try:
        app()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception as error:
        if interrupts.arrived:  # exception of a library after Ctrl-C
            raise
        if isinstance(error, ScenarioError | InputError):
            print_problem(str(error))
            return 2
        if isinstance(error, OSError):
            print_problem(_system_refusal(error))
            return 2
        traceback.print_exc()
        print_problem("internal fault of anser: please report the lines above together with the scenario")
        return 3
    return 0


def _system_refusal(error: OSError) -> str:
    """Return the message for an operating-system error about a file or folder."""
    if error.filename is None:
        return f"arrived a refusal of the system ({error}); expected files and folders that can be read and written"
    name = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes | os.PathLike) else error.filename
    return f"{name}: arrived a file or folder that the system refuses ({error.strerror}); expected one that it takes"
