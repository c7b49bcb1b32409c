"""The report of a campaign.

Quantile bands of its time series, replayed flights for the map, and the files written into its folder.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from anser.campaigns.estimates import estimate_campaign, worst_flights
from anser.campaigns.flights import flight_scenario
from anser.campaigns.replay import archived_flight, row_differences
from anser.campaigns.sampling import is_independent
from anser.campaigns.sensitivity import influences
from anser.campaigns.store import CampaignStore
from anser.campaigns.store_integrity import StoreError
from anser.config.errors import ScenarioError
from anser.files import staged_folder
from anser.missions.batches import Progress, no_progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.series import SeriesSelection
from anser.report.campaign_data import CampaignReport, ReplayedFlight, SeriesBands
from anser.report.campaign_figures import draw_campaign
from anser.report.campaign_page import write_campaign_report
from anser.report.exports.tables import has_parquet, write_campaign_tables
from anser.results.checksums import DamagedFileError
from anser.results.flight_rows import FlightRow
from anser.results.netcdf import read_netcdf
from anser.results.variable_labels import catalogue_variable, is_quantity, record_coordinates
from anser.scenario.schema import Scenario

BAND_QUANTILES = (0.05, 0.5, 0.95)
"""Quantiles that are drawn: the ends of the band, and the line in it."""
_TIMES = 400
_AIRCRAFT = 6
_NUMBERS = 1 << 26
"""Of one variable that are held at once at most: of more flights, evenly spaced ones count."""


def series_bands(store: CampaignStore, flights: np.ndarray) -> tuple[SeriesBands, ...]:
    """Find the bands of what a campaign has kept; empty where it kept nothing, or nothing was flown.

    Parameters
    ----------
    store
        Of the campaign.
    flights
        Numbers of the flights that count, all of them complete.
    """
    if store.series_selection is None or not flights.size:
        return ()
    data, found = store.series(), []
    times = data["time"].values
    drawn = np.unique(np.linspace(0, times.size - 1, min(times.size, _TIMES)).round().astype(int))
    names = data["aircraft"].values[:_AIRCRAFT].tolist()
    most = max(1, _NUMBERS // (len(names) * drawn.size))
    if flights.size > most:
        flights = flights[np.linspace(0, flights.size - 1, most).round().astype(int)]
    for key in store.series_selection.keys:
        variable = catalogue_variable(key)
        if not is_quantity(variable):
            continue
        parts = store.read_series_chunks(variable.name, flights)
        values = np.concatenate([part[:, : len(names), drawn] for part in parts])
        bands = quantiles_over(values, circular=variable.unit == "degree")
        label = "" if variable.unit == "1" else variable.unit
        found.append(SeriesBands(variable.name, variable.long_name, label, times[drawn], tuple(names), bands))
    return tuple(found)


def quantiles_over(values: np.ndarray, *, circular: bool) -> np.ndarray:
    """Quantiles over the flights, at each time of each aircraft; NaN where no flight has a number.

    Parameters
    ----------
    values
        Shape (flights, aircraft, times).
    circular
        Whether they are angles in degrees: then they are quantiles of the turn from their mean direction, and a value
        may lie beyond 180.

    Returns
    -------
    Shape (quantiles, aircraft, times).
    """
    found = np.full((len(BAND_QUANTILES), *values.shape[1:]), np.nan)
    known = ~np.isnan(values).all(axis=0)
    some = values[:, known].astype(float)
    if circular:
        turned = np.radians(some)
        middle = np.degrees(np.arctan2(np.nanmean(np.sin(turned), axis=0), np.nanmean(np.cos(turned), axis=0)))
        some = middle + (180.0 - np.mod(180.0 - (some - middle), 360.0))
    if some.size:
        found[:, known] = np.nanquantile(some, BAND_QUANTILES, axis=0)
    return found


REPORT = "report.html"
WORST_FLIGHTS, BACKGROUND_FLIGHTS = 5, 20
"""How many flights are flown again for the map: of the worst, and of evenly spaced ones that they are drawn over."""
_KEYS = ("east", "north")
_TRACKS = [catalogue_variable(key).name for key in _KEYS]
_RECORDS = 2000
"""Of a flight flown again that are kept at most."""
_LISTED = 5
"""Of the worst flights that are listed where fewer are drawn."""


def write_campaign(
    store: CampaignStore, worst: int = WORST_FLIGHTS, others: int = BACKGROUND_FLIGHTS, progress: Progress | None = None
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
    tell, data, study = progress or no_progress, store.dataset(), store.study
    if not data.sizes["flight"]:
        raise StoreError(f"{store.folder}: arrived a campaign with no flight so far; expected one at least")
    begun_at, counting = data["reason"].values == "", is_independent(study, data["flight"].values)
    begun = data.isel(flight=np.flatnonzero(begun_at))
    listed = worst_flights(begun, max(worst, _LISTED))
    drawn = listed[:worst]
    again = dict.fromkeys(drawn, True)
    if drawn:
        rest = np.setdiff1d(begun["flight"].values, drawn)
        again |= dict.fromkeys(_spaced(rest, others), False)
    found, depends = (
        estimate_campaign(data, store.flights, study).as_dict(),
        influences(data, study, store.varied).as_dict(),
    )
    levels = {
        vary.path: [str(value) for value in vary.values]
        for vary in study.vary
        if vary.values is not None and not vary.is_number
    }
    shown = CampaignReport(
        dataset=data,
        estimates=found,
        influences=depends,
        study=study.model_dump(mode="json", exclude_none=True),
        folder=str(store.folder),
        independent=counting,
        worst=listed,
        is_converged=store.converged_chunks is not None,
        levels=levels,
        bands=series_bands(store, data["flight"].values[counting & begun_at]),
    )
    if again and not (store.folder / REPORT).exists():
        write_campaign_report(shown, store.folder / REPORT)  # readable should the flights be interrupted
    flown, otherwise = _replay(store, data, again, tell)
    shown = dataclasses.replace(shown, replays=flown, replay_differences=otherwise)
    tell("writing", None)
    with staged_folder(store.folder) as beside:
        write_campaign_report(shown, beside / REPORT)
        figure = draw_campaign(data.isel(flight=np.flatnonzero(shown.independent)), beside)
        tables = write_campaign_tables(data, found, depends, beside) if has_parquet() else ()
    return tuple(store.folder / path.name for path in (beside / REPORT, *figure, *tables))


def _spaced(numbers: np.ndarray, count: int) -> Sequence[int]:
    if not count or not numbers.size:
        return ()
    places = np.linspace(0, numbers.size - 1, min(count, numbers.size)).round().astype(int)
    return [int(number) for number in np.unique(numbers[places])]


def _replay(
    store: CampaignStore, data: xr.Dataset, wanted: dict[int, bool], tell: Progress
) -> tuple[tuple[ReplayedFlight, ...], list[int]]:
    """Flights by their number, and whether each is one of the worst; and numbers of those that came out otherwise.

    Those that were kept whole are read; the others fly as one batch.
    """
    found: dict[int, xr.Dataset] = {}
    cases: dict[int, FlightCase] = {}
    otherwise: list[int] = []
    for number in wanted:
        kept = archived_flight(store, number)
        if kept is not None:
            try:
                flown = read_netcdf(kept)
            except DamagedFileError as error:
                raise StoreError(f"{error}: anser campaign with --resume flies it again") from None
            found[number] = flown[_TRACKS].isel(time=_sparse(flown.sizes["time"])).load()
            continue
        try:
            cases[number] = FlightCase(flight_scenario(store, number))
        except ScenarioError:  # it was valid in the campaign: another version
            otherwise.append(number)
    if cases:
        scenario = next(iter(cases.values())).scenario
        timing = scenario.timing
        stride = _sparse(round(timing.duration_s / timing.record_period_s) + 1).step
        series = SeriesSelection.from_period(scenario, _KEYS, stride * timing.record_period_s)
        said = f"flying {len(cases)} flights again"
        rows = fly_many(
            list(cases.values()),
            lambda _, part: tell(said, part),
            len(cases),
            series=series,
            precision=store.study.precision,
        )
        for (number, case), row in zip(cases.items(), rows, strict=True):
            if row_differences(data, number, row):
                otherwise.append(number)
            if not row.reason:
                found[number] = _tracks(row, series, case.scenario)
    return tuple(
        ReplayedFlight(number, worst, found[number]) for number, worst in wanted.items() if number in found
    ), otherwise


def _sparse(records: int) -> slice:
    return slice(None, None, -(-records // _RECORDS))


def _tracks(row: FlightRow, series: SeriesSelection, scenario: Scenario) -> xr.Dataset:
    """Positions of a flight of a batch, as `flight.nc` holds them."""
    coordinates = record_coordinates(series.times_s(scenario), [one.name for one in scenario.aircraft])
    values = {catalogue_variable(key).name: (("time", "aircraft"), row.series[key].T) for key in _KEYS}
    return xr.Dataset(values, coordinates)
