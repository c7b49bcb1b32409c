"""Flights of a rare event.

The space of the standard normal numbers of a seed's flights, whose points are weighted sums of the normals of
numbered flights, and the limit-state value of the flight at a point.
"""

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy import stats

from anser.campaigns.flights import (
    VALIDATED_FLIGHTS,
    apply_samples,
    dispersed_scenario,
    refuse_invalid_flights,
    refuse_paths_without_effect,
)
from anser.campaigns.rare_store import RareStore
from anser.campaigns.sampling import apply_distributions
from anser.campaigns.store_integrity import StoreError
from anser.campaigns.study import RareEventConfig, Study
from anser.campaigns.subset import SubsetPlan
from anser.config.errors import Problem, ScenarioError
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.runs import check_precision, needs_single_flight
from anser.numerics.arrays import as_array, bucket_size
from anser.numerics.randomness import DISPERSIONS, BlendedRandomness, draw_uniforms, flight_keys
from anser.results.flight_rows import FlightRow
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import AT_GROUND, NO_TRIM, NOT_FINITE, STATUS_MESSAGES

_ROOM = 128
"""Terms for which there is room: programs are compiled for few sizes."""


class GaussianSpace:
    """The space of the normals of a seed's flights; see `anser.campaigns.subset.SampleSpace`.

    Its points have the fields `count`, `flights` and `weights`: how many flights were mixed, which, and how much of
    each.

    Attributes
    ----------
    seed
        Of the flights.
    terms
        How many flights a point may be mixed of.
    """

    def __init__(self, seed: int, terms: int) -> None:
        self.seed, self.terms = seed, bucket_size(terms, _ROOM)
        self.dtype = np.dtype(
            [("count", np.int32), ("flights", np.uint32, (self.terms,)), ("weights", float, (self.terms,))]
        )

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """The normals of the flights of these numbers themselves."""
        points = np.zeros(numbers.size, self.dtype)
        points["count"], points["flights"][:, 0], points["weights"][:, 0] = 1, numbers, 1.0
        return points

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Points ``keep * point + sqrt(1 - keep**2) * fresh``; nothing is left of a point of which nothing is kept."""
        found = points.copy()
        found["weights"] *= keep[:, None]
        found["count"][keep == 0.0] = 0
        rows, last = np.arange(points.size), found["count"]
        found["flights"][rows, last], found["weights"][rows, last] = numbers, np.sqrt(1.0 - keep**2)
        found["count"] += 1
        return found

    def point(self, flights: Sequence[int], weights: Sequence[float]) -> np.ndarray:
        """One point, of its flights and how much of each."""
        found = np.zeros((), self.dtype)
        found["count"] = len(flights)
        found["flights"][: len(flights)], found["weights"][: len(flights)] = flights, weights
        return found

    def randomness_at(self, point: np.ndarray) -> BlendedRandomness:
        """All that is random in the flight of a point."""
        keys = flight_keys(self.seed, point["flights"])
        return BlendedRandomness(
            as_array(keys, np.uint32), as_array(point["weights"]), as_array(point["count"], np.int32)
        )

    def dispersions(self, points: np.ndarray, count: int) -> np.ndarray:
        """Normals behind what the study disperses, shape (points, count)."""
        width = int(np.max(points["count"]))
        keys = flight_keys(self.seed, points["flights"][:, :width].ravel())
        lanes = np.tile(np.arange(count), len(keys))
        shares = draw_uniforms(np.repeat(keys, count, axis=0).T, DISPERSIONS, np.zeros(lanes.size, np.uint32), lanes)
        normals = stats.norm.ppf(shares).reshape(points.size, width, count)
        return np.einsum("pt,ptc->pc", points["weights"][:, :width], normals)


_CRASHED = tuple(STATUS_MESSAGES[code] for code in (NO_TRIM, NOT_FINITE, AT_GROUND))
"""After these what is recorded says nothing."""
_BATCH_MAX = 64
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
    def config(self) -> RareEventConfig:
        """The table [rare]; ScenarioError where there is none, or none that such a scenario can have."""
        rare, found = self.study.rare, []
        if rare is None:
            raise ScenarioError(self.study.name, [Problem("rare", "nothing", "a table [rare]")])
        if len(self.scenario.aircraft) == 1 and rare.statistic in ("separation_min_m", "arrival_spread_s"):
            words = "a statistic of one aircraft, such as miss_m"
            found.append(Problem("rare.statistic", f'"{rare.statistic}" of one aircraft', words))
        if needs_single_flight(self.scenario):
            words = "one whose flights can fly together: without events, and with a planner at one place"
            found.append(Problem("scenario", self.scenario.name, words))
        if found:
            raise ScenarioError(self.study.name, found)
        return rare

    @cached_property
    def plan(self) -> SubsetPlan:
        """How much of it."""
        rare = self.config
        return SubsetPlan(rare.flights // rare.repetitions, 1.0 / rare.chain_length, rare.levels_max, rare.repetitions)

    @cached_property
    def space(self) -> GaussianSpace:
        """Of the normals of its flights."""
        return GaussianSpace(self.study.seed, 1 + (self.config.levels_max - 1) * (self.config.chain_length - 1))

    @property
    def threshold(self) -> float:
        """As a value: more is worse."""
        return self.signed_value(self.config.threshold)

    @property
    def batch(self) -> int:
        """Flights of one compiled call: what all chains ask for at once, or an equal part of it."""
        at_once = self.plan.chains * self.plan.repetitions
        return -(-at_once // -(-at_once // _BATCH_MAX))

    def signed_value(self, value: float) -> float:
        """From a quantity to a value of which more is worse, and back."""
        return -value if self.config.breached_below else value

    def refuse_early(self) -> None:
        """Refuse before anything flies what no flight can have (ScenarioError)."""
        check_precision(self.scenario, self.study.precision, self.study.name)
        numbers = np.arange(min(VALIDATED_FLIGHTS, self.config.flights))
        applied = self._applied(self.space.sample(numbers))
        refuse_invalid_flights(self.study, self.scenario, applied, numbers.size)
        refuse_paths_without_effect(self.study, self.scenario, applied, numbers.size)

    def fly(self, points: np.ndarray) -> np.ndarray:
        """Values of a batch of points at most; infinite where a flight failed."""
        values = np.full(points.size, np.inf)
        cases = dict(self._cases(points))
        if not cases:
            return values
        # of one size, so that one program flies all; those that are refused are few
        filled = list(itertools.islice(itertools.cycle(cases.values()), self.batch))
        for k, row in zip(cases, fly_many(filled, batch=self.batch, precision=self.study.precision), strict=False):
            values[k] = self.limit_state_value(row)
        return values

    def case(self, point: np.ndarray) -> FlightCase:
        """One flight by itself; ScenarioError where what was drawn makes no valid scenario."""
        (applied,) = self._each(point.reshape(1))
        return self._case(point, applied)

    def limit_state_value(self, row: FlightRow) -> float:
        """What counts of a flight; infinite where it failed."""
        statistic = self.config.statistic
        rows = [row.fleet] if statistic in ("separation_min_m", "arrival_spread_s") else row.aircraft
        values = [one.get(statistic) for one in rows]
        crashed = any(words in one["status"] for one in row.aircraft for words in _CRASHED)
        if row.reason or crashed or None in values:
            return np.inf
        return max(self.signed_value(float(value)) for value in values)  # pyright: ignore[reportArgumentType]

    def _cases(self, points: np.ndarray) -> Iterator[tuple[int, FlightCase]]:
        for k, (point, applied) in enumerate(zip(points, self._each(points), strict=True)):
            try:
                yield k, self._case(point, applied)
            except ScenarioError:
                continue

    def _case(self, point: np.ndarray, applied: dict[str, np.ndarray]) -> FlightCase:
        scenario = dispersed_scenario(self.scenario, self.study.seed, applied) if applied else self.scenario
        return FlightCase(scenario, randomness=self.space.randomness_at(point))

    def _each(self, points: np.ndarray) -> list[dict[str, np.ndarray]]:
        applied = self._applied(points)
        return [{path: values[k] for path, values in applied.items()} for k in range(points.size)]

    def _applied(self, points: np.ndarray) -> dict[str, np.ndarray]:
        shares = stats.norm.cdf(self.space.dispersions(points, len(self.study.vary)))
        return apply_samples(self.study, self.scenario, apply_distributions(self.study, shares))


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
        asked = {since: executor.submit(_fly_in_worker, folder, parts[since], first + since) for since in missing}
    try:
        for since, part in parts.items():
            values = kept[since]
            if values is None:
                values = (
                    _fly_and_store(store, flights, part, first + since) if executor is None else asked[since].result()
                )
            yield values
    except BrokenProcessPool:
        words = "a process that flew and was killed, perhaps for want of memory"
        raise StoreError(
            f"{store.folder}: arrived {words}; expected all to end by themselves; resume flies the rest"
        ) from None


def _fly_in_worker(folder: Path, points: np.ndarray, first: int) -> np.ndarray:
    store = RareStore.open(folder)
    return _fly_and_store(store, RareFlights(store.study, store.scenario), points, first)


def _fly_and_store(store: RareStore, flights: RareFlights, points: np.ndarray, first: int) -> np.ndarray:
    values = flights.fly(points)
    store.write(first, values)
    return values
