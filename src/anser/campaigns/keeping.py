"""The worst flights of a campaign, kept whole: each in a folder as `anser run` leaves it."""

from pathlib import Path

import numpy as np

from anser.campaigns.answering import worst_flights
from anser.campaigns.flying import flight_of
from anser.campaigns.store import CampaignStore
from anser.execution import NoPlanError, run
from anser.execution.batches import Progress, silent
from anser.output_files import replaced_within
from anser.results.checksums import DamagedFileError, read_document, verify_checksum
from anser.scenario import ScenarioError

_FOLDER = "worst"
_FLIGHT, _SUMMARY = "flight.nc", "summary.json"


def keep_worst(store: CampaignStore, progress: Progress | None = None) -> tuple[Path, ...]:
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
    tell, data = progress or silent, store.dataset()
    begun = data.isel(flight=np.flatnonzero(data["reason"].values == ""))
    found, numbers = [], worst_flights(begun, count)
    for k, number in enumerate(numbers):
        tell(f"keeping the worst {len(numbers)} flights", k / len(numbers))
        folder = _folder(store, number)
        if not _is_whole(folder) and not _keep(store, number, folder):
            continue
        found.append(folder)
    return tuple(found)


def kept_flight(store: CampaignStore, number: int) -> Path | None:
    """The file of a flight that was kept whole; None where it was not."""
    path = _folder(store, number) / _FLIGHT
    return path if path.is_file() else None


def _is_whole(folder: Path) -> bool:
    """Whether a folder has a flight and its summary, both as they were written."""
    try:
        return verify_checksum(folder / _FLIGHT) and read_document(folder / _SUMMARY)[1]
    except (DamagedFileError, FileNotFoundError):
        return False


def _keep(store: CampaignStore, number: int, folder: Path) -> bool:
    """Fly a flight into a folder, which is whole or not there; False where it does not begin again."""
    try:
        flown = run(flight_of(store, number), precision=store.study.precision)
    except (ScenarioError, NoPlanError):  # it began in the campaign: another version, or rounding
        return False
    folder.parent.mkdir(exist_ok=True)
    with replaced_within(folder.parent) as beside:
        flown.save(beside / folder.name)
    return True


def _folder(store: CampaignStore, number: int) -> Path:
    return store.folder / _FOLDER / f"flight-{number:06d}"
