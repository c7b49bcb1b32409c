"""Command cache: compiled programs that are stored on disk."""

import contextlib
import tempfile
from pathlib import Path
from typing import Annotated, Literal

import typer

from anser.cli.app import help_epilog
from anser.cli.console import (
    InputError,
    activity,
    print_document,
    print_line,
    print_note,
    print_problem,
    progress_bar,
)
from anser.scenario.files import load, loads, starter_scenario, write_starter

_MIB = 1 << 20


@help_epilog(
    "anser cache",
    "anser cache warm",
    "anser cache warm --scenario mine.toml",
    "anser cache measure --scenario mine.toml",
    "anser cache clear",
)
def cache(
    what: Annotated[
        Literal["show", "warm", "measure", "clear"],
        typer.Argument(
            help="show: where it is and how large; warm: compile what is needed first; measure: fly each scenario "
            "twice with an empty cache of its own, and print what its programs cost; clear: delete it."
        ),
    ] = "show",
    scenario: Annotated[
        list[Path] | None,
        typer.Option(help="Scenario for warm and measure; several times for several; left out: the starter."),
    ] = None,
) -> None:
    """Show, fill or clear the store of compiled programs, which saves repeated compilation."""
    if scenario and what not in ("warm", "measure"):
        raise InputError(f"--scenario: arrived with {what}; expected only with warm or measure")
    if what == "measure":
        _measure(scenario)
        return
    from anser.compiling.options import program_store

    store = program_store()
    if store is None:
        print_document(lambda: {"format_version": 1, "folder": None, "programs": 0, "size_bytes": 0})
        print_line("nothing is kept: ANSER_COMPILATION_CACHE is off, or the user has no folder")
        return
    if what == "clear":
        print_note(f"{store.clear()} programs deleted")
    if what == "warm":
        scenarios = [load(path) for path in scenario] if scenario else [loads(starter_scenario())]
        from anser.analysis.precompilation import warm_cache

        with progress_bar() as tell:
            warm_cache(scenarios, tell)
    sizes = []
    for path in store.files():
        with contextlib.suppress(OSError):  # another process may delete the file
            sizes.append(path.stat().st_size)
    document = {
        "format_version": 1,
        "folder": str(store.folder),
        "programs": len(sizes),
        "size_bytes": sum(sizes),
        "size_max_bytes": store.size_max,
    }
    print_document(lambda: document)
    print_line(
        f"{len(sizes)} programs, {sum(sizes) / _MIB:.1f} of at most {store.size_max / _MIB:.0f} MiB: {store.folder}"
    )
    reason = store.distrust_reason()
    if reason is not None:
        print_problem(f"{store.folder}: not used: {reason}")
    elif what == "warm" and not sizes:
        print_problem(f"{store.folder}: nothing could be written there")


def _measure(scenarios: list[Path] | None) -> None:
    from anser.cli.budget import measure_scenario, print_budgets

    with tempfile.TemporaryDirectory(prefix="anser-") as folder, activity("measuring") as tell:
        paths = scenarios or [write_starter(Path(folder) / "starter.toml")]
        budgets = []
        for path in paths:
            tell(f"flying {path.stem} twice")
            budgets.append(measure_scenario(path))
    print_document(lambda: {"format_version": 1, "scenarios": budgets})
    print_budgets(budgets)
