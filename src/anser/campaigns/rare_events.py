"""Estimate the probability of a rare event in a study's flights by subset simulation, and read the results."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from anser.campaigns.processes import choose_processes, process_limit, require_processes, worker_processes
from anser.campaigns.rare_flights import RareFlights, RareStore, fly_repetitions
from anser.campaigns.store_integrity import refuse_existing
from anser.campaigns.study import RareEventConfig, load_study, located_in
from anser.campaigns.subset import Repetition, SubsetEstimate, estimate
from anser.missions.batches import Progress, no_progress
from anser.missions.flight_batches import FlightCase
from anser.missions.plans import plan
from anser.missions.runs import FlightResult, run
from anser.results.documents import finite_or_none, version_attributes, write_json
from anser.results.flight_rows import AIRCRAFT_QUANTITIES, FLEET_QUANTITIES

_WORST = 10
_THRESHOLDS = 121
"""Number of thresholds at which the exceedance curve is computed."""


@dataclass(frozen=True)
class RareEvent:
    """A completed rare-event analysis: probability, exceedance curve and worst flights.

    Subset simulation writes the small probability of the event as a product of larger conditional probabilities. A
    level contains the flights that are at least as bad as a bound; the bounds approach the event from level to level.
    """

    store: RareStore  #: Stored study, scenario and values of the flights.
    repetitions: tuple[Repetition, ...]  #: Levels of each independent repetition of the subset simulation.

    @property
    def folder(self) -> Path:
        """Folder with the results of the analysis."""
        return self.store.folder

    @property
    def estimate(self) -> SubsetEstimate:
        """Estimated probability that the study's threshold is breached, with confidence interval.

        The probability is None if the levels did not reach the threshold.
        """
        return self.probability_of(self.flights.config.threshold)

    @property
    def flights(self) -> RareFlights:
        """Definition of the study's flights: random numbers, scenarios and statistic; see `RareFlights`."""
        return RareFlights(self.store.study, self.store.scenario)

    @property
    def document(self) -> dict[str, Any]:
        """Content of `rare.json`: the results as plain data for JSON; numbers that are not finite are None."""
        store, flights, estimate = self.store, self.flights, self.estimate
        rare, levels = flights.config, self._levels()
        last_values = np.concatenate([repetition[-1].values for repetition in self.repetitions])
        return {
            **{key: store.attributes[key] for key in ("format_version", "study_hash", "scenario_hash")},
            "seed": store.study.seed,
            **version_attributes(),
            "study": store.study.name,
            "scenario": store.scenario.name,
            "statistic": rare.statistic,
            "threshold": rare.threshold,
            "breached": _breached_side(rare),
            "probability": estimate.probability,
            "low": estimate.low,
            "high": estimate.high,
            "confidence": store.study.answers.confidence,
            "repetitions": rare.repetitions,
            "flights": sum(level["flights"] for level in levels),
            "failed_share_of_last_level": float(np.mean(np.isinf(last_values))),
            "levels": levels,
            "worst": [
                {
                    "flight": number,
                    rare.statistic: finite_or_none(flights.signed_value(value)),
                    "flights": point["flights"][: point["count"]].tolist(),
                    "weights": point["weights"][: point["count"]].tolist(),
                }
                for value, number, point in self._worst_points()
            ],
        }

    @property
    def dataset(self) -> xr.Dataset:
        """Exceedance curve: probability that the statistic exceeds a threshold, with confidence interval.

        If small values of the statistic are bad, the probability is that of a value below the threshold. The thresholds
        (m or s) run from the median of the first level (plain Monte Carlo, probability 1/2) to the study's threshold,
        or to the last bound if the levels did not reach the study's threshold.
        """
        flights, repetitions = self.flights, self.repetitions
        rare, confidence = flights.config, flights.study.answers.confidence
        last_bound = min(flights.threshold, *(item[-1].bound for item in repetitions if len(item) > 1), np.inf)
        reached = estimate(repetitions, flights.threshold, confidence).probability is not None
        curve_end = flights.threshold if reached else float(np.nextafter(last_bound, -np.inf))
        # if half of the flights breach the threshold, or the median is infinite, the curve is a single point
        median = float(np.median(np.concatenate([item[0].values for item in repetitions])))
        values = np.linspace(median if median < curve_end else curve_end, curve_end, _THRESHOLDS)
        estimates = [estimate(repetitions, value, confidence) for value in values]
        probabilities = [np.nan if item.probability is None else item.probability for item in estimates]
        unit, description = (AIRCRAFT_QUANTITIES | FLEET_QUANTITIES)[rare.statistic]
        return xr.Dataset(
            {
                "probability": ("threshold", probabilities),
                "low": ("threshold", [item.low for item in estimates]),
                "high": ("threshold", [item.high for item in estimates]),
            },
            {"threshold": ("threshold", flights.signed_value(1.0) * values, {"units": unit, "long_name": description})},
            {
                "title": flights.study.name,
                "statistic": rare.statistic,
                "asked": rare.threshold,
                "breached": _breached_side(rare),
                "confidence": confidence,
                "reached": int(reached),
                "bounds": [flights.signed_value(level.bound) for item in repetitions for level in item[1:]],
            },
        )

    def probability_of(self, threshold: float) -> SubsetEstimate:
        """Estimate the probability that the statistic breaches `threshold`, m or s.

        If the levels did not reach the threshold, the probability is None and only the upper bound is meaningful.
        Raises ValueError if the threshold is NaN or more extreme than the threshold of the study.
        """
        flights, confidence = self.flights, self.store.study.answers.confidence
        value = flights.signed_value(threshold)
        if not value <= flights.threshold:
            bound = "at least" if flights.config.breached_below else "at most"
            text = f"{bound} {flights.config.threshold:g}, the study's rare.threshold, at which its levels end"
            raise ValueError(f"threshold: arrived {threshold!r}; expected {text}")
        direct = estimate(self.repetitions, value, confidence)
        if direct.probability is not None:
            return direct
        # exceeding the value is at most as probable as exceeding the greatest bound reached by every repetition
        reached_bound = min(value, *(repetition[-1].bound for repetition in self.repetitions))
        high = estimate(self.repetitions, np.nextafter(reached_bound, -np.inf), confidence).high
        return SubsetEstimate(None, 0.0, high)

    def worst(self, rank: int = 0) -> FlightCase:
        """Return the scenario and random numbers of one of the ten worst flights, ready to fly; rank 0 is the worst.

        Raises ValueError if `rank` is out of range, ScenarioError if the sampled values make an invalid scenario.
        """
        points = self._worst_points()
        if not 0 <= rank < len(points):
            raise ValueError(f"rank: arrived {rank}; expected one from 0 to {len(points) - 1}")
        return self.flights.case(points[rank][2])

    def fly_worst(self, rank: int = 0) -> FlightResult:
        """Fly one of the ten worst flights again, alone, and return its complete results; rank 0 is the worst.

        Raises the errors of `worst`, and NoPlanError if the flight has no plan.
        """
        case = self.worst(rank)
        planned = plan(case.scenario, randomness=case.randomness)
        return run(case.scenario, planned=planned, precision=self.flights.study.precision)

    def _levels(self) -> list[dict[str, Any]]:
        """Return for each level the number of flights and, for each repetition, bound, share and acceptance rate."""
        flights, levels = self.flights, []
        for k in range(max(map(len, self.repetitions))):
            reaching = [repetition[k] for repetition in self.repetitions if len(repetition) > k]
            points = flights.plan.points if k == 0 else flights.plan.points - flights.plan.chains
            levels.append(
                {
                    "flights": len(reaching) * points,
                    "bounds": [finite_or_none(flights.signed_value(level.bound)) for level in reaching],
                    "shares": [level.share for level in reaching],
                    "acceptances": [finite_or_none(level.acceptance) for level in reaching],
                }
            )
        return levels

    def _worst_points(self) -> list[tuple[float, int, np.ndarray]]:
        """Return the worst distinct flights of the repetitions' last levels, at most ten, worst first.

        Each entry has the signed value (greater is worse), the flight's number, and its point of random numbers.
        """
        points_by_number = {
            int(number): (float(value), int(number), point)
            for level in (repetition[-1] for repetition in self.repetitions)
            for value, number, point in zip(level.values, level.numbers, level.points, strict=True)
        }
        return sorted(points_by_number.values(), key=lambda worst: (-worst[0], worst[1]))[:_WORST]


def _breached_side(config: RareEventConfig) -> str:
    return "below" if config.breached_below else "above"


def rare(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    processes: int | None = None,
    progress: Progress | None = None,
) -> RareEvent:
    """Estimate the probability of a rare event, by subset simulation over the random numbers of a study's flights.

    The first level is plain Monte Carlo. The worst flights of each level start the Markov chains of the next level, up
    to the threshold. The confidence interval follows from the scatter of several independent repetitions. In a script
    with several processes, call this function below ``if __name__ == "__main__":``.

    Parameters
    ----------
    study
        Study file (TOML) with a table [rare].
    out
        Folder of the results; new, unless `resume`.
    resume
        Whether to continue the analysis in the folder; damaged batches are flown again.
    processes
        Number of concurrent processes; None: one per core, limited by the free memory.
    progress
        Called with a message and the completed fraction of the current level's flights, 0..1.

    Returns
    -------
    The analysis; its document is in `rare.json`, a figure in `rare.svg` and `rare.png`.

    Raises
    ------
    ScenarioError
        The study or its scenario is invalid, has no rare event, or every flight makes an invalid scenario.
    ValueError
        `processes` is not a whole number from 1.
    StoreError
        The analysis to resume is missing, belongs to another study or version, or is being flown by another process; or
        a process was killed.
    FileExistsError
        The folder exists and `resume` is False.
    """
    from anser.report.campaign_figures import draw_rare

    require_processes(processes)
    store, report = open_rare_store(study, Path(out), resume=resume), progress or no_progress
    batch = RareFlights(store.study, store.scenario).batch
    processes = choose_processes(processes, lambda: process_limit(store.scenario, batch), report)
    with store.locked():
        for message in store.damages:
            report(message, None)
        with worker_processes(processes) as executor:
            event = RareEvent(store, fly_repetitions(store, executor, report))
        write_json(event.document, store.folder / "rare.json", overwrite=True)
        draw_rare(event.dataset, store.folder)
    return event


def open_rare_store(study: str | os.PathLike[str], folder: Path, *, resume: bool) -> RareStore:
    """Create the store of a new analysis or, if `resume`, open the existing store. Errors: see `rare`."""
    requested, scenario, _ = load_study(study)
    flights = RareFlights(requested, scenario)
    with located_in(study, requested):
        _ = flights.config
    if resume:
        store = RareStore.open(folder, verify_chunks=False)
        store.refuse_unless_same(requested, scenario)
        return store
    refuse_existing(folder)
    with located_in(study, requested):
        flights.refuse_early()
    return RareStore.create(folder, requested, scenario)


def read_rare(folder: str | os.PathLike[str]) -> RareEvent:
    """Read a completed rare-event analysis from its folder.

    Raises StoreError if the folder has no analysis, a file is damaged, or flights are missing.
    """
    store = RareStore.open(Path(folder))
    return RareEvent(store, fly_repetitions(store, None, no_progress, fly=False))
