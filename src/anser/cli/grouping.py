"""Commands of commands, of which one is meant where none is named: `anser campaign STUDY`, `anser campaign report`."""

import difflib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape
from typer.core import TyperGroup

from anser.cli.offering import offer
from anser.cli.refused_values import IMPLIED


class FirstUnlessNamed(TyperGroup):
    """Commands of which the first is meant where the first word names none.

    A word that names no file either and is nearly a command's stays as it is, and is answered by what was meant.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the first command's name before words that name none."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            close = difflib.get_close_matches(args[0], self.commands)
            if not close or Path(args[0]).exists():
                args = [next(iter(self.commands)), *args]
                ctx.meta[IMPLIED] = True
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Commands, and what the first one takes."""
        first = next(iter(self.commands.values()))
        found = super().shell_complete(ctx, incomplete)
        place = next((one for one in first.params if one.param_type_name == "argument"), None)
        return found if place is None or incomplete.startswith("-") else found + place.shell_complete(ctx, incomplete)


def offer_group(
    app: typer.Typer, name: str, commands: Sequence[Callable[..., None]], words: str, examples: Sequence[str]
) -> None:
    """Register commands marked by `about` under one name; the first is meant where none is named.

    Parameters
    ----------
    app
        To register them in.
    name
        What they have in common.
    commands
        The first one first.
    words, examples
        Help of all of them.
    """
    more = f"anser {name} COMMAND --help shows the options and exit codes of one."
    lines = "\n".join(["Examples:", *(f"  {one}" for one in examples), "", more])
    group = typer.Typer(cls=FirstUnlessNamed, no_args_is_help=True, help=words, epilog=escape(lines))
    for command in commands:
        offer(group, command)
    app.add_typer(group, name=name)
