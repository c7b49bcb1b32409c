"""A rare event for people: fly a study by levels, and read how probable its event is."""

import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anser.campaigns.flying import workers
from anser.campaigns.memory import room_for
from anser.campaigns.rare_flights import RareFlights, fly_points
from anser.campaigns.rare_results import exceedance_dataset, rare_document, worst_points
from anser.campaigns.rare_store import RareStore
from anser.campaigns.store_lock import exclusive
from anser.campaigns.study import load_study
from anser.campaigns.subset import Repetition, SubsetEstimate, estimate, subset_simulation
from anser.execution.batches import Progress, silent
from anser.execution.execute import Flown, run
from anser.execution.many_flights import FlightCase
from anser.execution.planned import plan
from anser.results import write_json

if TYPE_CHECKING:
    import xarray as xr

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
        return self.probability_of(self.flights.asked.threshold)

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
        value, confidence = self.flights.signed(threshold), self.store.study.answers.confidence
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

    def fly_worst(self, place: int = 0) -> Flown:
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
    from anser.report import draw_rare

    store = rare_store_of(study, Path(out), resume=resume)
    if processes is None:
        room = room_for(store.scenario, RareFlights(store.study, store.scenario).batch)
        processes = room.processes
        if room.words and progress is not None:
            progress(room.words, None)
    with exclusive(store.folder):
        for message in store.remove_damaged():
            (progress or silent)(message, None)
        with workers(processes) as (executor, _):
            found = RareEvent(store, _repetitions(store, executor, progress or silent))
        write_json(found.document, store.folder / _DOCUMENT, overwrite=True)
        draw_rare(found.dataset, store.folder)
    return found


def rare_store_of(study: str | os.PathLike[str], folder: Path, *, resume: bool) -> RareStore:
    """The folder to fly into: a new one, or one to go on with; raises as `rare` does."""
    wanted, scenario, _ = load_study(study)
    flights = RareFlights(wanted, scenario)
    _ = flights.asked
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
    return RareEvent(store, _repetitions(store, None, silent, fly=False))


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
