"""Many flights at once: those of one structure in batches, summed up while they fly."""

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import jax
import numpy as np
from jaxtyping import Array

from anser.compiling.options import compiled, compiled_by_older_generator, enable_compilation_cache
from anser.config.errors import ScenarioError
from anser.missions.batches import BATCH, Progress, no_progress
from anser.missions.first_plan import NoPlanError, arrival_request, first_plan_status
from anser.missions.runs import needs_single_flight, precision_problems, run, without_replanning
from anser.missions.series import SeriesSelection
from anser.numerics.arrays import Stacked, as_array, stack_objects, stack_rows, tree_signature
from anser.numerics.randomness import AbstractRandomness, flight_randomness
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.task import AircraftTask
from anser.planning.separation import Separation
from anser.results.flight_rows import FlightRow, build_flight_row
from anser.scenario.build import build_flight
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.shapes import Count
from anser.simulation.fleet_summary import SummaryRecorder
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, fly
from anser.simulation.precision import Precision, cast_flight, cast_state
from anser.simulation.start import TrimmedFleet, initialize_flight, start_flight, trimmed_fleet

_AGAIN = 8  # flights of a segment that are flown again at once, with a plan made anew
NO_PLAN = "no plan: the certified planner finds none that keeps everything"


class FlightCase(NamedTuple):
    """One flight: a scenario, and its number, which with the seed rules all that is random; None: the scenario's.

    Where a source of the random numbers is given, it takes the place of both.
    """

    scenario: Scenario
    number: int = 0
    seed: int | None = None
    randomness: AbstractRandomness | None = None


_Flights = Stacked[Flight]


@compiled
def _started(flights: _Flights) -> tuple[FlightState, TrimmedFleet]:
    return flights.map(start_flight)


@compiled
def _asked(flights: _Flights) -> tuple[TrimmedFleet, AircraftTask]:
    def one(flight: Flight) -> tuple[TrimmedFleet, AircraftTask]:
        fleet, planner = trimmed_fleet(flight), cast(CertifiedPlanner, flight.planner)
        return fleet, planner.aircraft_tasks(fleet.reports, planner.resolve_limits(fleet.performance))

    return flights.map(one)


@compiled
def _begun(flights: _Flights, fleets: TrimmedFleet, plans: CertifiedPlanState) -> FlightState:
    return flights.map(initialize_flight, fleets, plans)


@compiled_by_older_generator(())  # whose loops of a batch are a little faster too
def _segment(
    flights: _Flights,
    states: FlightState,
    memory: Any,
    separations: Separation,
    since: Count,
    last_sample: Count,
    series: SeriesSelection | None = None,
) -> Any:
    def one(flight: Flight, state: FlightState, kept: Any, separation: Separation) -> Any:
        summary = SummaryRecorder(separation=separation, last_sample=last_sample)
        recorder = summary if series is None else series.recorder(summary)
        return fly(flight, state, since, SEGMENT_STEPS, recorder, kept)

    return flights.map(one, states, memory, separations)


def fly_many(
    cases: Sequence[FlightCase],
    progress: Progress | None = None,
    batch: int = BATCH,
    done: Callable[[list[int], list[FlightRow]], None] = lambda numbers, rows: None,
    series: SeriesSelection | None = None,
    precision: Precision = "float64",
) -> list[FlightRow]:
    """Fly many scenarios, those of one structure together, and sum each up as `anser.run` does.

    Parameters
    ----------
    cases
        What to fly. Scenarios with events or without a centre, which are planned while they fly, are flown one by one,
        and have the number 0.
    progress
        Called with what is being done and the part of the flights that is behind, 0..1.
    batch
        Flights of one compiled call.
    done
        Called with the places of flights in `cases` and what came of them, as soon as it is known.
    series
        Variables that are kept of each flight over time; None: none are.
    precision
        In which they are flown; they are planned in float64 in any case. A scenario that it does not fit is a row with
        the reason.

    Returns
    -------
    A row for each case, in their order.

    Raises
    ------
    ValueError
        A case that is flown alone has another number.
    """
    enable_compilation_cache()
    tell = progress or no_progress
    rows: list[FlightRow | None] = [None] * len(cases)
    refused = precision_problems([case.scenario for case in cases], precision)
    rest = [k for k in range(len(cases)) if k not in refused]
    alone = [k for k in rest if needs_single_flight(cases[k].scenario)]
    together = [k for k in rest if k not in set(alone)]
    behind = 0

    def came(numbers: list[int], found: list[FlightRow]) -> None:
        nonlocal behind
        for number, row in zip(numbers, found, strict=True):
            rows[number] = row
        behind += len(numbers)
        done(numbers, found)
        tell(f"flying {len(cases)} flights", behind / len(cases))

    tell(f"flying {len(cases)} flights", 0.0)
    if refused:
        came(list(refused), [FlightRow.failed_start(words) for words in refused.values()])
    for group, places, flights in _alike([cases[k] for k in together], batch):
        numbers = [together[k] for k in places]
        filled_up = group.stacked(flights, min(batch, len(together)))
        came(numbers, _flown([cases[k] for k in numbers], filled_up, flights, series, precision))
    for k in alone:
        came([k], [_flown_alone(cases[k], series)])
    return cast(list[FlightRow], rows)


def _flown_alone(case: FlightCase, series: SeriesSelection | None) -> FlightRow:
    if case.number != 0 or case.randomness is not None:
        arrived = f"the number {case.number}" if case.randomness is None else "random numbers of its own"
        raise ValueError(f"{case.scenario.name}: arrived {arrived}; expected 0 and none, as it is flown alone")
    try:
        scenario = case.scenario if case.seed is None else case.scenario.replace("seed", case.seed)
        if series is not None:
            scenario = scenario.replace("timing.record_period_s", series.stride * scenario.timing.step_s)
        flown = run(scenario)
    except (NoPlanError, ScenarioError) as error:
        return FlightRow.failed_start(str(error))
    summary = flown.summary
    # how long it took is no outcome: the same flight would be another row
    fleet = {key: value for key, value in summary["fleet"].items() if key not in ("wall_s", "simulated_s")}
    kept = {} if series is None else series.values_from_dataset(flown.dataset)
    return FlightRow(summary["aircraft"], fleet, summary["requirements"], flown.met, series=kept)


class _Group:
    """Flights of one structure, which leaves of which have differed so far, and those that wait for a full batch."""

    def __init__(self) -> None:
        self.differ: np.ndarray | None = None
        self.numbers: list[int] = []
        self.flights: list[Flight] = []

    def stacked(self, flights: Sequence[Flight], size: int) -> _Flights:
        """Flights as one, filled up with the last: what once differed is not taken as common again, to compile once."""
        more = [flights[-1]] * (size - len(flights))
        found = stack_objects([*flights, *more], tables_only=False, batched=self._differing)
        # of each leaf of a flight: what a flight has not is none of its leaves
        self.differ = np.array(
            jax.tree.leaves(jax.tree.map(lambda _, batched: batched is not None, flights[-1], found.batched))
        )
        return found

    def _differing(self, flight: Flight) -> list[Any]:
        leaves = jax.tree.leaves(flight)
        # one leaf at least is stacked, or flights that are all the same would have nothing to be mapped over
        differ = np.arange(len(leaves)) == 0 if self.differ is None else self.differ
        return [leaf for leaf, own in zip(leaves, differ, strict=True) if own]


def _alike(cases: Sequence[FlightCase], batch: int) -> Iterator[tuple[_Group, list[int], list[Flight]]]:
    """Places of cases whose flights have one structure and the same periods, and these flights; up to a batch each."""
    groups: dict[Any, _Group] = {}
    last: tuple[Scenario, Flight] | None = None
    for number, case in enumerate(cases):
        if last is None or case.scenario is not last[0]:
            last = case.scenario, build_flight(case.scenario)
        seed = case.scenario.seed if case.seed is None else case.seed
        source = flight_randomness(seed, case.number) if case.randomness is None else case.randomness
        flight = dataclasses.replace(last[1], randomness=source)
        timing = case.scenario.timing
        key = tree_signature(flight), timing.step_s, timing.replan_period_s, timing.duration_s
        group = groups.setdefault(key, _Group())
        group.numbers.append(number)
        group.flights.append(flight)
        if len(group.numbers) == batch:
            numbers, flights, group.numbers, group.flights = group.numbers, group.flights, [], []
            yield group, numbers, flights
    for group in groups.values():
        if group.numbers:
            yield group, group.numbers, group.flights


def _flown(
    cases: Sequence[FlightCase],
    flights: _Flights,
    alone: Sequence[Flight],
    series: SeriesSelection | None,
    precision: Precision,
) -> list[FlightRow]:
    """Start, plan and fly a batch, which is filled up beyond the cases."""
    if cases[0].scenario.fleet.planner == "published":
        states, fleets = _started(flights)
        refused = _untrimmable(cases, alone, fleets)
        some = [k for k in range(len(cases)) if k not in refused]
        found = _summed_up([cases[k] for k in some], flights, states, some, series, precision)
        flown = dict(zip(some, found, strict=True))
        return [flown[k] if k in flown else FlightRow.failed_start(refused[k]) for k in range(len(cases))]
    fleets, tasks = _asked(flights)
    refused = _untrimmable(cases, alone, fleets)
    plans: dict[int, CertifiedPlanState] = {}
    known: dict[bytes, CertifiedPlanState | None] = {}
    for k, (case, flight) in enumerate(zip(cases, alone, strict=True)):
        if k in refused:
            continue
        own = _row(tasks, k)
        planner = cast(CertifiedPlanner, flight.planner)
        # flights that begin alike and are asked the same share the search
        same = _bytes_of((own, planner, arrival_request(case.scenario)))
        if same not in known:
            known[same] = _first_plan(case.scenario, planner, own)
        plan = known[same]
        if plan is None:
            refused[k] = NO_PLAN
        else:
            plans[k] = plan
    flown: dict[int, FlightRow] = {}
    for some in _by_structure(plans):
        rest = [some[-1]] * (_size_of(flights) - len(some))
        which = np.array([*some, *rest])
        own = Stacked(_rows(flights.batched, which), flights.shared)
        states = _begun(own, _rows(fleets, which), stack_rows([plans[k] for k in which]))
        found = _summed_up([cases[k] for k in some], own, states, range(len(some)), series, precision)
        flown |= dict(zip(some, found, strict=True))
    return [flown[k] if k in flown else FlightRow.failed_start(refused[k]) for k in range(len(cases))]


def _untrimmable(cases: Sequence[FlightCase], alone: Sequence[Flight], fleets: TrimmedFleet) -> dict[int, str]:
    """Of flights with an aircraft that cannot fly steadily at its start: what stops it."""
    found = {}
    steady = np.asarray(fleets.is_trimmed)
    for k, (case, flight) in enumerate(zip(cases, alone, strict=True)):
        try:
            check_trimmable(case.scenario, flight, steady[k])
        except ScenarioError as error:
            found[k] = "; ".join(map(str, error.problems))
    return found


def _first_plan(scenario: Scenario, planner: CertifiedPlanner, tasks: AircraftTask) -> CertifiedPlanState | None:
    outcome, holds = planner.search_plan(0.0, tasks, arrival_request(scenario), scenario.timing.duration_s)
    return None if outcome.plan is None else CertifiedPlanState(outcome.plan, first_plan_status(), holds, tasks.limits)


def _summed_up(
    cases: Sequence[FlightCase],
    flights: _Flights,
    states: FlightState,
    places: Sequence[int],
    series: SeriesSelection | None,
    precision: Precision,
) -> list[FlightRow]:
    """Fly a batch to its end; rows of the cases, at their places in it."""
    if not cases:
        return []
    flights = Stacked(cast_flight(flights.batched, precision), cast_flight(flights.shared, precision))
    states, timing = cast_state(states, precision), cases[0].scenario.timing
    steps = round(timing.duration_s / timing.step_s)
    size, last = _size_of(flights), as_array(steps, np.int32)
    apart = np.zeros((size, 2))
    apart[list(places)] = [case.scenario.separation.required_m or (0.0, 0.0) for case in cases]
    separations = Separation(*map(as_array, apart.T))
    memory = jax.tree.map(
        lambda leaf: as_array(np.broadcast_to(np.asarray(leaf), (size, *np.shape(leaf))), None),
        SummaryRecorder().init(len(cases[0].scenario.aircraft)),
    )
    simpler = Stacked(without_replanning(flights.batched), without_replanning(flights.shared))
    parts: list[dict[str, np.ndarray]] = []
    for since in range(0, steps + 1, SEGMENT_STEPS):
        number = as_array(since, np.int32)
        flown = _segment(simpler, states, memory, separations, number, last, series)
        after = flown[0]
        asked = np.flatnonzero(np.asarray(after.planner.replan_needed))
        for some in (asked[k : k + _AGAIN] for k in range(0, asked.size, _AGAIN)):
            # what came of it does not count; filled up to one size with the last of them
            which = np.concatenate([some, np.repeat(some[-1:], _AGAIN - some.size)])
            own = Stacked(_rows(flights.batched, which), flights.shared)
            chosen = _rows((states, memory, separations), which)
            full = _segment(own, *chosen, number, last, series)
            flown = jax.tree.map(lambda held, new, which=which: _put(held, which, new), flown, full)
        states, memory, rows = flown
        if series is not None:
            parts.append(series.segment_rows(rows, since, steps))
    summary = jax.tree.map(np.asarray, memory[0])
    arrivals = np.asarray(_arrivals(flights, states))
    found = []
    for case, at in zip(cases, places, strict=True):
        row = build_flight_row(_row(summary, at), arrivals[at], case.scenario)
        kept = {} if series is None else series.values(parts, at, case.scenario)
        found.append(dataclasses.replace(row, series=kept))
    return found


@compiled
def _arrivals(flights: _Flights, states: FlightState) -> Array:
    return flights.map(lambda flight, state: flight.planner.plans(state.planner).arrival_time, states)


def _by_structure(plans: dict[int, CertifiedPlanState]) -> list[list[int]]:
    """Places of plans of the same shapes: how many intervals a path has depends on how long it takes."""
    found: dict[Any, list[int]] = {}
    for k, plan in plans.items():
        found.setdefault(tree_signature(plan), []).append(k)
    return list(found.values())


def _size_of(flights: _Flights) -> int:
    return len(jax.tree.leaves(flights.batched)[0])


def _row(rows: Any, k: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[k], rows)


def _rows(rows: Any, which: np.ndarray) -> Any:
    return jax.tree.map(lambda leaf: as_array(np.asarray(leaf)[which], None), rows)


def _put(held: Array, which: np.ndarray, new: Array) -> Array:
    found = np.array(held)
    found[which] = np.asarray(new)
    return as_array(found, None)


def _bytes_of(value: Any) -> bytes:
    """All numbers of a value, and its structure, as one text of bytes: equal where planning is asked the same."""
    leaves, structure = jax.tree.flatten(value)
    text = hashlib.sha256(repr(structure).encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        text.update(array.tobytes() if array.dtype != object else repr(leaf).encode())
    return text.digest()
