"""Commands campaign report and campaign compare: what follows from flights that were flown."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anser.cli.console import RefusedError, answer, line, progress_bar, say
from anser.cli.offering import about

if TYPE_CHECKING:
    from anser.campaigns import CampaignStore

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
    from anser.campaigns import write_campaign
    from anser.report.exports import PARQUET_MISSING, has_parquet

    with progress_bar() as tell:
        written = write_campaign(store, worst, others, tell)
    answer(lambda: {"format_version": 1, "flown": int(store.flown.size), "files": [str(path) for path in written]})
    for path in written:
        line(f"{path}: written")
    if store.flown.size < store.flights and store.enough is None:
        say(f"partial: {store.flown.size} of {store.flights} flights")
    if not has_parquet():
        say(f"no tables: {PARQUET_MISSING}")


def opened(folder: Path, place: str) -> "CampaignStore":
    """The store of a folder; refuses one that has none."""
    from anser.campaigns import CampaignStore, StoreError

    try:
        return CampaignStore.open(folder)
    except StoreError as error:
        raise RefusedError(f"{place}: {error}") from None
