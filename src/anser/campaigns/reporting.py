"""The report of a campaign: some of its flights flown again, and all written into its folder."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from anser.campaigns.again import row_departures
from anser.campaigns.answering import answers, worst_flights
from anser.campaigns.flying import flight_of
from anser.campaigns.influencing import influences
from anser.campaigns.keeping import kept_flight
from anser.campaigns.sampling import independent
from anser.campaigns.series_bands import series_bands
from anser.campaigns.store import CampaignStore, StoreError
from anser.execution.batches import Progress, silent
from anser.execution.many_flights import FlightCase, fly_many
from anser.execution.series import SeriesKept
from anser.output_files import replaced_within
from anser.report import CampaignShown, FlownAgain, draw_campaign, write_campaign_report
from anser.report.exports import has_parquet, write_campaign_tables
from anser.results import DamagedFileError, read_netcdf
from anser.results.flight_row import FlightRow
from anser.results.series_values import variable_of
from anser.results.variable_labels import record_coordinates
from anser.scenario import Scenario, ScenarioError

REPORT = "report.html"
WORST, OTHERS = 5, 20
"""How many flights are flown again for the map: of the worst, and of evenly spaced ones that they are drawn over."""
_KEYS = ("east", "north")
_TRACKS = [variable_of(key).name for key in _KEYS]
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

    Raises
    ------
    StoreError
        No flight has been flown.
    """
    tell, data, study = progress or silent, store.dataset(), store.study
    if not data.sizes["flight"]:
        raise StoreError(f"{store.folder}: arrived a campaign with no flight so far; expected one at least")
    begun_at, counting = data["reason"].values == "", independent(study, data["flight"].values)
    begun = data.isel(flight=np.flatnonzero(begun_at))
    listed = worst_flights(begun, max(worst, _LISTED))
    drawn = listed[:worst]
    again = dict.fromkeys(drawn, True)
    if drawn:
        rest = np.setdiff1d(begun["flight"].values, drawn)
        again |= dict.fromkeys(_spaced(rest, others), False)
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
        independent=counting,
        worst=listed,
        enough=store.enough is not None,
        levels=levels,
        bands=series_bands(store, data["flight"].values[counting & begun_at]),
    )
    if again and not (store.folder / REPORT).exists():
        write_campaign_report(shown, store.folder / REPORT)  # readable should the flights be interrupted
    flown, otherwise = _flown_again(store, data, again, tell)
    shown = dataclasses.replace(shown, again=flown, otherwise=otherwise)
    tell("writing", None)
    with replaced_within(store.folder) as beside:
        write_campaign_report(shown, beside / REPORT)
        figure = draw_campaign(data.isel(flight=np.flatnonzero(shown.independent)), beside)
        tables = write_campaign_tables(data, found, depends, beside) if has_parquet() else ()
    return tuple(store.folder / path.name for path in (beside / REPORT, *figure, *tables))


def _spaced(numbers: np.ndarray, count: int) -> Sequence[int]:
    if not count or not numbers.size:
        return ()
    places = np.linspace(0, numbers.size - 1, min(count, numbers.size)).round().astype(int)
    return [int(number) for number in np.unique(numbers[places])]


def _flown_again(
    store: CampaignStore, data: xr.Dataset, wanted: dict[int, bool], tell: Progress
) -> tuple[tuple[FlownAgain, ...], list[int]]:
    """Flights by their number, and whether each is one of the worst; and numbers of those that came out otherwise.

    Those that were kept whole are read; the others fly as one batch.
    """
    found: dict[int, xr.Dataset] = {}
    cases: dict[int, FlightCase] = {}
    otherwise: list[int] = []
    for number in wanted:
        kept = kept_flight(store, number)
        if kept is not None:
            try:
                flown = read_netcdf(kept)
            except DamagedFileError as error:
                raise StoreError(f"{error}: anser campaign with --resume flies it again") from None
            found[number] = flown[_TRACKS].isel(time=_sparse(flown.sizes["time"])).load()
            continue
        try:
            cases[number] = FlightCase(flight_of(store, number))
        except ScenarioError:  # it was valid in the campaign: another version
            otherwise.append(number)
    if cases:
        scenario = next(iter(cases.values())).scenario
        timing = scenario.timing
        stride = _sparse(round(timing.duration_s / timing.record_period_s) + 1).step
        series = SeriesKept.of(scenario, _KEYS, stride * timing.record_period_s)
        said = f"flying {len(cases)} flights again"
        rows = fly_many(
            list(cases.values()),
            lambda _, part: tell(said, part),
            len(cases),
            series=series,
            precision=store.study.precision,
        )
        for (number, case), row in zip(cases.items(), rows, strict=True):
            if row_departures(data, number, row):
                otherwise.append(number)
            if not row.reason:
                found[number] = _tracks(row, series, case.scenario)
    return tuple(
        FlownAgain(number, worst, found[number]) for number, worst in wanted.items() if number in found
    ), otherwise


def _sparse(records: int) -> slice:
    return slice(None, None, -(-records // _RECORDS))


def _tracks(row: FlightRow, series: SeriesKept, scenario: Scenario) -> xr.Dataset:
    """Positions of a flight of a batch, as `flight.nc` holds them."""
    coordinates = record_coordinates(series.times_s(scenario), [one.name for one in scenario.aircraft])
    values = {variable_of(key).name: (("time", "aircraft"), row.series[key].T) for key in _KEYS}
    return xr.Dataset(values, coordinates)
