"""Flights of a campaign flown again.

Comparison of a replay with the stored row, and the archive of the worst flights, each with all outputs of `anser
run`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.estimates import worst_flights
from anser.campaigns.flights import flight_scenario
from anser.campaigns.store import CampaignStore
from anser.config.errors import ScenarioError
from anser.files import staged_folder
from anser.missions.batches import Progress, no_progress
from anser.missions.first_plan import NoPlanError
from anser.missions.runs import run
from anser.results.checksums import DamagedFileError, read_document, verify_checksum
from anser.results.flight_rows import FlightRow, tabulate_flights

if TYPE_CHECKING:
    import xarray as xr


REPLAY_TOLERANCES = {"float64": 1e-9, "float32": 1e-5}
"""Of a quantity's scale: what rounding changes between a flight alone and one in a batch, by the precision."""
_SCALES = {"s": 100.0, "m": 1e4, "m s-1": 150.0, "1": 1.0}


def replay_differences(
    store: CampaignStore, number: int, summary: dict[str, Any], *, met: bool
) -> dict[str, float | str]:
    """What differs between a flight flown again and its row.

    Parameters
    ----------
    store
        Of the campaign.
    number
        Of the flight, complete in the store.
    summary, met
        Of the flight flown again.

    Returns
    -------
    By quantity the greatest difference over its scale, where that is more than `SAME` of the campaign's precision; of
    texts what the row says.
    """
    return row_differences(
        store.dataset(), number, FlightRow(summary["aircraft"], summary["fleet"], summary["requirements"], met)
    )


def row_differences(data: "xr.Dataset", number: int, row: FlightRow) -> dict[str, float | str]:
    """As `departures`, of a row that was flown again; the campaign is as `CampaignStore.dataset` gives it."""
    same, data = REPLAY_TOLERANCES[data.attrs["precision"]], data.sel(flight=number)
    found: dict[str, float | str] = {}
    for name, (_, values, labels) in tabulate_flights([row], data.sizes["aircraft"]).items():
        kept, flown = data[name].values, values[0]
        if values.dtype.kind != "f":
            if not np.array_equal(kept, flown):
                found[name] = str(kept)
            continue
        off = np.where(np.isnan(kept) & np.isnan(flown), 0.0, np.abs(kept - flown)) / _SCALES[labels["units"]]
        if not np.all(off <= same):
            found[name] = float(np.max(off))
    return found


_FOLDER = "worst"
_FLIGHT, _SUMMARY = "flight.nc", "summary.json"


def archive_worst(store: CampaignStore, progress: Progress | None = None) -> tuple[Path, ...]:
    """Fly the worst flights again and keep them, as the study's table [keep] asks; a folder that is whole stays.

    Flights that could not begin are not among them: there is nothing to keep of them but their reason, which is in the
    store.

    Parameters
    ----------
    store
        Of a campaign that has ended.
    progress
        Called with what is being done and the part that is behind, 0..1.

    Returns
    -------
    The folders, those that were there before too.
    """
    count = store.study.keep.worst if store.study.keep is not None else 0
    if not count:
        return ()
    tell, data = progress or no_progress, store.dataset()
    begun = data.isel(flight=np.flatnonzero(data["reason"].values == ""))
    found, numbers = [], worst_flights(begun, count)
    for k, number in enumerate(numbers):
        tell(f"keeping the worst {len(numbers)} flights", k / len(numbers))
        folder = _folder(store, number)
        if not _is_whole(folder) and not _archive_flight(store, number, folder):
            continue
        found.append(folder)
    return tuple(found)


def archived_flight(store: CampaignStore, number: int) -> Path | None:
    """The file of a flight that was kept whole; None where it was not."""
    path = _folder(store, number) / _FLIGHT
    return path if path.is_file() else None


def _is_whole(folder: Path) -> bool:
    """Whether a folder has a flight and its summary, both as they were written."""
    try:
        return verify_checksum(folder / _FLIGHT) and read_document(folder / _SUMMARY)[1]
    except (DamagedFileError, FileNotFoundError):
        return False


def _archive_flight(store: CampaignStore, number: int, folder: Path) -> bool:
    """Fly a flight into a folder, which is whole or not there; False where it does not begin again."""
    try:
        flown = run(flight_scenario(store, number), precision=store.study.precision)
    except (ScenarioError, NoPlanError):  # it began in the campaign: another version, or rounding
        return False
    folder.parent.mkdir(exist_ok=True)
    with staged_folder(folder.parent) as beside:
        flown.save(beside / folder.name)
    return True


def _folder(store: CampaignStore, number: int) -> Path:
    return store.folder / _FOLDER / f"flight-{number:06d}"
