"""Replay of a campaign's flights: comparison with the stored results, and archive of the worst flights."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.campaigns.estimates import worst_flights
from anser.campaigns.flights import flight_scenario
from anser.campaigns.store import CampaignStore, shortened
from anser.config.errors import ScenarioError
from anser.files import staged_folder
from anser.missions.batches import Progress, no_progress
from anser.missions.first_plan import NoPlanError
from anser.missions.runs import run
from anser.results.checksums import DamagedFileError, read_document, verify_checksum
from anser.results.flight_rows import FlightRow, tabulate_flights

REPLAY_TOLERANCES = {"float64": 1e-9, "float32": 1e-5}
"""Tolerated difference between a flight flown alone and in a batch, relative to `_SCALES`, by precision."""
_SCALES = {"s": 100.0, "m": 1e4, "m s-1": 150.0, "1": 1.0}


def replay_differences(
    store: CampaignStore,
    number: int,
    summary: dict[str, Any],  # summary (`summary.json`) of the flight flown again
    *,
    met: bool,  # whether the replay met every requirement
) -> dict[str, float | str]:
    """Compare a flight flown again with its stored results; return the quantities that differ, by name.

    A float differs if the greatest difference over the aircraft, divided by the scale of the unit (100 s, 10 km, 150
    m/s or 1), exceeds `REPLAY_TOLERANCES`; the result is this quotient, or NaN if only one of the flights has a value.
    For a text, flag or whole number that differs, the result is the stored value as text.
    """
    return row_differences(
        store.dataset(), number, FlightRow(summary["aircraft"], summary["fleet"], summary["requirements"], met)
    )


def row_differences(data: xr.Dataset, number: int, flight_row: FlightRow) -> dict[str, float | str]:
    """Compare `flight_row`, the results of a flight flown again, with flight `number` of a campaign's dataset.

    Returns the differences by name, as `replay_differences` does.
    """
    tolerance, data = REPLAY_TOLERANCES[data.attrs["precision"]], data.sel(flight=number)
    differences: dict[str, float | str] = {}
    for name, (_, values, attributes) in tabulate_flights([flight_row], data.sizes["aircraft"]).items():
        stored, replayed = data[name].values, values[0]
        if values.dtype.kind != "f":
            if not np.array_equal(stored, shortened(replayed, name)):
                differences[name] = str(stored)
            continue
        deviation = (
            np.where(np.isnan(stored) & np.isnan(replayed), 0.0, np.abs(stored - replayed))
            / _SCALES[attributes["units"]]
        )
        if not np.all(deviation <= tolerance):
            differences[name] = float(np.max(deviation))
    return differences


_FOLDER = "worst"
_FLIGHT, _SUMMARY = "flight.nc", "summary.json"


def archive_worst(
    store: CampaignStore,
    progress: Progress = no_progress,  # called with a message and the completed fraction, 0..1
) -> tuple[Path, ...]:
    """Fly the worst flights again and store the outputs of each flight in a folder; return the folders.

    The study's table [keep] gives the number of flights (`worst`). Flights with an undamaged archive are not flown
    again; flights that could not start are left out.
    """
    count = store.study.keep.worst if store.study.keep is not None else 0
    if not count:
        return ()
    data = store.dataset()
    started = data.isel(flight=np.flatnonzero(data["reason"].values == ""))
    folders, numbers = [], worst_flights(started, count)
    for k, number in enumerate(numbers):
        progress(f"keeping the worst {len(numbers)} flights", k / len(numbers))
        folder = _folder(store, number)
        if _is_intact(folder) or _archive_flight(store, number, folder):
            folders.append(folder)
    return tuple(folders)


def archived_flight(store: CampaignStore, number: int) -> Path | None:
    """Return the path of an archived flight's dataset (`flight.nc`); None if the flight is not archived."""
    path = _folder(store, number) / _FLIGHT
    return path if path.is_file() else None


def _is_intact(folder: Path) -> bool:
    """Whether a folder contains the dataset and the summary of a flight, with matching checksums."""
    try:
        return verify_checksum(folder / _FLIGHT) and read_document(folder / _SUMMARY)[1]
    except (DamagedFileError, FileNotFoundError):
        return False


def _archive_flight(store: CampaignStore, number: int, folder: Path) -> bool:
    """Fly a flight again and write its outputs into the new `folder`; return False if the flight cannot start."""
    try:
        flown = run(flight_scenario(store, number), precision=store.study.precision)
    except (ScenarioError, NoPlanError):  # the flight started in the campaign: another version, or rounding
        return False
    folder.parent.mkdir(exist_ok=True)
    with staged_folder(folder.parent) as staging:
        flown.save(staging / folder.name)
    return True


def _folder(store: CampaignStore, number: int) -> Path:
    return store.folder / _FOLDER / f"flight-{number:06d}"
