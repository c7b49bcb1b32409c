"""A campaign for people: fly a study, or what is missing of it, and read its answers."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from anser.campaigns.campaign_report import BACKGROUND_FLIGHTS, WORST_FLIGHTS, write_campaign
from anser.campaigns.estimates import CampaignEstimates, estimate_campaign
from anser.campaigns.flights import (
    applied_values,
    campaign_process_limit,
    campaign_seeds,
    create_store,
    flight_scenario,
    fly_campaign,
)
from anser.campaigns.replay import archive_worst
from anser.campaigns.sensitivity import Influences, influences
from anser.campaigns.store import CampaignStore, repair_base
from anser.campaigns.study import load_study, validate_study
from anser.files import new_folder
from anser.missions.batches import Progress
from anser.scenario.schema import Scenario

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Campaign:
    """A campaign in its folder, whole or as far as it was flown.

    Attributes
    ----------
    store
        Its store.
    """

    store: CampaignStore

    @property
    def folder(self) -> Path:
        """Its folder."""
        return self.store.folder

    @property
    def dataset(self) -> "xr.Dataset":
        """Values applied and what came of each flight; dimensions flight and aircraft."""
        return self.store.dataset()

    @property
    def series(self) -> "xr.Dataset":
        """What the study's table [keep] has kept over time; dimensions flight, aircraft and time.

        Raises StoreError where that is nothing.
        """
        return self.store.series()

    def estimates(self) -> CampaignEstimates:
        """Probabilities and quantiles, with intervals."""
        return estimate_campaign(self.dataset, self.store.flights, self.store.study)

    def influences(self) -> Influences:
        """What the outputs depend on: Sobol indices of a Saltelli sampling, else rank correlations."""
        return influences(self.dataset, self.store.study, self.store.varied)

    def report(
        self, worst: int = WORST_FLIGHTS, others: int = BACKGROUND_FLIGHTS, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """Write `report.html` and the tables into the folder; see `anser.campaigns.write_campaign`."""
        return write_campaign(self.store, worst, others, progress)

    def flight(self, number: int) -> Scenario:
        """Scenario of one flight, for `anser.run`; ValueError where there is none, ScenarioError where it is none."""
        return flight_scenario(self.store, number)


def campaign(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    processes: int | None = None,
    cluster: str | None = None,
    precision: str | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Fly a study: a scenario many times, with numbers of it dispersed.

    Each flight is a scenario of its own, with its own seed and the values applied, validated as any other: what comes
    of one that is refused, or fails, is a row with the reason. In a script of several processes, call this below
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    study
        A study file (TOML).
    out
        Folder for the store; new, unless `resume`.
    resume
        Whether to fly what is missing or damaged of the campaign in that folder.
    processes
        How many fly at a time; None: one for each core, or as many as the free memory holds.
    cluster
        Address of a running scheduler of dask.distributed, whose workers fly instead; they must see the folder.
    precision
        In which flights are flown, "float64" or "float32", in place of what the study says; None: as it says.
    progress
        Called with what is being done and the part of the flights that is behind, 0..1.

    Raises
    ------
    ScenarioError
        The study or its scenario is not valid, or no flight of it makes a valid scenario.
    StoreError
        There is no campaign to go on with, or one of another study or version, or one that another process flies; or
        no space for one.
    FileExistsError
        The folder exists and `resume` is not asked for.
    """
    store = open_campaign_store(study, Path(out), resume=resume, precision=precision)
    if processes is None and cluster is None:
        room = campaign_process_limit(store)
        processes = room.processes
        if room.message and progress is not None:
            progress(room.message, None)
    with store.locked():
        if progress is not None:
            for message in store.damages:
                progress(message, None)
        fly_campaign(store, processes or 1, progress, cluster)
        archive_worst(store, progress)
    return Campaign(store)


def open_campaign_store(
    study: str | os.PathLike[str], folder: Path, *, resume: bool, precision: str | None = None
) -> CampaignStore:
    """The store to fly into: a new one, or one to go on with; raises as `campaign` does."""
    wanted, scenario, given = load_study(study)
    if precision is not None:
        wanted = validate_study({**wanted.model_dump(exclude_unset=True), "precision": precision}, os.fspath(study))
    if resume:
        applied = applied_values(wanted, scenario, given)
        repair_base(folder, wanted, scenario, applied, campaign_seeds(wanted, applied))
        store = CampaignStore.open(folder, verify_chunks=False)
        store.refuse_unless_same(wanted, scenario, applied)
        return store
    if folder.exists():
        raise FileExistsError(f"{folder} exists and is not overwritten: choose another folder, or resume")
    with new_folder(folder) as beside:
        create_store(beside, wanted, scenario, given)
    return CampaignStore.open(folder)
