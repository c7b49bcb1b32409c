"""Registration of commands in the typer app.

Every command gets the options --json and --quiet, examples and exit codes in its help text, and anser's messages for
invalid option values.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer
from pydantic import ValidationError
from rich.markup import escape
from typer.core import TyperCommand

from anser.cli.console import InputError, output, print_problem
from anser.cli.process import INTERRUPTED, interrupts
from anser.config.validation_messages import conversion_hint

_KINDS = {"float": "a number", "int": "a whole number", "bool": "true or false"}
_UNITS = {"_deg_s": "deg/s", "_m_s": "m/s", "_deg": "deg", "_s": "s", "_m": "m"}
"""Units of parameters by the suffix of the parameter's name, longest suffix first."""
COMMAND_IMPLIED = "anser.implied"
"""Key in the context of a group's default command; set if the command's name was omitted on the command line."""


class PlainCommand(TyperCommand):
    """Command that reports invalid option values with anser's messages."""

    def get_usage(self, ctx: Any) -> str:
        """Return the usage text; the command's name is left out if the command line omits the name."""
        usage = super().get_usage(ctx)
        return usage.replace(f" {self.name} ", " ", 1) if ctx.meta.get(COMMAND_IMPLIED) else usage

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options; raises InputError if an option's value is not valid."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            cause = error.__cause__
            if not isinstance(cause, ValidationError) or error.param is None:
                raise
            raise InputError(_refusal_message(error.param, cause)) from None


def _refusal_message(parameter: Any, error: ValidationError) -> str:
    detail = error.errors(include_url=False)[0]
    kind, context, value = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "value_error":
        expected = str(context["error"]).removeprefix(f"{value!r} is not ").rstrip(".")
    else:
        expected = _KINDS.get(kind.split("_")[0], detail["msg"])
    bounds = {"ge": "{} or more", "gt": "more than {}", "le": "{} or less", "lt": "less than {}"}
    bound_texts = [phrase.format(f"{context[key]:g}") for key, phrase in bounds.items() if key in context]
    expected = bound_texts[0] if bound_texts else expected
    unit = next((unit for end, unit in _UNITS.items() if parameter.name.endswith(end)), None)
    if kind == "float_parsing" and unit is not None:
        expected = f"{expected}, in {unit}{conversion_hint(str(value), unit)}"
    option = parameter.opts[-1] if parameter.param_type_name == "option" else parameter.name.upper()
    return f"{option}: arrived {value!r}; expected {expected}"


_Function = TypeVar("_Function", bound=Callable[..., None])
_EPILOG = "anser_epilog"

_Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document instead of tables and lines, nothing else beside it.")
]
_Quiet = Annotated[
    bool, typer.Option("--quiet", help="Print only what is wrong (and the document of --json); no progress.")
]


def help_epilog(*examples: str, unmet: str | None = None) -> Callable[[_Function], _Function]:
    """Return a decorator that adds examples and exit codes to a command; `unmet` is the meaning of code 1, if any."""
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
    """Register a function decorated with `help_epilog` as a command, with the options --json and --quiet.

    The function must print with `print_line`, `print_table`, `print_note` and `print_problem`, and must call
    `print_document` once.
    """

    @functools.wraps(command)
    def run_command(*, anser_json: bool, anser_quiet: bool, **options: Any) -> None:
        try:
            with output(anser_json, anser_quiet):
                command(**options)
        except KeyboardInterrupt:
            if interrupts.arrived:  # reported at the end of the process
                raise
            print_problem("stopped")
            raise typer.Exit(INTERRUPTED) from None

    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for name, annotation in (("anser_json", _Json), ("anser_quiet", _Quiet))
    ]
    command_parameters = inspect.signature(command, eval_str=True).parameters.values()
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in command_parameters] + common
    # typer reads the signature and the annotations
    run_command.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    run_command.__annotations__ = {p.name: p.annotation for p in parameters}
    name = command.__name__.strip("_").replace("_", "-")
    app.command(name, cls=PlainCommand, epilog=getattr(command, _EPILOG))(run_command)
