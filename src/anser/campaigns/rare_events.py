"""A rare event, for users.

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

from anser.campaigns.flights import process_limit, worker_processes
from anser.campaigns.rare_flights import RareFlights, fly_points
from anser.campaigns.rare_store import RareStore, provenance
from anser.campaigns.store_integrity import folder_lock
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
"""Points of the curve."""


class WorstPoint(NamedTuple):
    """A flight of the last level: its value, more is worse, its number, and its point."""

    value: float
    number: int
    point: np.ndarray


def worst_points(repetitions: Sequence[Repetition]) -> list[WorstPoint]:
    """The worst flights of the last levels, each once, ten at most."""
    found: dict[int, WorstPoint] = {}
    for one in repetitions:
        for value, number, point in zip(one[-1].values, one[-1].numbers, one[-1].points, strict=True):
            found[int(number)] = WorstPoint(float(value), int(number), point)
    return sorted(found.values(), key=lambda worst: (-worst.value, worst.number))[:_WORST]


def rare_document(
    store: RareStore, flights: RareFlights, repetitions: Sequence[Repetition], found: SubsetEstimate
) -> dict[str, Any]:
    """All that is told of a rare event, for JSON; None in the place of what is not finite."""
    rare, plan = flights.config, flights.plan

    def quantity(value: float) -> float | None:
        return finite_or_none(flights.signed_value(value))

    levels = []
    for k in range(max(map(len, repetitions))):
        some = [one[k] for one in repetitions if len(one) > k]
        levels.append(
            {
                "flights": len(some) * (plan.points if k == 0 else plan.points - plan.chains),
                "bounds": [quantity(one.bound) for one in some],
                "shares": [one.share for one in some],
                "acceptances": [finite_or_none(one.acceptance) for one in some],
            }
        )
    last = np.concatenate([one[-1].values for one in repetitions])
    return {
        **provenance(store.study, store.scenario),
        "study": store.study.name,
        "scenario": store.scenario.name,
        "statistic": rare.statistic,
        "threshold": rare.threshold,
        "breached": "below" if rare.breached_below else "above",
        "probability": found.probability,
        "low": found.low,
        "high": found.high,
        "confidence": store.study.answers.confidence,
        "repetitions": plan.repetitions,
        "flights": sum(level["flights"] for level in levels),
        "failed_share_of_last_level": float(np.mean(np.isinf(last))),
        "levels": levels,
        "worst": [
            {
                "flight": one.number,
                rare.statistic: quantity(one.value),
                "flights": one.point["flights"][: one.point["count"]].tolist(),
                "weights": one.point["weights"][: one.point["count"]].tolist(),
            }
            for one in worst_points(repetitions)
        ],
    }


def exceedance_dataset(flights: RareFlights, repetitions: Sequence[Repetition]) -> xr.Dataset:
    """Probability that a threshold is breached against the threshold, with its interval, from a half down."""
    rare, confidence = flights.config, flights.study.answers.confidence
    first = np.concatenate([one[0].values for one in repetitions])
    last = min(flights.threshold, *(one[-1].bound for one in repetitions if len(one) > 1), np.inf)
    reached = estimate(repetitions, flights.threshold, confidence).probability is not None
    end = flights.threshold if reached else float(np.nextafter(last, -np.inf))
    # a threshold that half of the flights breach, or a median that is none, is a curve of one point
    middle = float(np.median(first))
    values = np.linspace(middle if middle < end else end, end, _THRESHOLDS)
    found = [estimate(repetitions, value, confidence) for value in values]
    unit, words = (AIRCRAFT_QUANTITIES | FLEET_QUANTITIES)[rare.statistic]
    side = "below" if rare.breached_below else "above"
    return xr.Dataset(
        {
            key: ("threshold", [np.nan if getattr(one, key) is None else getattr(one, key) for one in found])
            for key in ("probability", "low", "high")
        },
        {"threshold": ("threshold", flights.signed_value(1.0) * values, {"units": unit, "long_name": words})},
        {
            "title": flights.study.name,
            "statistic": rare.statistic,
            "asked": rare.threshold,
            "breached": side,
            "confidence": confidence,
            "reached": int(reached),
            "bounds": [flights.signed_value(level.bound) for one in repetitions for level in one[1:]],
        },
    )


_DOCUMENT = "rare.json"


@dataclass(frozen=True)
class RareEvent:
    """A rare event in its folder, flown.

    Attributes
    ----------
    store
        Its folder.
    repetitions
        Levels of each repetition.
    """

    store: RareStore
    repetitions: tuple[Repetition, ...]

    @property
    def folder(self) -> Path:
        """Its folder."""
        return self.store.folder

    @property
    def estimate(self) -> SubsetEstimate:
        """Probability of the event and its interval; without one where the levels end short of the threshold."""
        return self.probability_of(self.flights.config.threshold)

    @property
    def flights(self) -> RareFlights:
        """What its flights are made of."""
        return RareFlights(self.store.study, self.store.scenario)

    @property
    def document(self) -> dict[str, Any]:
        """What `rare.json` holds."""
        return rare_document(self.store, self.flights, self.repetitions, self.estimate)

    @property
    def dataset(self) -> "xr.Dataset":
        """Probability against the threshold, with its interval."""
        return exceedance_dataset(self.flights, self.repetitions)

    def probability_of(self, threshold: float) -> SubsetEstimate:
        """Probability that another threshold is breached: one that is breached more often than that of the study."""
        value, confidence = self.flights.signed_value(threshold), self.store.study.answers.confidence
        found = estimate(self.repetitions, value, confidence)
        if found.probability is not None:
            return found
        # what lies beyond the last bound that all have come to is no more probable than what lies beyond the bound
        least = min(value, *(one[-1].bound for one in self.repetitions))
        high = estimate(self.repetitions, np.nextafter(least, -np.inf), confidence).high
        return SubsetEstimate(None, 0.0, high)

    def worst(self, place: int = 0) -> FlightCase:
        """One of the worst flights, 0 for the worst of all; ScenarioError where what was drawn makes no scenario."""
        points = worst_points(self.repetitions)
        if not 0 <= place < len(points):
            raise ValueError(f"place: arrived {place}; expected one from 0 to {len(points) - 1}")
        return self.flights.case(points[place].point)

    def fly_worst(self, place: int = 0) -> FlightResult:
        """Fly one of the worst flights again by itself, with all that `anser.run` records; raises as that does."""
        case = self.worst(place)
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
    """Find out how probable a rare event is: subset simulation over all that is random in a study's flights.

    The first flights are those of plain Monte Carlo. The worst of them begin the next level, where chains of flights
    with more and more other random numbers stay among those that are at least as bad, and so on to the threshold. All
    is done several times, each independent of the others, and the interval is that of their mean. In a script of
    several processes, call this below ``if __name__ == "__main__":``.

    Parameters
    ----------
    study
        A study file (TOML) with a table [rare].
    out
        Folder for what comes of it; new, unless `resume`.
    resume
        Whether to go on with what is in that folder; what is damaged is flown again.
    processes
        How many fly at a time; None: one for each core, or as many as the free memory holds.
    progress
        Called with what is being done and the part of the level that is behind, 0..1.

    Returns
    -------
    The event; its document is in `rare.json`, a figure in `rare.svg` and `rare.png`.

    Raises
    ------
    ScenarioError
        The study or its scenario is not valid, has no rare event, or no flight of it makes a valid scenario.
    StoreError
        There is nothing to go on with, or what is of another study or version, or another process flies it; or a
        process was killed.
    FileExistsError
        The folder exists and `resume` is not asked for.
    """
    from anser.report.campaign_figures import draw_rare

    store = open_rare_store(study, Path(out), resume=resume)
    if processes is None:
        room = process_limit(store.scenario, RareFlights(store.study, store.scenario).batch)
        processes = room.processes
        if room.message and progress is not None:
            progress(room.message, None)
    with folder_lock(store.folder):
        for message in store.remove_damaged():
            (progress or no_progress)(message, None)
        with worker_processes(processes) as (executor, _):
            found = RareEvent(store, _repetitions(store, executor, progress or no_progress))
        write_json(found.document, store.folder / _DOCUMENT, overwrite=True)
        draw_rare(found.dataset, store.folder)
    return found


def open_rare_store(study: str | os.PathLike[str], folder: Path, *, resume: bool) -> RareStore:
    """The folder to fly into: a new one, or one to go on with; raises as `rare` does."""
    wanted, scenario, _ = load_study(study)
    flights = RareFlights(wanted, scenario)
    _ = flights.config
    if resume:
        store = RareStore.open(folder)
        store.refuse_unless_same(wanted, scenario)
        return store
    if folder.exists():
        raise FileExistsError(f"{folder} exists and is not overwritten: choose another folder, or resume")
    flights.refuse_early()
    return RareStore.create(folder, wanted, scenario)


def read_rare(folder: str | os.PathLike[str]) -> RareEvent:
    """A rare event that was flown, from its folder; StoreError where some of its flights are missing."""
    store = RareStore.open(Path(folder))
    return RareEvent(store, _repetitions(store, None, no_progress, fly=False))


def _repetitions(
    store: RareStore, executor: Executor | None, tell: Progress, *, fly: bool = True
) -> tuple[Repetition, ...]:
    flights = RareFlights(store.study, store.scenario)
    limit_state = _limit_state(store, flights, executor, tell, fly=fly)
    return subset_simulation(flights.space, limit_state, flights.threshold, flights.plan, store.study.seed)


def _limit_state(
    store: RareStore, flights: RareFlights, executor: Executor | None, tell: Progress, *, fly: bool
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Values of points as the walks ask for them, telling how far they are."""
    plan, behind, level = flights.plan, 0, 0

    def values(points: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        nonlocal behind, level
        first = int(numbers[0])
        of_level = plan.points * plan.repetitions if first == 0 else points.size * (plan.length - 1)
        if first == 0 or behind >= of_level:
            behind, level = 0, level + 1
        found = [np.empty(0)]
        for part in fly_points(store, executor, points, first, fly=fly):
            found.append(part)
            behind += part.size
            tell(f"level {level}: {behind} of {of_level} flights", behind / of_level)
        return np.concatenate(found)

    return values
