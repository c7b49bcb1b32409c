"""Registration of commands in the typer app.

--json and --quiet for every command, examples and exit codes in its help, and refusals of option values in anser's
own form.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
from pydantic import ValidationError
from rich.markup import escape
from typer.core import TyperCommand

from anser.cli.console import RefusedError, output, print_problem
from anser.cli.process import INTERRUPTED, interrupts
from anser.config.validation_messages import conversion_hint

_KINDS = {"float": "a number", "int": "a whole number", "bool": "true or false"}
_UNITS = {"_deg_s": "deg/s", "_m_s": "m/s", "_deg": "deg", "_s": "s", "_m": "m"}
"""Units by the ends of the names that parameters have, the longest first."""
COMMAND_IMPLIED = "anser.implied"
"""Among what a context knows: the command was not named, but meant."""


class PlainCommand(TyperCommand):
    """A command whose options answer a value that they cannot read in the words of anser."""

    def get_usage(self, ctx: Any) -> str:
        """Usage without the command's name where nobody wrote it."""
        usage = super().get_usage(ctx)
        return usage.replace(f" {self.name} ", " ", 1) if ctx.meta.get(COMMAND_IMPLIED) else usage

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options; raises RefusedError with the option, what arrived and what would be right."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            cause = error.__cause__
            if not isinstance(cause, ValidationError) or error.param is None:
                raise
            raise RefusedError(_refusal_message(error.param, cause)) from None


def _refusal_message(parameter: Any, error: ValidationError) -> str:
    detail = error.errors(include_url=False)[0]
    kind, context, value = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "value_error":
        words = str(context["error"]).removeprefix(f"{value!r} is not ").rstrip(".")
    else:
        words = _KINDS.get(kind.split("_")[0], detail["msg"])
    bounds = {"ge": "{} or more", "gt": "more than {}", "le": "{} or less", "lt": "less than {}"}
    found = [phrase.format(f"{context[key]:g}") for key, phrase in bounds.items() if key in context]
    words = found[0] if found else words
    unit = next((unit for end, unit in _UNITS.items() if parameter.name.endswith(end)), None)
    if kind == "float_parsing" and unit is not None:
        words = f"{words}, in {unit}{conversion_hint(str(value), unit)}"
    option = parameter.opts[-1] if parameter.param_type_name == "option" else parameter.name.upper()
    return f"{option}: arrived {value!r}; expected {words}"


_Function = TypeVar("_Function", bound=Callable[..., None])
_EPILOG = "anser_epilog"

_Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document instead of tables and lines, nothing else beside it.")
]
_Quiet = Annotated[
    bool, typer.Option("--quiet", help="Print only what is wrong (and the document of --json); no progress.")
]


def help_epilog(*examples: str, unmet: str | None = None) -> Callable[[_Function], _Function]:
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


def register_command(app: typer.Typer, command: Callable[..., None]) -> None:
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
            print_problem("stopped")
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
