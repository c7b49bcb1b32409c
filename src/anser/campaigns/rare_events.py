"""Rare-event analysis for users.

Fly a study by subset simulation and read the probability, the exceedance curve and the worst flights (`rare`,
`RareEvent`, `read_rare`).
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from anser.campaigns.processes import choose_processes, process_limit, worker_processes
from anser.campaigns.rare_flights import RareFlights, fly_points
from anser.campaigns.rare_store import RareStore, provenance
from anser.campaigns.store_integrity import refuse_existing
from anser.campaigns.study import load_study
from anser.campaigns.subset import Repetition, SubsetEstimate, estimate, subset_simulation
from anser.missions.batches import Progress, no_progress
from anser.missions.flight_batches import FlightCase
from anser.missions.plans import plan
from anser.missions.runs import FlightResult, run
from anser.results.documents import finite_or_none, write_json
from anser.results.flight_rows import AIRCRAFT_QUANTITIES, FLEET_QUANTITIES

_WORST = 10
_THRESHOLDS = 121
"""Number of points of the exceedance curve."""


class WorstPoint(NamedTuple):
    """A flight of the last level: signed value (greater is worse), number, and random numbers as a point."""

    value: float
    number: int
    point: np.ndarray


def worst_points(repetitions: Sequence[Repetition]) -> list[WorstPoint]:
    """Return the worst distinct flights of the repetitions' last levels, the worst first, at most ten."""
    points_by_number: dict[int, WorstPoint] = {}
    for repetition in repetitions:
        for value, number, point in zip(
            repetition[-1].values, repetition[-1].numbers, repetition[-1].points, strict=True
        ):
            points_by_number[int(number)] = WorstPoint(float(value), int(number), point)
    return sorted(points_by_number.values(), key=lambda worst: (-worst.value, worst.number))[:_WORST]


def rare_document(
    store: RareStore, flights: RareFlights, repetitions: Sequence[Repetition], probability_estimate: SubsetEstimate
) -> dict[str, Any]:
    """Return the results of a rare-event analysis as plain data for JSON; values that are not finite become None."""
    rare, plan = flights.config, flights.plan

    def quantity(value: float) -> float | None:
        return finite_or_none(flights.signed_value(value))

    levels = []
    for k in range(max(map(len, repetitions))):
        reaching = [item[k] for item in repetitions if len(item) > k]
        levels.append(
            {
                "flights": len(reaching) * (plan.points if k == 0 else plan.points - plan.chains),
                "bounds": [quantity(item.bound) for item in reaching],
                "shares": [item.share for item in reaching],
                "acceptances": [finite_or_none(item.acceptance) for item in reaching],
            }
        )
    last_values = np.concatenate([item[-1].values for item in repetitions])
    return {
        **provenance(store.study, store.scenario),
        "study": store.study.name,
        "scenario": store.scenario.name,
        "statistic": rare.statistic,
        "threshold": rare.threshold,
        "breached": "below" if rare.breached_below else "above",
        "probability": probability_estimate.probability,
        "low": probability_estimate.low,
        "high": probability_estimate.high,
        "confidence": store.study.answers.confidence,
        "repetitions": plan.repetitions,
        "flights": sum(level["flights"] for level in levels),
        "failed_share_of_last_level": float(np.mean(np.isinf(last_values))),
        "levels": levels,
        "worst": [
            {
                "flight": item.number,
                rare.statistic: quantity(item.value),
                "flights": item.point["flights"][: item.point["count"]].tolist(),
                "weights": item.point["weights"][: item.point["count"]].tolist(),
            }
            for item in worst_points(repetitions)
        ],
    }


def exceedance_dataset(flights: RareFlights, repetitions: Sequence[Repetition]) -> xr.Dataset:
    """Compute the curve of exceedance probability against threshold, with confidence interval.

    The curve starts at the median of the plain Monte Carlo flights (probability one half) and ends at the study's
    threshold, or short of it at the last bound that the levels reached.
    """
    rare, confidence = flights.config, flights.study.answers.confidence
    first_values = np.concatenate([item[0].values for item in repetitions])
    last_bound = min(flights.threshold, *(item[-1].bound for item in repetitions if len(item) > 1), np.inf)
    reached = estimate(repetitions, flights.threshold, confidence).probability is not None
    curve_end = flights.threshold if reached else float(np.nextafter(last_bound, -np.inf))
    # if half of the flights breach the threshold, or the median is infinite, the curve is a single point
    median = float(np.median(first_values))
    values = np.linspace(median if median < curve_end else curve_end, curve_end, _THRESHOLDS)
    estimates = [estimate(repetitions, value, confidence) for value in values]
    unit, description = (AIRCRAFT_QUANTITIES | FLEET_QUANTITIES)[rare.statistic]
    breached_side = "below" if rare.breached_below else "above"
    return xr.Dataset(
        {
            key: ("threshold", [np.nan if getattr(item, key) is None else getattr(item, key) for item in estimates])
            for key in ("probability", "low", "high")
        },
        {"threshold": ("threshold", flights.signed_value(1.0) * values, {"units": unit, "long_name": description})},
        {
            "title": flights.study.name,
            "statistic": rare.statistic,
            "asked": rare.threshold,
            "breached": breached_side,
            "confidence": confidence,
            "reached": int(reached),
            "bounds": [flights.signed_value(level.bound) for item in repetitions for level in item[1:]],
        },
    )


_DOCUMENT = "rare.json"


@dataclass(frozen=True)
class RareEvent:
    """A completed rare-event analysis: probability, exceedance curve and worst flights.

    Attributes
    ----------
    store
        Store of the analysis.
    repetitions
        Levels of each independent repetition of the subset simulation.
    """

    store: RareStore
    repetitions: tuple[Repetition, ...]

    @property
    def folder(self) -> Path:
        """Folder of the analysis."""
        return self.store.folder

    @property
    def estimate(self) -> SubsetEstimate:
        """Probability of the event with confidence interval; probability None if the threshold was not reached."""
        return self.probability_of(self.flights.config.threshold)

    @property
    def flights(self) -> RareFlights:
        """Definition of the flights: their random numbers, scenarios and signed values."""
        return RareFlights(self.store.study, self.store.scenario)

    @property
    def document(self) -> dict[str, Any]:
        """Content of `rare.json`: the results as plain data."""
        return rare_document(self.store, self.flights, self.repetitions, self.estimate)

    @property
    def dataset(self) -> "xr.Dataset":
        """Exceedance probability against the threshold, with confidence interval; see `exceedance_dataset`."""
        return exceedance_dataset(self.flights, self.repetitions)

    def probability_of(self, threshold: float) -> SubsetEstimate:
        """Estimate the probability that a threshold less extreme than the study's is breached.

        If the levels did not reach the threshold, the probability is None and only the upper bound is meaningful.
        """
        value, confidence = self.flights.signed_value(threshold), self.store.study.answers.confidence
        direct = estimate(self.repetitions, value, confidence)
        if direct.probability is not None:
            return direct
        # exceeding the value is at most as probable as exceeding the greatest bound reached by every repetition
        reached_bound = min(value, *(repetition[-1].bound for repetition in self.repetitions))
        high = estimate(self.repetitions, np.nextafter(reached_bound, -np.inf), confidence).high
        return SubsetEstimate(None, 0.0, high)

    def worst(self, rank: int = 0) -> FlightCase:
        """Return one of the worst flights, ready to fly; rank 0 is the worst.

        Raises ValueError if `rank` is out of range, ScenarioError if the sampled values are not a valid scenario.
        """
        points = worst_points(self.repetitions)
        if not 0 <= rank < len(points):
            raise ValueError(f"rank: arrived {rank}; expected one from 0 to {len(points) - 1}")
        return self.flights.case(points[rank].point)

    def fly_worst(self, rank: int = 0) -> FlightResult:
        """Fly one of the worst flights again, alone, with the complete results of `anser.run`; rank 0 is the worst."""
        case = self.worst(rank)
        planned = plan(case.scenario, randomness=case.randomness)
        return run(case.scenario, planned=planned, precision=self.flights.study.precision)


def rare(
    study: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    processes: int | None = None,
    progress: Progress | None = None,
) -> RareEvent:
    """Estimate the probability of a rare event, by subset simulation over the random numbers of a study's flights.

    The first level is plain Monte Carlo. Its worst flights start the Markov chains of the next level, which vary the
    random numbers but accept only flights at least as bad as the level's bound, and so on up to the threshold. The
    simulation is repeated several times independently; the interval is that of the mean over the repetitions. In a
    script with several processes, call this function below ``if __name__ == "__main__":``.

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
        Called with a message and the completed fraction of the level, 0..1.

    Returns
    -------
    The analysis; its document is in `rare.json`, a figure in `rare.svg` and `rare.png`.

    Raises
    ------
    ScenarioError
        The study or its scenario is invalid, has no rare event, or every flight makes an invalid scenario.
    StoreError
        The analysis to resume is missing, belongs to another study or version, or is being flown by another process; or
        a process was killed.
    FileExistsError
        The folder exists and `resume` is False.
    """
    from anser.report.campaign_figures import draw_rare

    store = open_rare_store(study, Path(out), resume=resume)
    report = progress or no_progress
    processes = choose_processes(
        processes,
        lambda: process_limit(store.scenario, RareFlights(store.study, store.scenario).batch),
        progress,
    )
    with store.locked():
        for message in store.damages:
            report(message, None)
        with worker_processes(processes) as executor:
            event = RareEvent(store, _repetitions(store, executor, report))
        write_json(event.document, store.folder / _DOCUMENT, overwrite=True)
        draw_rare(event.dataset, store.folder)
    return event


def open_rare_store(study: str | os.PathLike[str], folder: Path, *, resume: bool) -> RareStore:
    """Create a new store, or with `resume` open the store to continue; raises the errors of `rare`."""
    requested, scenario, _ = load_study(study)
    flights = RareFlights(requested, scenario)
    _ = flights.config
    if resume:
        store = RareStore.open(folder)
        store.refuse_unless_same(requested, scenario)
        return store
    refuse_existing(folder)
    flights.refuse_early()
    return RareStore.create(folder, requested, scenario)


def read_rare(folder: str | os.PathLike[str]) -> RareEvent:
    """Read a completed rare-event analysis from its folder; raises StoreError if flights are missing."""
    store = RareStore.open(Path(folder))
    return RareEvent(store, _repetitions(store, None, no_progress, fly=False))


def _repetitions(
    store: RareStore, executor: Executor | None, tell: Progress, *, fly: bool = True
) -> tuple[Repetition, ...]:
    flights = RareFlights(store.study, store.scenario)
    limit_state = _limit_state(store, flights, executor, tell, fly=fly)
    return subset_simulation(flights.space, limit_state, flights.threshold, flights.plan, store.study.seed)


def _limit_state(
    store: RareStore, flights: RareFlights, executor: Executor | None, report: Progress, *, fly: bool
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return a function that gives the signed value (greater is worse) of each point of random numbers.

    The function takes stored values or flies missing flights, and reports progress; with `fly=False` a missing flight
    is an error.
    """
    plan, flown_count, level = flights.plan, 0, 0

    def values(points: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        nonlocal flown_count, level
        start = int(numbers[0])
        level_count = plan.points * plan.repetitions if start == 0 else points.size * (plan.length - 1)
        if start == 0 or flown_count >= level_count:
            flown_count, level = 0, level + 1
        results = np.full(points.size, np.nan)
        for index, part in fly_points(store, executor, points, start, fly=fly):
            results[index : index + part.size] = part
            flown_count += part.size
            report(f"level {level}: {flown_count} of {level_count} flights", flown_count / level_count)
        return results

    return values
