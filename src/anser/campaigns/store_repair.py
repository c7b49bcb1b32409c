"""Files of a campaign's store that are written once, made anew where they are damaged."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from anser.campaigns.store import STORE_FOLDER, CampaignStore
from anser.campaigns.store_checksums import StoreChecksums
from anser.campaigns.store_lock import StoreError
from anser.campaigns.study import Study
from anser.results import DamagedFileError
from anser.results.checksums import file_digest
from anser.scenario import Scenario


def repair_base(
    folder: Path, study: Study, scenario: Scenario, applied: Mapping[str, np.ndarray], seeds: np.ndarray
) -> tuple[str, ...]:
    """Make damaged metadata, coordinates, seeds and sampled values of a store anew, where they come out as recorded.

    Parameters
    ----------
    folder
        Of the campaign.
    study, scenario, applied, seeds
        As `CampaignStore.create` takes them.

    Returns
    -------
    Paths of the files that were made anew.

    Raises
    ------
    StoreError
        The record of checksums is damaged, or a file comes out otherwise: of another study or version.
    """
    checksums = StoreChecksums(folder, STORE_FOLDER)
    if not checksums.exist:
        return ()
    try:
        problems, chunk = checksums.base_problems(), checksums.base_number("chunk")
    except DamagedFileError as error:
        raise StoreError(str(error)) from None
    if not problems:
        return ()
    with tempfile.TemporaryDirectory(dir=folder, prefix=".anser-") as place:
        CampaignStore.create(Path(place), study, scenario, applied, seeds, chunk)
        anew = Path(place) / STORE_FOLDER
        for name, digest in problems.items():
            if not (anew / name).is_file() or file_digest(anew / name) != digest:
                words = "a damaged file that this study and version do not make anew; expected those of the campaign"
                raise StoreError(f"{folder / STORE_FOLDER / name}: arrived {words}, to go on with it")
        for name in problems:
            target = folder / STORE_FOLDER / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (anew / name).replace(target)
    return tuple(str(folder / STORE_FOLDER / name) for name in problems)
