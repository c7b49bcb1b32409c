"""Values of options and arguments that cannot be read, told as anser tells what is wrong with a scenario."""

from typing import Any

import typer
from pydantic import ValidationError
from typer.core import TyperCommand

from anser.cli.console import RefusedError
from anser.scenario.other_units import in_unit

_KINDS = {"float": "a number", "int": "a whole number", "bool": "true or false"}
_UNITS = {"_deg_s": "deg/s", "_m_s": "m/s", "_deg": "deg", "_s": "s", "_m": "m"}
"""Units by the ends of the names that parameters have, the longest first."""
IMPLIED = "anser.implied"
"""Among what a context knows: the command was not named, but meant."""


class PlainCommand(TyperCommand):
    """A command whose options answer a value that they cannot read in the words of anser."""

    def get_usage(self, ctx: Any) -> str:
        """Usage without the command's name where nobody wrote it."""
        usage = super().get_usage(ctx)
        return usage.replace(f" {self.name} ", " ", 1) if ctx.meta.get(IMPLIED) else usage

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options; raises RefusedError with the option, what arrived and what would be right."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            cause = error.__cause__
            if not isinstance(cause, ValidationError) or error.param is None:
                raise
            raise RefusedError(_told(error.param, cause)) from None


def _told(parameter: Any, error: ValidationError) -> str:
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
        words = f"{words}, in {unit}{in_unit(str(value), unit)}"
    option = parameter.opts[-1] if parameter.param_type_name == "option" else parameter.name.upper()
    return f"{option}: arrived {value!r}; expected {words}"
