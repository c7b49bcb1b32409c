"""Commands campaign report and campaign compare: what follows from flights that were flown."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.console import (
    RefusedError,
    answer,
    columns,
    line,
    number,
    plain_table,
    print_table,
    progress_bar,
    say,
)
from anser.cli.offering import about
from anser.cli.output_folder import Force, written_into

if TYPE_CHECKING:
    from anser.campaigns import CampaignComparison, CampaignStore

_KEYS = 12
"""Keys of the scenario that are printed at most."""
_CampaignFolder = Annotated[
    Path, typer.Argument(help="Folder of a campaign: flights.zarr.", show_default=False, metavar="FOLDER")
]


@about(
    "anser campaign report runs/how-surely",
    "anser campaign report runs/how-surely --worst 0",
)
def report(
    folder: _CampaignFolder,
    worst: Annotated[
        int, typer.Option(min=0, max=1000, help="How many of the worst flights are flown again and drawn; 0: no map.")
    ] = 5,
    others: Annotated[
        int, typer.Option(min=0, max=1000, help="How many evenly spaced flights the worst are drawn over.")
    ] = 20,
) -> None:
    """Write the report of a campaign, whole or partial: answers, what they depend on, the worst flights; and tables.

    The page report.html works offline. The tables, as Parquet, take pyarrow.
    """
    store = opened(folder, "FOLDER")
    if not store.flown.size:
        raise RefusedError(f"FOLDER: arrived {folder}, where no chunk of flights is complete; expected one at least")
    from anser.campaigns import StoreError, write_campaign
    from anser.report.exports import PARQUET_MISSING, has_parquet

    try:
        with progress_bar() as tell:
            written = write_campaign(store, worst, others, tell)
    except StoreError as error:
        raise RefusedError(f"FOLDER: {error}") from None
    answer(lambda: {"format_version": 1, "flown": int(store.flown.size), "files": [str(path) for path in written]})
    for path in written:
        line(f"{path}: written")
    if store.flown.size < store.flights and store.enough is None:
        say(f"partial: {store.flown.size} of {store.flights} flights")
    if not has_parquet():
        say(f"no tables: {PARQUET_MISSING}")


@about(
    "anser campaign compare runs/how-surely runs/windier",
    "anser campaign compare runs/how-surely runs/windier --out compared",
)
def compare(
    folder: _CampaignFolder,
    other: Annotated[Path, typer.Argument(help="Folder of a second campaign with the same seeds.", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="New folder for the figure.", show_default=False)] = None,
    force: Force = False,
) -> None:
    """Compare two campaigns with paired seeds, flight by flight: which is better, how often and by how much."""
    opened(folder, "FOLDER")
    opened(other, "OTHER")
    from anser.campaigns import compare_campaigns
    from anser.report import draw_paired

    try:
        found = compare_campaigns(folder, other)
    except ValueError as error:
        raise RefusedError(f"{folder}, {other}: {error}") from None
    if out is not None:
        with written_into(out, force) as into:
            written = draw_paired(found.dataset, into)
            say(f"{out}: {', '.join(path.name for path in written) or 'nothing'} written")
    answer(lambda: {"format_version": 1, **found.as_dict()})
    _print_compared(found)


def _print_compared(found: "CampaignComparison") -> None:
    sure = f"{100 * found.confidence:g} %"
    line(f"{found.flights} pairs; first: {found.first}; second: {found.second}")
    line(
        f"every requirement met in both {found.both}, in the first alone {found.first_only}, in the second alone "
        f"{found.second_only}, in neither {found.neither}; McNemar, exact: p = {found.p_value:.3g}"
    )
    for one in found.differences:
        line(
            f"{one.words}: less in the second in {one.second_better} flights, alike in {one.alike}, less in the first "
            f"in {one.first_better}; {100 * one.share:.2f} % ({100 * one.low:.2f} to {100 * one.high:.2f} % at {sure} "
            "confidence) better in the second"
        )
    table = plain_table(
        f"second less first, bounds that part of the pairs stay below; interval at {sure} confidence",
        *columns("", overflow="fold"),
        *columns("of pairs", "below", "from", "to", justify="right"),
        *columns("unit"),
    )
    for one in found.differences:
        for share, *values in one.quantiles:
            table.add_row(one.words, f"{100 * share:g} %", *(number(value, 4) for value in values), one.unit)
    print_table(table)
    if found.precision[0] != found.precision[1]:
        line(f"flown in {found.precision[0]} in the first, in {found.precision[1]} in the second")
    for path, count in found.applied.items():
        line(f"applied otherwise in {count} of {found.flights} pairs: {path}")
    for path, one, other in found.scenario[:_KEYS]:
        line(f"scenario, {path}: {one} in the first, {other} in the second")
    if len(found.scenario) > _KEYS:
        line(f"and {len(found.scenario) - _KEYS} more keys of the scenario")


def opened(folder: Path, place: str) -> "CampaignStore":
    """The store of a folder; refuses one that has none."""
    from anser.campaigns import CampaignStore, StoreError

    try:
        return CampaignStore.open(folder)
    except StoreError as error:
        raise RefusedError(f"{place}: {error}") from None
