"""Flights of a rare-event analysis and their store.

Every random effect of a flight follows from standard normal numbers ("normals"), which the seed and the flight number
determine. A point, in which the Markov chains of subset simulation move, is a weighted sum of the normals of several
flight numbers. The limit-state value of a point is the statistic of the point's flight, with the sign for which greater
is worse.
"""

import contextlib
import functools
import io
import itertools
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Self

import numpy as np
from scipy import stats

from anser.campaigns.flights import VALIDATED_FLIGHTS, apply_samples, dispersed_scenario, refuse_early
from anser.campaigns.processes import fly_concurrently
from anser.campaigns.sampling import apply_distributions
from anser.campaigns.store_integrity import AbstractFlightStore, StoreChecksums, StoreError, store_attributes
from anser.campaigns.study import RareEventConfig, Study
from anser.campaigns.subset import Repetition, SubsetPlan, subset_simulation
from anser.config.errors import Problem, ScenarioError
from anser.files import new_folder, write_file
from anser.missions.batches import Progress
from anser.missions.flight_batches import FlightCase, fly_many
from anser.missions.runs import needs_single_flight
from anser.numerics.arrays import as_array, bucket_size
from anser.numerics.randomness import DISPERSIONS, BlendedRandomness, draw_uniforms, flight_keys
from anser.results.flight_rows import FlightRow
from anser.scenario.schema import Scenario
from anser.simulation.closed_loop import AT_GROUND, NO_TRIM, NOT_FINITE, OUTSIDE_WIND, STATUS_MESSAGES

_TERMS_MIN = 128
"""Least length of the arrays of a point's flights and weights: few lengths mean few compiled programs."""


class GaussianSpace:
    """Space of the standard normal numbers ("normals") of flights; implements `SampleSpace` of module `subset`.

    The normals of each flight number follow from `seed`. A point is a weighted sum of the normals of several flight
    numbers, at most `terms`; it is a NumPy record with the fields `count` (number of terms), `flights` (flight numbers)
    and `weights`.
    """

    def __init__(self, seed: int, terms: int) -> None:
        self.seed, size = seed, bucket_size(terms, _TERMS_MIN)
        self.dtype = np.dtype([("count", np.int32), ("flights", np.uint32, (size,)), ("weights", float, (size,))])

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """Return an independent point for each of the flight `numbers`: the flight's normals alone, with weight 1."""
        points = np.zeros(numbers.size, self.dtype)
        points["count"], points["flights"][:, 0], points["weights"][:, 0] = 1, numbers, 1.0
        return points

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return for each point ``keep * point + sqrt(1 - keep**2) * flight``, the preconditioned Crank-Nicolson move.

        `flight` stands for the normals of the flight number in `numbers`; `keep` (0 to 1) and `numbers` have one entry
        per point. With `keep` = 0 the result has the normals of the new flight alone.
        """
        proposal = points.copy()
        proposal["weights"] *= keep[:, None]
        proposal["count"][keep == 0.0] = 0
        row_indices, end = np.arange(points.size), proposal["count"]
        proposal["flights"][row_indices, end], proposal["weights"][row_indices, end] = numbers, np.sqrt(1.0 - keep**2)
        proposal["count"] += 1
        return proposal

    def point(self, flights: Sequence[int], weights: Sequence[float]) -> np.ndarray:
        """Return the point that is the sum of the flights' normals times `weights`."""
        point = np.zeros((), self.dtype)
        point["count"] = len(flights)
        point["flights"][: len(flights)], point["weights"][: len(flights)] = flights, weights
        return point

    def randomness_at(self, point: np.ndarray) -> BlendedRandomness:
        """Return the source of all random numbers of the flight that `point` defines."""
        keys = flight_keys(self.seed, point["flights"])
        return BlendedRandomness(
            as_array(keys, np.uint32), as_array(point["weights"]), as_array(point["count"], np.int32)
        )

    def dispersions(self, points: np.ndarray, count: int) -> np.ndarray:
        """Return the normals of the study's `count` varied parameters at each point; shape (points, count)."""
        width = int(np.max(points["count"]))
        keys = flight_keys(self.seed, points["flights"][:, :width].ravel())
        lanes = np.tile(np.arange(count), len(keys))
        shares = draw_uniforms(np.repeat(keys, count, axis=0).T, DISPERSIONS, np.zeros(lanes.size, np.uint32), lanes)
        normals = stats.norm.ppf(shares).reshape(points.size, width, count)
        return np.einsum("pt,ptc->pc", points["weights"][:, :width], normals)


_CRASHED = tuple(STATUS_MESSAGES[code] for code in (NO_TRIM, NOT_FINITE, AT_GROUND, OUTSIDE_WIND))
"""Aircraft statuses after which the statistics of the flight are meaningless."""
_BATCH_MAX = 64
"""Maximum number of flights per compiled call: fewer than in a campaign, so that all processes have work."""


class RareFlights:
    """Flights of a rare event: random numbers, scenarios and signed values of the statistic (greater is worse)."""

    def __init__(self, study: Study, scenario: Scenario) -> None:
        self.study, self.scenario = study, scenario

    @functools.cached_property
    def config(self) -> RareEventConfig:
        """The study's table [rare].

        Raises ScenarioError if the table is missing, if the statistic needs two aircraft and the scenario has one, or
        if the scenario's flights cannot be computed as a batch.
        """
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
        """Numbers of points, levels and repetitions of the subset simulation, and share of points that start chains."""
        rare = self.config
        return SubsetPlan(rare.flights // rare.repetitions, 1.0 / rare.chain_length, rare.levels_max, rare.repetitions)

    @functools.cached_property
    def space(self) -> GaussianSpace:
        """Space of the standard normal numbers that define the flights of all levels of the subset simulation."""
        return GaussianSpace(self.study.seed, 1 + (self.config.levels_max - 1) * (self.config.chain_length - 1))

    @property
    def threshold(self) -> float:
        """Threshold of the event as a signed value, m or s; the event is a signed value above the threshold."""
        return self.signed_value(self.config.threshold)

    @property
    def batch(self) -> int:
        """Number of flights per compiled call, at most 64."""
        at_once = self.plan.chains * self.plan.repetitions  # flights of one move, in batches of equal size
        return -(-at_once // -(-at_once // _BATCH_MAX))

    def signed_value(self, value: float) -> float:
        """Convert between statistic and signed value (greater is worse): the sign changes if low values are bad."""
        return -value if self.config.breached_below else value

    def refuse_early(self) -> None:
        """Raise ScenarioError if none of the first flights is valid, or a varied key path has no effect in them."""
        numbers = np.arange(min(VALIDATED_FLIGHTS, self.config.flights))
        refuse_early(self.study, self.scenario, self._applied(self.space.sample(numbers)), numbers.size)

    def fly(self, points: np.ndarray) -> np.ndarray:
        """Fly at most one batch of points and return signed values, shape (points,); infinite for failed flights."""
        values, applied = np.full(points.size, np.inf), self._applied(points)
        cases: dict[int, FlightCase] = {}
        for k, point in enumerate(points):
            with contextlib.suppress(ScenarioError):
                cases[k] = self._case(point, applied, k)
        if not cases:
            return values
        # padded to one size for a single compiled program; rejected flights are few
        padded = list(itertools.islice(itertools.cycle(cases.values()), self.batch))
        flight_rows = fly_many(padded, batch=self.batch, precision=self.study.precision)
        for k, flight_row in zip(cases, flight_rows, strict=False):
            values[k] = self.limit_state_value(flight_row)
        return values

    def case(self, point: np.ndarray) -> FlightCase:
        """Return the flight that a point defines; raises ScenarioError if the sampled values are invalid."""
        return self._case(point, self._applied(point.reshape(1)), 0)

    def limit_state_value(self, flight_row: FlightRow) -> float:
        """Return the signed value of the event's statistic for the worst aircraft of a flight.

        The value is infinite if the flight could not start, an aircraft crashed, left the wind field or could not be
        trimmed, or the statistic of an aircraft is missing.
        """
        statistic = self.config.statistic
        summaries = [flight_row.fleet] if statistic in ("separation_min_m", "arrival_spread_s") else flight_row.aircraft
        values = [summary.get(statistic) for summary in summaries]
        crashed = any(message in summary["status"] for summary in flight_row.aircraft for message in _CRASHED)
        if flight_row.reason or crashed or None in values:
            return np.inf
        return max(self.signed_value(float(value)) for value in values)  # pyright: ignore[reportArgumentType]

    def _case(self, point: np.ndarray, applied: dict[str, np.ndarray], number: int) -> FlightCase:
        scenario = dispersed_scenario(self.scenario, self.study.seed, applied, number) if applied else self.scenario
        return FlightCase(scenario, randomness=self.space.randomness_at(point))

    def _applied(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values to write into the scenario at each point, by key path; shape (points,)."""
        shares = stats.norm.cdf(self.space.dispersions(points, len(self.study.vary)))
        return apply_samples(self.study, self.scenario, apply_distributions(self.study, shares))


class RareStore(AbstractFlightStore):
    """Stored flights of a rare-event analysis in a folder: a file with the limit-state values of each batch of flights.

    The flights are numbered in order of the simulation. A batch (chunk) has the number of its first flight.
    """

    description, command, data_folder = "a rare event", "rare", "flown"

    @classmethod
    def create(cls, folder: Path, study: Study, scenario: Scenario) -> Self:
        """Create the store in a new folder; raises FileExistsError if the folder exists."""
        with new_folder(folder) as staging:
            (staging / cls.data_folder).mkdir()
            StoreChecksums(staging, cls.data_folder).record_base(store_attributes(study, scenario))
        return cls(folder)

    def values(self, start: int, count: int) -> np.ndarray | None:
        """Return the limit-state values of the `count` flights of a batch from number `start`; None if not yet flown.

        Raises StoreError if the stored batch has another number of flights.
        """
        if start not in self._checksums.chunks():
            return None
        values = np.load(self._last_file(start))
        if values.shape != (count,):
            raise StoreError(f"{self._last_file(start)}: arrived {values.size} flights; expected {count}")
        return values

    def write(self, start: int, values: np.ndarray) -> None:
        """Store the limit-state values of a batch of flights; their numbers are consecutive from `start`."""
        content = io.BytesIO()  # np.save into a file would not report a full disk as the reason of an error
        np.save(content, values)
        path = self._last_file(start)
        self._checksums.begin_chunk(start)
        write_file(path, content.getvalue(), overwrite=True)
        self._checksums.record_chunk(start, [path.name])

    @property
    def flown(self) -> int:
        """Number of completed flights."""
        return sum(np.load(self._last_file(start)).size for start in self._checksums.chunks())

    def _last_file(self, chunk: int) -> Path:
        return self.folder / self.data_folder / f"{chunk:09d}.npy"

    def _chunk_label(self, chunk: int) -> str:
        return f"the batch from flight {chunk} on"


def fly_repetitions(
    store: RareStore, executor: Executor | None, report: Progress, *, fly: bool = True
) -> tuple[Repetition, ...]:
    """Carry out the subset simulation with stored limit-state values; fly and store the flights that are missing.

    `executor` has the worker processes (None: this process); `report` is called with a message and the completed
    fraction of the level. Returns the levels of each repetition. Raises StoreError if a process was killed, a stored
    batch has another number of flights, or a flight is missing and `fly` is False.
    """
    flights = RareFlights(store.study, store.scenario)
    plan, batch, flown_count, level = flights.plan, flights.batch, 0, 0
    fly_batch = functools.partial(_fly_batch, store.folder.resolve())

    def limit_state(points: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        nonlocal flown_count, level
        start = int(numbers[0])
        level_count = plan.points * plan.repetitions if start == 0 else points.size * (plan.length - 1)
        if start == 0 or flown_count >= level_count:
            flown_count, level = 0, level + 1
        results = np.full(points.size, np.nan)
        parts = {offset: points[offset : offset + batch] for offset in range(0, points.size, batch)}
        values = {offset: store.values(start + offset, part.size) for offset, part in parts.items()}
        missing = [offset for offset, part in values.items() if part is None]
        if missing and not fly:
            detail = f"arrived no batch from flight {start + missing[0]} on; expected all: resume flies the rest"
            raise StoreError(f"{store.folder}: {detail}")
        tasks = [(parts[offset], start + offset) for offset in missing]
        flown = fly_concurrently(executor, fly_batch, tasks, len(tasks), store.folder)
        stored = ((offset, part) for offset, part in values.items() if part is not None)
        for offset, part in itertools.chain(stored, ((missing[index], part) for index, part in flown)):
            results[offset : offset + part.size] = part
            flown_count += part.size
            report(f"level {level}: {flown_count} of {level_count} flights", flown_count / level_count)
        return results

    return subset_simulation(flights.space, limit_state, flights.threshold, plan, store.study.seed)


def _fly_batch(folder: Path, points: np.ndarray, start: int) -> np.ndarray:
    store = RareStore.open(folder, verify_chunks=False)
    values = RareFlights(store.study, store.scenario).fly(points)
    store.write(start, values)
    return values
