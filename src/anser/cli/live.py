"""Command that serves the live page: live."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from anser.cli.app import help_epilog
from anser.cli.arguments import complete_scenario
from anser.cli.console import InputError, print_document, print_line, print_note
from anser.config.shipped_files import shipped_files


@help_epilog("anser live", "anser live scenarios/storm-sampling.toml", "anser live mine.toml --folder runs --no-open")
def live(
    scenario: Annotated[
        Path | None,
        typer.Argument(
            help="Scenario file (TOML); left out: the shipped storm-sampling.", autocompletion=complete_scenario
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            help="Folder in which the page opens and saves files; left out: the scenario's, or the current one."
        ),
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Print the address only; open no browser.")] = False,
) -> None:
    """Move aircraft, goals and limits on a page and see the certified plan or its refusal at once; fly it.

    The page is served on this machine only, until Ctrl-C.
    """
    from anser.live.notebook import open_server

    if folder is not None and not folder.is_dir():
        raise InputError(f"--folder: arrived {folder}, which is no folder; expected an existing folder")
    source, target = scenario, folder
    if source is None:
        source, target = shipped_files()["storm-sampling"], folder or Path.cwd()
    try:
        server = open_server(source, target)
    except ImportError as error:
        raise InputError(f"live: {error}") from None
    try:
        print_document(lambda: {"format_version": 1, "url": server.url})
        print_line(f"the live page: {server.url}")
        print_note("on this machine only; Ctrl-C ends it")
        if not no_open and not webbrowser.open(server.url):
            print_note("no browser could be opened: open the address above")
        server.wait()
    finally:
        server.close()
