"""The flights of a rare event: from points among their normals to what counts of each."""

import itertools
from collections.abc import Iterator
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy import stats

from anser.campaigns.asked_rare import Rare
from anser.campaigns.blends import Blends
from anser.campaigns.flying import TRIED, put, refuse_idle_paths, refuse_if_none, scenario_with
from anser.campaigns.rare_store import RareStore
from anser.campaigns.sampling import dispersed
from anser.campaigns.store import StoreError
from anser.campaigns.study import Study
from anser.campaigns.subset import SubsetPlan
from anser.execution.many_flights import FlightCase, fly_many
from anser.execution.precisions import flown_one_by_one, refuse_precision
from anser.results.flight_row import FlightRow
from anser.scenario import Problem, Scenario, ScenarioError
from anser.simulation.status import AT_GROUND, NO_TRIM, NOT_FINITE, STATUS_MESSAGES

_CRASHED = tuple(STATUS_MESSAGES[code] for code in (NO_TRIM, NOT_FINITE, AT_GROUND))
"""After these what is recorded says nothing."""
_TOGETHER = 64
"""Flights of one compiled call at most: less than in a campaign, so that there is work for several processes."""


class RareFlights:
    """What a study's event is made of.

    Attributes
    ----------
    study, scenario
        What is flown.
    """

    def __init__(self, study: Study, scenario: Scenario) -> None:
        self.study, self.scenario = study, scenario

    @cached_property
    def asked(self) -> Rare:
        """The table [rare]; ScenarioError where there is none, or none that such a scenario can have."""
        rare, found = self.study.rare, []
        if rare is None:
            raise ScenarioError(self.study.name, [Problem("rare", "nothing", "a table [rare]")])
        if len(self.scenario.aircraft) == 1 and rare.statistic in ("separation_min_m", "arrival_spread_s"):
            words = "a statistic of one aircraft, such as miss_m"
            found.append(Problem("rare.statistic", f'"{rare.statistic}" of one aircraft', words))
        if flown_one_by_one(self.scenario):
            words = "one whose flights can fly together: without events, and with a planner at one place"
            found.append(Problem("scenario", self.scenario.name, words))
        if found:
            raise ScenarioError(self.study.name, found)
        return rare

    @cached_property
    def plan(self) -> SubsetPlan:
        """How much of it."""
        rare = self.asked
        return SubsetPlan(rare.flights // rare.repetitions, 1.0 / rare.moves, rare.levels_max, rare.repetitions)

    @cached_property
    def space(self) -> Blends:
        """Of the normals of its flights."""
        return Blends(self.study.seed, 1 + (self.asked.levels_max - 1) * (self.asked.moves - 1))

    @property
    def threshold(self) -> float:
        """As a value: more is worse."""
        return self.signed(self.asked.threshold)

    @property
    def batch(self) -> int:
        """Flights of one compiled call: what all chains ask for at once, or an equal part of it."""
        at_once = self.plan.chains * self.plan.repetitions
        return -(-at_once // -(-at_once // _TOGETHER))

    def signed(self, value: float) -> float:
        """From a quantity to a value of which more is worse, and back."""
        return -value if self.asked.breached_below else value

    def refuse_early(self) -> None:
        """Refuse before anything flies what no flight can have (ScenarioError)."""
        refuse_precision(self.scenario, self.study.precision, self.study.name)
        numbers = np.arange(min(TRIED, self.asked.flights))
        applied = self._applied(self.space.fresh(numbers))
        refuse_if_none(self.study, self.scenario, applied, numbers.size)
        refuse_idle_paths(self.study, self.scenario, applied, numbers.size)

    def fly(self, points: np.ndarray) -> np.ndarray:
        """Values of a batch of points at most; infinite where a flight failed."""
        values = np.full(points.size, np.inf)
        cases = dict(self._cases(points))
        if not cases:
            return values
        # of one size, so that one program flies all; those that are refused are few
        filled = list(itertools.islice(itertools.cycle(cases.values()), self.batch))
        for k, row in zip(cases, fly_many(filled, batch=self.batch, precision=self.study.precision), strict=False):
            values[k] = self.value_of(row)
        return values

    def case(self, point: np.ndarray) -> FlightCase:
        """One flight by itself; ScenarioError where what was drawn makes no valid scenario."""
        (applied,) = self._each(point.reshape(1))
        return self._case(point, applied)

    def value_of(self, row: FlightRow) -> float:
        """What counts of a flight; infinite where it failed."""
        statistic = self.asked.statistic
        rows = [row.fleet] if statistic in ("separation_min_m", "arrival_spread_s") else row.aircraft
        values = [one.get(statistic) for one in rows]
        crashed = any(words in one["status"] for one in row.aircraft for words in _CRASHED)
        if row.reason or crashed or None in values:
            return np.inf
        return max(self.signed(float(value)) for value in values)  # pyright: ignore[reportArgumentType]

    def _cases(self, points: np.ndarray) -> Iterator[tuple[int, FlightCase]]:
        for k, (point, applied) in enumerate(zip(points, self._each(points), strict=True)):
            try:
                yield k, self._case(point, applied)
            except ScenarioError:
                continue

    def _case(self, point: np.ndarray, applied: dict[str, np.ndarray]) -> FlightCase:
        scenario = scenario_with(self.scenario, self.study.seed, applied) if applied else self.scenario
        return FlightCase(scenario, randomness=self.space.source(point))

    def _each(self, points: np.ndarray) -> list[dict[str, np.ndarray]]:
        applied = self._applied(points)
        return [{path: values[k] for path, values in applied.items()} for k in range(points.size)]

    def _applied(self, points: np.ndarray) -> dict[str, np.ndarray]:
        shares = stats.norm.cdf(self.space.dispersions(points, len(self.study.vary)))
        return put(self.study, self.scenario, dispersed(self.study, shares))


def fly_points(
    store: RareStore, executor: Executor | None, points: np.ndarray, first: int, *, fly: bool = True
) -> Iterator[np.ndarray]:
    """Values of points, batch by batch in their order: as kept, or flown and kept.

    Parameters
    ----------
    store
        Where they are kept.
    executor
        Flies the batches; None: this process.
    points
        As many as there are.
    first
        Number of the first.
    fly
        Whether those that are missing are flown.

    Raises
    ------
    StoreError
        A process was killed, or what is kept is not of these flights, or lacks some that are not to be flown.
    """
    flights = RareFlights(store.study, store.scenario)
    parts = {since: points[since : since + flights.batch] for since in range(0, points.size, flights.batch)}
    kept = {since: store.values(first + since, part.size) for since, part in parts.items()}
    missing = [since for since in parts if kept[since] is None]
    if missing and not fly:
        words = f"arrived no batch from flight {first + missing[0]} on; expected all: resume flies the rest"
        raise StoreError(f"{store.folder}: {words}")
    folder, asked = store.folder.resolve(), {}
    if executor is not None:
        asked = {since: executor.submit(_flown, folder, parts[since], first + since) for since in missing}
    try:
        for since, part in parts.items():
            values = kept[since]
            if values is None:
                values = _kept(store, flights, part, first + since) if executor is None else asked[since].result()
            yield values
    except BrokenProcessPool:
        words = "a process that flew and was killed, perhaps for want of memory"
        raise StoreError(
            f"{store.folder}: arrived {words}; expected all to end by themselves; resume flies the rest"
        ) from None


def _flown(folder: Path, points: np.ndarray, first: int) -> np.ndarray:
    store = RareStore.open(folder)
    return _kept(store, RareFlights(store.study, store.scenario), points, first)


def _kept(store: RareStore, flights: RareFlights, points: np.ndarray, first: int) -> np.ndarray:
    values = flights.fly(points)
    store.write(first, values)
    return values
