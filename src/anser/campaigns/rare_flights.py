"""Flights of a rare-event analysis.

Every random effect of a flight follows from standard normal numbers ("normals"). A point of the space of these
normals is a weighted sum of the normals of numbered flights. The module flies the flight at a point and returns its
limit-state value: the signed statistic of the event, greater is worse.
"""

import functools
import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
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
from anser.campaigns.processes import fly_concurrently
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

_TERMS_MIN = 128
"""Smallest capacity of a point's list of terms: few capacities mean few compiled programs."""


class GaussianSpace:
    """Space of the standard normal numbers behind the flights of a seed; implements `SampleSpace` of module `subset`.

    Points are NumPy records with the fields `count`, `flights` and `weights`: how many flights are blended, their
    numbers, and their weights in the sum.

    Attributes
    ----------
    seed
        Seed of the flights.
    terms
        Maximum number of blended flights per point.
    dtype
        Type of the records.
    """

    def __init__(self, seed: int, terms: int) -> None:
        self.seed, self.terms = seed, bucket_size(terms, _TERMS_MIN)
        self.dtype = np.dtype(
            [("count", np.int32), ("flights", np.uint32, (self.terms,)), ("weights", float, (self.terms,))]
        )

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """Return the points of numbered flights, unblended."""
        points = np.zeros(numbers.size, self.dtype)
        points["count"], points["flights"][:, 0], points["weights"][:, 0] = 1, numbers, 1.0
        return points

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return new points ``keep * point + sqrt(1 - keep**2) * new`` (preconditioned Crank-Nicolson).

        `new` are the normals of the flights with the given numbers; one `keep` per point.
        """
        proposal = points.copy()
        proposal["weights"] *= keep[:, None]
        proposal["count"][keep == 0.0] = 0
        row_indices, end = np.arange(points.size), proposal["count"]
        proposal["flights"][row_indices, end], proposal["weights"][row_indices, end] = numbers, np.sqrt(1.0 - keep**2)
        proposal["count"] += 1
        return proposal

    def point(self, flights: Sequence[int], weights: Sequence[float]) -> np.ndarray:
        """Return the point that blends the given flights with the given weights."""
        point = np.zeros((), self.dtype)
        point["count"] = len(flights)
        point["flights"][: len(flights)], point["weights"][: len(flights)] = flights, weights
        return point

    def randomness_at(self, point: np.ndarray) -> BlendedRandomness:
        """Return the source of the random numbers of the flight at a point."""
        keys = flight_keys(self.seed, point["flights"])
        return BlendedRandomness(
            as_array(keys, np.uint32), as_array(point["weights"]), as_array(point["count"], np.int32)
        )

    def dispersions(self, points: np.ndarray, count: int) -> np.ndarray:
        """Return the normals behind the study's `count` varied parameters at each point; shape (points, count)."""
        width = int(np.max(points["count"]))
        keys = flight_keys(self.seed, points["flights"][:, :width].ravel())
        lanes = np.tile(np.arange(count), len(keys))
        shares = draw_uniforms(np.repeat(keys, count, axis=0).T, DISPERSIONS, np.zeros(lanes.size, np.uint32), lanes)
        normals = stats.norm.ppf(shares).reshape(points.size, width, count)
        return np.einsum("pt,ptc->pc", points["weights"][:, :width], normals)


_CRASHED = tuple(STATUS_MESSAGES[code] for code in (NO_TRIM, NOT_FINITE, AT_GROUND))
"""Aircraft statuses after which the recorded statistics are meaningless."""
_BATCH_MAX = 64
"""Maximum number of flights per compiled call: fewer than in a campaign, so that several processes have work."""


class RareFlights:
    """Flights of a study's rare event: their random numbers, scenarios and signed values.

    Attributes
    ----------
    study, scenario
        Study and base scenario.
    """

    def __init__(self, study: Study, scenario: Scenario) -> None:
        self.study, self.scenario = study, scenario

    @functools.cached_property
    def config(self) -> RareEventConfig:
        """The study's table [rare]; raises ScenarioError if missing or incompatible with the scenario."""
        config, problems = self.study.rare, []
        if config is None:
            raise ScenarioError(self.study.name, [Problem("rare", "nothing", "a table [rare]")])
        if len(self.scenario.aircraft) == 1 and config.statistic in ("separation_min_m", "arrival_spread_s"):
            expected = "a statistic of one aircraft, such as miss_m"
            problems.append(Problem("rare.statistic", f'"{config.statistic}" of one aircraft', expected))
        if needs_single_flight(self.scenario):
            expected = "one whose flights can fly together: without events, and with a planner at one place"
            problems.append(Problem("scenario", self.scenario.name, expected))
        if problems:
            raise ScenarioError(self.study.name, problems)
        return config

    @functools.cached_property
    def plan(self) -> SubsetPlan:
        """Numbers of points, levels and repetitions of the subset simulation."""
        rare = self.config
        return SubsetPlan(rare.flights // rare.repetitions, 1.0 / rare.chain_length, rare.levels_max, rare.repetitions)

    @functools.cached_property
    def space(self) -> GaussianSpace:
        """Space of the normals behind the flights, with room for all levels."""
        return GaussianSpace(self.study.seed, 1 + (self.config.levels_max - 1) * (self.config.chain_length - 1))

    @property
    def threshold(self) -> float:
        """Threshold of the event as a signed value: an event is a greater value."""
        return self.signed_value(self.config.threshold)

    @property
    def batch(self) -> int:
        """Number of flights per compiled call: the simultaneous moves of all chains, in equal batches of at most 64."""
        at_once = self.plan.chains * self.plan.repetitions
        return -(-at_once // -(-at_once // _BATCH_MAX))

    def signed_value(self, value: float) -> float:
        """Convert between a quantity and its signed value, for which greater is worse."""
        return -value if self.config.breached_below else value

    def refuse_early(self) -> None:
        """Raise ScenarioError before flying if none of the first flights is valid, or a varied path has no effect."""
        check_precision(self.scenario, self.study.precision, self.study.name)
        numbers = np.arange(min(VALIDATED_FLIGHTS, self.config.flights))
        applied = self._applied(self.space.sample(numbers))
        refuse_invalid_flights(self.study, self.scenario, applied, numbers.size)
        refuse_paths_without_effect(self.study, self.scenario, applied, numbers.size)

    def fly(self, points: np.ndarray) -> np.ndarray:
        """Fly up to one batch of points and return their signed values; infinite for failed flights."""
        values = np.full(points.size, np.inf)
        cases = dict(self._cases(points))
        if not cases:
            return values
        # padded to one size for a single compiled program; rejected flights are few
        padded = list(itertools.islice(itertools.cycle(cases.values()), self.batch))
        for k, flight_row in zip(
            cases, fly_many(padded, batch=self.batch, precision=self.study.precision), strict=False
        ):
            values[k] = self.limit_state_value(flight_row)
        return values

    def case(self, point: np.ndarray) -> FlightCase:
        """Return the flight at a point; raises ScenarioError if the sampled values are not a valid scenario."""
        (applied,) = self._applied_by_flight(point.reshape(1))
        return self._case(point, applied)

    def limit_state_value(self, flight_row: FlightRow) -> float:
        """Return the signed value of the statistic in a flight, of the worst aircraft; infinite for a failed flight."""
        statistic = self.config.statistic
        summaries = [flight_row.fleet] if statistic in ("separation_min_m", "arrival_spread_s") else flight_row.aircraft
        values = [summary.get(statistic) for summary in summaries]
        crashed = any(message in summary["status"] for summary in flight_row.aircraft for message in _CRASHED)
        if flight_row.reason or crashed or None in values:
            return np.inf
        return max(self.signed_value(float(value)) for value in values)  # pyright: ignore[reportArgumentType]

    def _cases(self, points: np.ndarray) -> Iterator[tuple[int, FlightCase]]:
        """Yield the index and the flight of each point with a valid scenario."""
        for k, (point, applied) in enumerate(zip(points, self._applied_by_flight(points), strict=True)):
            try:
                yield k, self._case(point, applied)
            except ScenarioError:
                continue

    def _case(self, point: np.ndarray, applied: dict[str, np.ndarray]) -> FlightCase:
        scenario = dispersed_scenario(self.scenario, self.study.seed, applied) if applied else self.scenario
        return FlightCase(scenario, randomness=self.space.randomness_at(point))

    def _applied_by_flight(self, points: np.ndarray) -> list[dict[str, np.ndarray]]:
        """Return the values applied to the scenario at each point, by key path."""
        applied = self._applied(points)
        return [{path: values[k] for path, values in applied.items()} for k in range(points.size)]

    def _applied(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Return the study's varied parameters at each point of random numbers, by key path: one entry per point."""
        shares = stats.norm.cdf(self.space.dispersions(points, len(self.study.vary)))
        return apply_samples(self.study, self.scenario, apply_distributions(self.study, shares))


def fly_points(
    store: RareStore, executor: Executor | None, points: np.ndarray, start: int, *, fly: bool = True
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the signed values of points, batch by batch, with the index of each batch's first point.

    Batches in the store come first, then the missing batches as they are flown.

    Parameters
    ----------
    points
        Points with consecutive flight numbers.
    start
        Flight number of the first point.
    fly
        Whether to fly missing batches.

    Raises
    ------
    StoreError
        A process was killed, a stored batch is damaged or differs in size, or a batch is missing and `fly` is False.
    """
    flights = RareFlights(store.study, store.scenario)
    parts = {offset: points[offset : offset + flights.batch] for offset in range(0, points.size, flights.batch)}
    stored = {offset: store.values(start + offset, part.size) for offset, part in parts.items()}
    missing = [offset for offset, values in stored.items() if values is None]
    if missing and not fly:
        detail = f"arrived no batch from flight {start + missing[0]} on; expected all: resume flies the rest"
        raise StoreError(f"{store.folder}: {detail}")
    yield from ((offset, values) for offset, values in stored.items() if values is not None)
    fly_batch = (
        functools.partial(_fly_and_store, store, flights)
        if executor is None
        else functools.partial(_fly_in_worker, store.folder.resolve())
    )
    tasks = [(parts[offset], start + offset) for offset in missing]
    for index, values in fly_concurrently(executor, fly_batch, tasks, len(tasks), store.folder):
        yield missing[index], values


def _fly_in_worker(folder: Path, points: np.ndarray, start: int) -> np.ndarray:
    store = RareStore.open(folder)
    return _fly_and_store(store, RareFlights(store.study, store.scenario), points, start)


def _fly_and_store(store: RareStore, flights: RareFlights, points: np.ndarray, start: int) -> np.ndarray:
    values = flights.fly(points)
    store.write(start, values)
    return values
