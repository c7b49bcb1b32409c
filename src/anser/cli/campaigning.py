"""Command campaign fly: a scenario flown many times, with numbers of it dispersed."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.campaign_answers import opened
from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    line,
    number,
    plain_table,
    print_table,
    problem,
    progress_bar,
    say,
)
from anser.cli.offering import about
from anser.scenario import Scenario, ScenarioError, cautions

if TYPE_CHECKING:
    from anser.campaigns import Answers, Campaign, CampaignStore
    from anser.campaigns.answering import Answer
    from anser.execution import Flown

_CAUSES = 8
"""Causes of failure that are printed at most."""
_MILLISECONDS_BELOW_S = 0.01


@about(
    "anser campaign studies/how-surely.toml --out runs/how-surely",
    "anser campaign studies/how-surely.toml --out runs/how-surely --resume",
    unmet="a flight did not meet every requirement, or could not begin",
)
def fly(
    study: Annotated[Path, typer.Argument(help="Study file (TOML).", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder of the campaign; new, unless --resume.", show_default=False)],
    resume: Annotated[
        bool, typer.Option("--resume", help="Fly what is missing or damaged of the campaign in the folder.")
    ] = False,
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="How many fly at a time; left out: one a core, if memory lasts.", show_default=False),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(help="Address of a dask scheduler, whose workers fly instead.", show_default=False),
    ] = None,
    precision: Annotated[
        str | None,
        typer.Option(
            help="In which flights are flown, float64 or float32; left out: as the study says.", show_default=False
        ),
    ] = None,
) -> None:
    """Fly a study: a scenario many times, its numbers dispersed, and say how surely it keeps its requirements.

    The word fly may be left out: anser campaign STUDY --out FOLDER.
    """
    from anser.campaigns import StoreError
    from anser.campaigns.campaigning import store_of

    try:
        store = store_of(study, out, resume=resume, precision=precision)
    except FileExistsError:
        raise RefusedError(f"--out: arrived {out}, which exists; expected a new folder, or --resume") from None
    except StoreError as error:
        raise RefusedError(str(error)) from None
    with _alone(store):
        _fly(store, out, processes, cluster)


@contextlib.contextmanager
def _alone(store: "CampaignStore") -> Iterator[None]:
    """Let no other process fly a campaign meanwhile; says which chunks are damaged and flown again."""
    from anser.campaigns import StoreError

    with contextlib.ExitStack() as lock:
        try:
            lock.enter_context(store.locked())
        except StoreError as error:
            raise RefusedError(str(error)) from None
        for message in store.damages:
            say(message)
        yield


def _fly(store: "CampaignStore", out: Path, processes: int | None, cluster: str | None) -> None:
    """Fly what is missing, answer, and write the report."""
    from anser.campaigns import Campaign, StoreError, fly_campaign, keep_worst
    from anser.campaigns.flying import room_of

    for caution in cautions(store.scenario):
        say(f"caution: {caution}")
    flown, before = Campaign(store), store.flown.size
    if processes is None and cluster is None:
        room = room_of(store)
        processes = room.processes
        if room.words:
            say(room.words)
    try:
        with progress_bar() as tell:
            fly_campaign(store, processes or 1, tell, cluster)
            keep_worst(store, tell)
    except KeyboardInterrupt:
        _print_answers(flown.answers(), flown)
        _write(store, before)
        say(_kept(store))
        raise
    except StoreError as error:
        _write(store, before)
        say(_kept(store))
        raise RefusedError(str(error)) from None
    except OSError:
        say(_kept(store))
        raise
    found = flown.answers()
    answer(lambda: {"format_version": 1, "study": store.study.name, **found.as_dict()})
    _print_answers(found, flown)
    written = ["flights.zarr", *_write(store, before)]
    say(f"{out}: {', '.join(written)} written; anser campaign report {out} draws the worst flights, too")
    if found.met < found.flown:
        problem(
            f"{found.flown - found.met} of {found.flown} flights did not meet every requirement, or could not begin"
        )
        raise typer.Exit(1)


def _kept(store: "CampaignStore") -> str:
    return f"{store.folder}: {store.flown.size} of {store.flights} flights; --resume flies the others"


def _write(store: "CampaignStore", before: int) -> list[str]:
    """Report of what was flown, without flying any again; what was written.

    A report that is there stays where no flight has come to those before: it may show flights that were flown again.
    """
    from anser.campaigns import REPORT, write_campaign

    if not store.flown.size or (store.flown.size == before and (store.folder / REPORT).exists()):
        return []
    return [path.name for path in write_campaign(store, worst=0)]


def flight_of_campaign(folder: Path, number: int) -> "tuple[CampaignStore, Scenario]":
    """The store of a folder and the scenario of one of its flights; refuses what is neither."""
    from anser.campaigns import flight_of

    store = opened(folder, "--campaign")
    try:
        return store, flight_of(store, number)
    except ScenarioError:
        raise
    except ValueError as error:
        raise RefusedError(f"--{error}") from None


def say_whether_same(store: "CampaignStore", number: int, flown: "Flown") -> None:
    """Whether a flight of a campaign came out as its row says."""
    from anser.campaigns import departures

    if number not in store.flown:
        say(f"flight {number} has not been flown in the campaign yet")
        return
    found = departures(store, number, flown.summary, met=flown.met)
    if not found:
        say(f"flight {number}: as in the campaign")
    for name, off in found.items():
        words = f"differs by {off:.2g} of its scale" if isinstance(off, float) else f"is {off} in the campaign"
        problem(f"flight {number}: {name} {words}: another version, or rounding that led to another decision")


def _bound_cells(one: "Answer") -> list[str]:
    """Bound, ends of its interval and unit; a time in milliseconds where seconds would show nothing but zeros."""
    values = one.value, one.low, one.high
    known = [abs(value) for value in values if value is not None]
    if one.unit == "s" and max(known, default=1.0) < _MILLISECONDS_BELOW_S:
        return [*(number(None if value is None else 1000.0 * value, 3) for value in values), "ms"]
    return [*(number(value, 3) for value in values), "" if one.unit == "1" else one.unit]


def _print_answers(found: "Answers", flown: "Campaign") -> None:
    """Probability, quantiles and causes."""
    from anser.results.separated import NO_SEPARATION, near_warning

    name, data = flown.store.study.name, flown.dataset
    if not found.flown:
        line(f"{name}: no flight so far")
        return
    sure, share = f"{100 * found.confidence:g} %", 100 * (found.probability or 0.0)
    interval = f"{100 * found.low:.2f} to {100 * found.high:.2f} % at {sure} confidence"
    if found.independent < found.flown:
        interval += f", from {found.independent} that are independent of each other"
    without = f"; {NO_SEPARATION}" if data.attrs.get("separation_required") == 0 else ""
    line(f"{name}: {found.met} of {found.flown} flights meet every requirement, {share:.2f} % ({interval}){without}")
    warning = near_warning(data["separation_min_m"].values, data.attrs)
    if warning:
        say(f"warning: {warning}")
    table = plain_table(
        f"bounds that part of the flights keep; interval at {sure} confidence",
        *columns("", overflow="fold"),
        *columns("of flights", "bound", "from", "to", justify="right"),
        *columns("unit"),
    )
    for one in found.quantiles:
        table.add_row(one.words, f"{100 * one.share:g} %", *_bound_cells(one))
    print_table(table)
    for words, count in list(found.causes.items())[:_CAUSES]:
        line(f"{count} flights: {words}")
    line(f"worst flights: {', '.join(map(str, found.worst))}")
