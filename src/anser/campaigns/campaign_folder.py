"""Fly the campaign of a study file, resume an interrupted campaign, and read its results."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

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
from anser.campaigns.processes import choose_processes, require_processes
from anser.campaigns.replay import archive_worst
from anser.campaigns.sensitivity import Influences, influences
from anser.campaigns.store import CampaignStore, repair_base
from anser.campaigns.store_integrity import refuse_existing
from anser.campaigns.study import load_study, located_in, validate_study
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.files import new_folder
from anser.missions.batches import Progress, no_progress
from anser.scenario.schema import Scenario


@dataclass(frozen=True)
class Campaign:
    """Campaign of a study file, complete or partly flown, with the results in a folder."""

    store: CampaignStore  #: Stored study, base scenario, sampled values and results.

    @property
    def folder(self) -> Path:
        """Folder of the campaign."""
        return self.store.folder

    @property
    def dataset(self) -> xr.Dataset:
        """Sampled values and results of each completed flight; dimensions flight and aircraft."""
        return self.store.dataset()

    @property
    def series(self) -> xr.Dataset:
        """Time series that the study's table [keep] selects; dimensions flight (completed flights), aircraft and time.

        Raises StoreError if the study selects no time series, or a file is damaged.
        """
        return self.store.series()

    def estimates(self) -> CampaignEstimates:
        """Estimate success probability and quantiles, with confidence intervals; count the causes of failures."""
        return estimate_campaign(self.dataset, self.store.flights, self.store.study)

    def influences(self) -> Influences:
        """Compute the sensitivity of each output to each varied parameter.

        The measures are Sobol indices for Saltelli sampling, and Spearman's rank correlations for other sampling.
        """
        return influences(self.dataset, self.store.study, self.store.varied)

    def report(
        self, worst: int = WORST_FLIGHTS, background: int = BACKGROUND_FLIGHTS, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """Write `report.html`, figures and tables into the folder, replacing former files, and return their paths.

        The map of the report shows the worst flights (number: `worst`; 0: no map) and `background` evenly spaced other
        flights; flights that are not archived are flown again. `progress` is called with a message and the completed
        fraction, 0..1. Raises StoreError if no flight is complete, ValueError if a number is not 0 to 1000.
        """
        for name, number in (("worst", worst), ("background", background)):
            if not 0 <= number <= 1000:
                raise ValueError(f"{name}: arrived {number}; expected a number of flights from 0 to 1000")
        return write_campaign(self.store, worst, background, progress)

    def flight(self, number: int) -> Scenario:
        """Return the scenario of flight `number` (from 0) with its sampled values and seed, for `anser.run`.

        Raises ValueError if `number` is out of range, ScenarioError if the sampled values make an invalid scenario.
        """
        return flight_scenario(self.store, number)


def campaign(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    processes: int | None = None,
    cluster: str | None = None,
    precision: str | None = None,
    outputs: Sequence[Mapping[str, Any]] = (),
    progress: Progress | None = None,
    **user_parts: str,
) -> Campaign:
    """Fly a study: one scenario many times, with dispersed parameters.

    A flight is stored as failed, with the reason, if its scenario is invalid or the flight cannot start. In a script
    with several processes, call this function below ``if __name__ == "__main__":``.

    Parameters
    ----------
    study
        Study file (TOML).
    out
        Folder of the store; new, unless `resume`.
    resume
        Whether to fly the missing or damaged flights of the campaign in the folder.
    processes
        Number of concurrent processes; None: one per core, limited by the free memory.
    cluster
        Address of a running dask.distributed scheduler: its workers fly the campaign and need access to the folder.
    precision
        Precision of the flights, "float64" or "float32", overriding the study; None: precision of the study.
    outputs
        Outputs of each flight in addition to the study's outputs: dictionaries with the keys of a table `[[output]]`,
        such as `{"name": "bank", "expression": "abs(bank_deg)", "reduction": "greatest"}`.
    progress
        Called with a message and the completed fraction of the flights, 0..1.
    **user_parts
        Import names of user-defined parts, such as `controller="my_package:MyController"`, by the keys `controller`,
        `guidance`, `sensors`, `estimator` and `planner`. A part replaces the scenario's part with the same key.

    Returns
    -------
    The campaign: every flight is complete, unless the study's stopping rule was satisfied earlier.

    Raises
    ------
    ScenarioError
        The study or its scenario is invalid, or every flight makes an invalid scenario.
    ValueError
        `processes` is not a whole number from 1.
    StoreError
        The campaign to resume is missing, belongs to another study or version, or is being flown by another process; or
        the disk is full.
    FileExistsError
        The folder exists and `resume` is False.
    """
    require_processes(processes)
    store = open_campaign_store(
        study, Path(out), resume=resume, precision=precision, user_parts=user_parts, outputs=outputs
    )
    report = progress or no_progress
    if cluster is None:
        processes = choose_processes(processes, lambda: campaign_process_limit(store), report)
    with store.locked():
        for message in store.damages:
            report(message, None)
        fly_campaign(store, processes or 1, report, cluster)
        archive_worst(store, report)
    return Campaign(store)


def load_campaign(folder: str | os.PathLike[str]) -> Campaign:
    """Open the campaign in a folder, even if flights are still to be flown.

    Raises StoreError if the folder has no campaign, or a file is damaged.
    """
    return Campaign(CampaignStore.open(Path(folder)))


def open_campaign_store(
    study: str | os.PathLike[str],
    folder: Path,
    *,
    resume: bool,
    precision: str | None = None,
    user_parts: Mapping[str, str] | None = None,
    outputs: Sequence[Mapping[str, Any]] = (),
) -> CampaignStore:
    """Create the store of a new campaign or, if `resume`, open the existing store. Errors: see `campaign`."""
    requested, scenario, table_columns = load_study(study)
    if user_parts:
        scenario = scenario.replace("parts", {**dict(scenario.parts or {}), **user_parts})
    values = requested.model_dump(mode="json", exclude_unset=True)
    if precision is not None:
        values["precision"] = precision
    if not isinstance(outputs, Sequence) or not all(isinstance(item, Mapping) for item in outputs):
        expected = "a list of dictionaries with the keys of a table [[output]]"
        raise ScenarioError(os.fspath(study), [Problem("outputs", describe_value(outputs), expected)])
    if outputs:
        values["output"] = [*values.get("output", ()), *map(dict, outputs)]
    if precision is not None or outputs:
        requested = validate_study(values, os.fspath(study))
    if resume:
        with located_in(study, requested):
            applied = applied_values(requested, scenario, table_columns)
        repair_base(folder, requested, scenario, applied, campaign_seeds(requested, applied))
        store = CampaignStore.open(folder, verify_chunks=False)
        store.refuse_unless_same(requested, scenario)
        store.refuse_other_values(applied)
        return store
    refuse_existing(folder)
    with new_folder(folder) as staging, located_in(study, requested):
        create_store(staging, requested, scenario, table_columns)
    return CampaignStore.open(folder)
