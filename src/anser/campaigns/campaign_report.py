"""Report of a campaign: quantiles of the time series, replayed flights for the map, and the output files."""

import dataclasses
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
from anser.report.labels import printed_unit
from anser.results.checksums import DamagedFileError
from anser.results.flight_rows import FlightRow
from anser.results.netcdf import read_netcdf
from anser.results.variable_labels import catalogue_variable, is_quantity, record_coordinates
from anser.scenario.schema import Scenario

BAND_QUANTILES = (0.05, 0.5, 0.95)
"""Quantiles in figures: lower edge, centre line and upper edge of the band."""
_TIMES_MAX = 400
_AIRCRAFT_MAX = 6
_VALUES_MAX = 1 << 26
"""Maximum number of values of one time series in memory; larger campaigns are represented by evenly spaced flights."""


def series_bands(
    store: CampaignStore,
    flights: np.ndarray,  # numbers of the completed flights to include
) -> tuple[SeriesBands, ...]:
    """Compute the 5, 50 and 95 % quantiles over the flights for each stored time series except codes and flags.

    Only the first 6 aircraft and at most 400 times are included. The result is empty if the study stores no time series
    or `flights` is empty.
    """
    if store.series_selection is None or not flights.size:
        return ()
    data, bands_by_variable = store.series(), []
    times = data["time"].values
    time_indices = _spaced_indices(times.size, _TIMES_MAX)
    names = data["aircraft"].values[:_AIRCRAFT_MAX].tolist()
    flights = flights[_spaced_indices(flights.size, max(1, _VALUES_MAX // (len(names) * time_indices.size)))]
    for key in store.series_selection.keys:
        variable = catalogue_variable(key)
        if not is_quantity(variable):
            continue
        values = data[variable.name].sel(flight=flights).isel(aircraft=slice(len(names)), time=time_indices).values
        bands = quantiles_over(values, circular=variable.unit == "degree")
        unit = printed_unit(variable.unit)
        bands_by_variable.append(
            SeriesBands(variable.name, variable.long_name, unit, times[time_indices], tuple(names), bands)
        )
    return tuple(bands_by_variable)


def quantiles_over(
    values: np.ndarray,  # values of a variable; shape (flights, aircraft, times)
    *,
    # True: the values are angles in degrees; a quantile is the mean direction plus the quantile of the deviations from
    # this direction, and may exceed 180. False: plain quantiles
    circular: bool,
) -> np.ndarray:
    """Compute the 5, 50 and 95 % quantiles over the flights; shape (3, aircraft, times); NaN if there is no value."""
    quantiles = np.full((len(BAND_QUANTILES), *values.shape[1:]), np.nan)
    has_value = ~np.isnan(values).all(axis=0)
    selected = values[:, has_value].astype(float)
    if circular:
        radians = np.radians(selected)
        middle = np.degrees(np.arctan2(np.nanmean(np.sin(radians), axis=0), np.nanmean(np.cos(radians), axis=0)))
        selected = middle + (180.0 - np.mod(180.0 - (selected - middle), 360.0))
    if selected.size:
        quantiles[:, has_value] = np.nanquantile(selected, BAND_QUANTILES, axis=0)
    return quantiles


REPORT = "report.html"
WORST_FLIGHTS, BACKGROUND_FLIGHTS = 5, 20
"""Default numbers of flights that are flown again for the map: worst flights, and evenly spaced background flights."""
_KEYS = ("east", "north")
_TRACKS = [catalogue_variable(key).name for key in _KEYS]
_RECORDS = 2000
"""Maximum number of points of a flight's track on the map."""
_LISTED = 5
"""Minimum number of worst flights that the report lists."""


def write_campaign(
    store: CampaignStore,
    worst: int = WORST_FLIGHTS,  # number of the worst flights to replay and draw; 0: no replays and no map
    background: int = BACKGROUND_FLIGHTS,  # number of evenly spaced flights to replay as background of the map
    progress: Progress | None = None,  # called with a message and the completed fraction, 0..1
) -> tuple[Path, ...]:
    """Write a campaign's report, figures and tables into its folder, replacing former files.

    The report covers the completed flights. Raises StoreError if no flight is complete.

    Returns the paths of the written files: `report.html`; for two or more flights `campaign.svg` and `campaign.png`; if
    pyarrow is installed, `flights.parquet`, `aircraft.parquet`, `answers.parquet` and `indices.parquet`.
    """
    report, data, study = progress or no_progress, store.dataset(), store.study
    if not data.sizes["flight"]:
        raise StoreError(f"{store.folder}: arrived a campaign with no flight so far; expected one at least")
    has_started, is_counted = data["reason"].values == "", is_independent(study, data["flight"].values)
    started = data.isel(flight=np.flatnonzero(has_started))
    listed = worst_flights(started, max(worst, _LISTED))
    drawn_worst = listed[:worst]
    replay_worst = dict.fromkeys(drawn_worst, True)
    if drawn_worst:
        remaining = np.setdiff1d(started["flight"].values, drawn_worst)
        replay_worst |= dict.fromkeys(remaining[_spaced_indices(remaining.size, background)].tolist(), False)
    estimates, sensitivities = (
        estimate_campaign(data, store.flights, study).as_dict(),
        influences(data, study, store.varied).as_dict(),
    )
    levels = {
        vary.path: [str(value) for value in vary.values]
        for vary in study.vary
        if vary.values is not None and not vary.is_number
    }
    page_data = CampaignReport(
        dataset=data,
        estimates=estimates,
        influences=sensitivities,
        study=study.model_dump(mode="json", exclude_none=True),
        folder=str(store.folder),
        independent=is_counted,
        worst=listed,
        is_converged=store.converged_chunks is not None,
        levels=levels,
        bands=series_bands(store, data["flight"].values[is_counted & has_started]),
    )
    if replay_worst and not (store.folder / REPORT).exists():
        write_campaign_report(page_data, store.folder / REPORT)  # a readable report in case the replays are interrupted
    flown, changed = _replay(store, data, replay_worst, report)
    page_data = dataclasses.replace(page_data, replays=flown, replay_differences=changed)
    report("writing", None)
    with staged_folder(store.folder) as staging:
        write_campaign_report(page_data, staging / REPORT)
        figure = draw_campaign(data.isel(flight=np.flatnonzero(page_data.independent)), staging)
        tables = write_campaign_tables(data, estimates, sensitivities, staging) if has_parquet() else ()
    return tuple(store.folder / path.name for path in (staging / REPORT, *figure, *tables))


def _spaced_indices(size: int, count_max: int) -> np.ndarray:
    """Return at most `count_max` evenly spaced indices of an array of `size` elements, from the first to the last."""
    return np.unique(np.linspace(0, size - 1, min(size, count_max)).round().astype(int))


def _replay(
    store: CampaignStore,
    data: xr.Dataset,
    replay_worst: dict[int, bool],  # keys: flight numbers; True: one of the worst flights, False: background
    report: Progress,  # called with a message and the completed fraction, 0..1
) -> tuple[tuple[ReplayedFlight, ...], list[int]]:
    """Return the tracks of flights for the report's map; a flight that is not archived is flown again.

    The second result has the numbers of the flights that changed: the scenario is no longer valid, or the results of
    the repeated flight differ from the stored results. Raises StoreError if an archived flight is damaged.
    """
    tracks: dict[int, xr.Dataset] = {}
    cases: dict[int, FlightCase] = {}
    changed: list[int] = []
    for number in replay_worst:
        archive = archived_flight(store, number)
        if archive is not None:
            try:
                flown = read_netcdf(archive)
            except DamagedFileError as error:
                raise StoreError(f"{error}: anser campaign with --resume flies it again") from None
            tracks[number] = flown[_TRACKS].isel(time=_sparse(flown.sizes["time"])).load()
            continue
        try:
            cases[number] = FlightCase(flight_scenario(store, number))
        except ScenarioError:  # valid in the campaign: another version
            changed.append(number)
    if cases:
        scenario = next(iter(cases.values())).scenario
        timing = scenario.timing
        stride = _sparse(round(timing.duration_s / timing.record_period_s) + 1).step
        series = SeriesSelection.from_period(scenario, _KEYS, stride * timing.record_period_s)
        message = f"flying {len(cases)} flights again"
        flight_rows = fly_many(
            list(cases.values()),
            lambda _, part: report(message, part),
            len(cases),
            series=series,
            precision=store.study.precision,
        )
        for (number, case), flight_row in zip(cases.items(), flight_rows, strict=True):
            if row_differences(data, number, flight_row):
                changed.append(number)
            if not flight_row.reason:
                tracks[number] = _tracks(flight_row, series, case.scenario)
    return tuple(
        ReplayedFlight(number, worst, tracks[number]) for number, worst in replay_worst.items() if number in tracks
    ), changed


def _sparse(records: int) -> slice:
    return slice(None, None, -(-records // _RECORDS))


def _tracks(flight_row: FlightRow, series: SeriesSelection, scenario: Scenario) -> xr.Dataset:
    """Return the north and east positions of a repeated flight over time and aircraft, with names as in `flight.nc`."""
    coordinates = record_coordinates(series.times_s(scenario), [aircraft.name for aircraft in scenario.aircraft])
    values = {catalogue_variable(key).name: (("time", "aircraft"), flight_row.series[key].T) for key in _KEYS}
    return xr.Dataset(values, coordinates)
