"""The report of a campaign: some of its flights flown again, and all written into its folder."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from anser.campaigns.answering import answers, worst_flights
from anser.campaigns.flying import flight_of
from anser.campaigns.influencing import influences
from anser.campaigns.keeping import kept_flight
from anser.campaigns.sampling import independent
from anser.campaigns.store import CampaignStore
from anser.execution import NoPlanError, run
from anser.execution.batches import Progress, silent
from anser.report import CampaignShown, FlownAgain, draw_campaign, write_campaign_report
from anser.report.exports import has_parquet, write_campaign_tables
from anser.results import read_netcdf
from anser.scenario import ScenarioError

if TYPE_CHECKING:
    import xarray as xr

REPORT = "report.html"
WORST, OTHERS = 5, 20
"""How many flights are flown again for the map: of the worst, and of evenly spaced ones that they are drawn over."""
_TRACKS = ["east_m", "north_m"]
_RECORDS = 2000
"""Of a flight flown again that are kept at most."""
_LISTED = 5
"""Of the worst flights that are listed where fewer are drawn."""


def write_campaign(
    store: CampaignStore, worst: int = WORST, others: int = OTHERS, progress: Progress | None = None
) -> tuple[Path, ...]:
    """Write the report of a campaign, whole or partial, its figure and its tables, in place of former ones.

    Parameters
    ----------
    store
        Of the campaign.
    worst
        How many of the worst flights are flown again and drawn; 0: none is flown, and there is no map.
    others
        How many evenly spaced flights are flown again, to draw the worst over them.
    progress
        Called with what is being done and the part that is behind, 0..1.

    Returns
    -------
    What was written: `report.html`, of two flights or more `campaign.svg` and `campaign.png`, and with pyarrow
    `flights.parquet`, `aircraft.parquet`, `answers.parquet` and `indices.parquet`.
    """
    tell, data, study = progress or silent, store.dataset(), store.study
    begun = data.isel(flight=np.flatnonzero(data["reason"].values == ""))
    listed = worst_flights(begun, max(worst, _LISTED))
    drawn = listed[:worst]
    again = dict.fromkeys(drawn, True)
    if drawn:
        again |= {number: False for number in _spaced(begun["flight"].values, others) if number not in drawn}
    found, depends = answers(data, store.flights, study).as_dict(), influences(data, study, store.varied).as_dict()
    levels = {
        vary.path: [str(value) for value in vary.values]
        for vary in study.vary
        if vary.values is not None and not vary.is_number
    }
    shown = CampaignShown(
        dataset=data,
        answers=found,
        influences=depends,
        study=study.model_dump(mode="json", exclude_none=True),
        place=str(store.folder),
        independent=independent(study, data["flight"].values),
        worst=listed,
        enough=store.enough is not None,
        levels=levels,
    )
    page = store.folder / REPORT
    if again and not page.exists():
        write_campaign_report(shown, page)  # readable should the flights be interrupted
    shown = dataclasses.replace(shown, again=_flown_again(store, again, tell))
    tell("writing", None)
    write_campaign_report(shown, page)
    figure = draw_campaign(data.isel(flight=np.flatnonzero(shown.independent)), store.folder)
    tables = write_campaign_tables(data, found, depends, store.folder) if has_parquet() else ()
    return page, *figure, *tables


def _spaced(numbers: np.ndarray, count: int) -> Sequence[int]:
    if not count or not numbers.size:
        return ()
    places = np.linspace(0, numbers.size - 1, min(count, numbers.size)).round().astype(int)
    return [int(number) for number in np.unique(numbers[places])]


def _flown_again(store: CampaignStore, wanted: dict[int, bool], tell: Progress) -> tuple[FlownAgain, ...]:
    """Flights by their number, and whether each is one of the worst; those kept are read instead."""
    found = []
    for k, (number, worst) in enumerate(wanted.items()):
        tell(f"flying {len(wanted)} flights again", k / len(wanted))
        kept = kept_flight(store, number)
        if kept is not None:
            flown = read_netcdf(kept)
        else:
            try:
                flown = run(flight_of(store, number)).dataset
            except (ScenarioError, NoPlanError):  # it began in the campaign: another version, or rounding
                continue
        found.append(FlownAgain(number, worst, _tracks(flown)))
    return tuple(found)


def _tracks(flown: "xr.Dataset") -> "xr.Dataset":
    return flown[_TRACKS].isel(time=slice(None, None, -(-flown.sizes["time"] // _RECORDS))).load()
