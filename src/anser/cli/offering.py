"""What every command has in common: --json, --quiet, examples and exit codes in its help, an end by Ctrl-C."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
from rich.markup import escape

from anser.cli.console import output, problem
from anser.cli.interrupts import INTERRUPTED, interrupts
from anser.cli.refused_values import PlainCommand

_Function = TypeVar("_Function", bound=Callable[..., None])
_EPILOG = "anser_epilog"

_Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document instead of tables and lines, nothing else beside it.")
]
_Quiet = Annotated[
    bool, typer.Option("--quiet", help="Print only what is wrong (and the document of --json); no progress.")
]


def about(*examples: str, unmet: str | None = None) -> Callable[[_Function], _Function]:
    """Give a command what `offer` shows under the options of its help.

    Parameters
    ----------
    *examples
        Command lines as a user types them, the plainest first.
    unmet
        What exit code 1 means here; None where the command never ends with it.
    """
    codes = [
        "0  done",
        *([f"1  {unmet}"] if unmet else []),
        "2  bad input",
        "3  internal fault",
        f"{INTERRUPTED}  stopped by Ctrl-C",
    ]
    lines = ["Examples:", *examples, "", "Exit codes:", *codes]
    epilog = escape("\n".join(line if not line or line.endswith(":") else f"  {line}" for line in lines))

    def mark(function: _Function) -> _Function:
        setattr(function, _EPILOG, epilog)
        return function

    return mark


def offer(app: typer.Typer, command: Callable[..., None]) -> None:
    """Register a function marked by `about` as a command that takes --json and --quiet, too.

    The function prints its results on `screen`, its messages by `say`, what is wrong by `problem`, and calls `answer`
    once with its document; it need not know which of the options were given.
    """

    @functools.wraps(command)
    def answering(*, anser_json: bool, anser_quiet: bool, **given: Any) -> None:
        try:
            with output(anser_json, anser_quiet):
                command(**given)
        except KeyboardInterrupt:
            if interrupts.arrived:  # told where the process ends
                raise
            problem("stopped")
            raise typer.Exit(INTERRUPTED) from None

    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for name, annotation in (("anser_json", _Json), ("anser_quiet", _Quiet))
    ]
    own = inspect.signature(command, eval_str=True).parameters.values()
    parameters = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own] + common
    # What typer reads of a function: its signature and its annotations.
    answering.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    answering.__annotations__ = {one.name: one.annotation for one in parameters}
    name = command.__name__.strip("_").replace("_", "-")
    app.command(name, cls=PlainCommand, epilog=getattr(command, _EPILOG))(answering)
