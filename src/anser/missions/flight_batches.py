"""Many flights in batches: flights of equal structure are computed together and summarized while they are flown."""

import dataclasses
import functools
import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import jax
import numpy as np
from jaxtyping import Array

from anser.compiling.options import (
    compiled,
    compiled_by_older_generator,
    compiled_quickly,
    enable_compilation_cache,
)
from anser.config.errors import ScenarioError
from anser.missions.batches import BATCH, Progress, no_progress
from anser.missions.first_plan import (
    NoPlanError,
    aircraft_planner,
    arrival_request,
    certified_plan_state,
    start_search_programs,
    trim_and_build_tasks,
)
from anser.missions.flight_outputs import OutputRecording
from anser.missions.runs import needs_single_flight, precision_problems, run
from anser.missions.segments import BatchState, fly_segments, replan_flights
from anser.missions.series import SeriesSelection
from anser.numerics.arrays import Stacked, as_array, stack_objects, stack_rows, take_rows, tree_signature
from anser.numerics.randomness import AbstractRandomness, flight_randomness
from anser.planning.certified.certified_plan import CertifiedPlan
from anser.planning.certified.planner import CertifiedPlanner, CertifiedPlanState
from anser.planning.certified.search import search
from anser.planning.certified.task import AircraftTask, KeepOuts
from anser.planning.separation import Separation
from anser.results.flight_rows import FlightRow, build_flight_row
from anser.scenario.build import build_flight
from anser.scenario.build_planner import keep_outs_of
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.shapes import Integer
from anser.simulation.fleet_summary import SummaryRecorder
from anser.simulation.flight import SEGMENT_STEPS, Flight, FlightState, Precision, cast_flight, cast_state, fly
from anser.simulation.start import TrimmedFleet, initialize_flight, start_flight

NO_PLAN = "no plan: the certified planner found none within the limits, the separation and the keep-outs"


class FlightCase(NamedTuple):
    """One flight of many: a scenario, with the flight number and the seed that determine its random numbers."""

    scenario: Scenario
    number: int = 0  # flight number
    seed: int | None = None  # None: seed of the scenario
    randomness: AbstractRandomness | None = None  # source of the random numbers, instead of number and seed


_FlightBatch = Stacked[Flight]


@compiled_quickly
def _start_flights(flights: _FlightBatch) -> tuple[FlightState, TrimmedFleet]:
    return flights.map(start_flight)


@compiled_quickly
def _trim_and_build_tasks(flights: _FlightBatch) -> tuple[TrimmedFleet, AircraftTask]:
    return flights.map(lambda flight: trim_and_build_tasks(flight, aircraft_planner(flight)))


@compiled_quickly
def _initialize_flights(flights: _FlightBatch, fleets: TrimmedFleet, plans: CertifiedPlanState) -> FlightState:
    return flights.map(initialize_flight, fleets, plans)


class _RequiredDistances(NamedTuple):
    """Separation and keep-outs that each flight of a batch must keep; leading axis flights."""

    separation: Separation
    keep_outs: KeepOuts


# The loops of the older generator over a batch are a little faster too. Without `fewer_copies` each step copies the
# plans of the batch, which takes a fifth to a third of its time.
@compiled_by_older_generator((), "flights", fewer_copies=True)
def _fly_segment(
    flights: _FlightBatch,
    states: FlightState,
    summaries: Any,
    required: _RequiredDistances,
    first_sample: Integer,
    step_count: Integer,
    last_sample: Integer,
    series: SeriesSelection | None = None,
    outputs: OutputRecording | None = None,
) -> Any:
    def fly_one(flight: Flight, state: FlightState, recorder_state: Any, distances: _RequiredDistances) -> Any:
        summary = SummaryRecorder(
            separation=distances.separation, last_sample=last_sample, keep_outs=distances.keep_outs
        )
        recorder = summary if series is None else series.recorder(summary)
        recorder = recorder if outputs is None else outputs.recorder(recorder, last_sample)
        return fly(
            flight, state, first_sample, recorder=recorder, recorder_state=recorder_state, active_steps=step_count
        )

    return flights.map(fly_one, states, summaries, required)


def fly_many(
    cases: Sequence[FlightCase],
    progress: Progress | None = None,
    batch: int | None = None,
    on_rows: Callable[[list[int], list[FlightRow]], None] = lambda numbers, flight_rows: None,
    series: SeriesSelection | None = None,
    precision: Precision = "float64",
    outputs: OutputRecording | None = None,
) -> list[FlightRow]:
    """Fly many scenarios in batches of equal structure, and summarize each flight as `anser.run` does.

    Parameters
    ----------
    cases
        Flights. A scenario with events to which the planner responds, or without a central planner, is flown singly;
        its case must have the number 0 and no `randomness`.
    progress
        Called with a description of the current work and its completed share, 0..1.
    batch
        Number of flights in one compiled call; fewer flights are padded to this number. Each number needs a compiled
        program of its own. None: the number of flights that are not flown singly, at most `BATCH`.
    on_rows
        Called with the indices in `cases` and the result rows of finished flights: first once for the flights that are
        refused because of the precision, then after each batch, once for the flights that cannot be built, and after
        each flight that is flown singly.
    series
        Variables recorded over time; None: no series.
    precision
        Precision of the flights; planning always uses float64. For a scenario that does not allow the precision, the
        result row contains the reason.
    outputs
        Outputs of a study, computed for each flight; None: none.

    Returns
    -------
    Result rows, in the order of `cases`.

    Raises
    ------
    ValueError
        If a case that is flown singly has a number other than 0, or `randomness`.
    """
    enable_compilation_cache()
    on_progress = progress or no_progress
    flight_rows: list[FlightRow | None] = [None] * len(cases)
    refusals = precision_problems([case.scenario for case in cases], precision)
    accepted = [k for k in range(len(cases)) if k not in refusals]
    single = [k for k in accepted if needs_single_flight(cases[k].scenario)]
    batched = [k for k in accepted if k not in set(single)]
    finished = 0

    def deliver(numbers: list[int], finished_rows: list[FlightRow]) -> None:
        nonlocal finished
        for number, flight_row in zip(numbers, finished_rows, strict=True):
            flight_rows[number] = flight_row
        finished += len(numbers)
        on_rows(numbers, finished_rows)
        on_progress(f"flying {len(cases)} flights", finished / len(cases))

    on_progress(f"flying {len(cases)} flights", 0.0)
    if refusals:
        deliver(list(refusals), [FlightRow.failed_start(reason) for reason in refusals.values()])
    unbuildable: dict[int, str] = {}
    for group, positions, flights in _group_cases([cases[k] for k in batched], batch or BATCH, unbuildable):
        numbers = [batched[k] for k in positions]
        stacked = group.stacked(flights, min(BATCH, len(batched)) if batch is None else batch)
        before, size = finished, len(numbers)

        def on_share(share: float, before: int = before, size: int = size) -> None:
            on_progress(f"flying {len(cases)} flights", (before + share * size) / len(cases))

        flown = _fly_batch([cases[k] for k in numbers], stacked, flights, series, precision, outputs, on_share)
        deliver(numbers, flown)
    if unbuildable:
        deliver([batched[k] for k in unbuildable], [FlightRow.failed_start(reason) for reason in unbuildable.values()])
    for k in single:
        deliver([k], [_fly_alone(cases[k], series, outputs)])
    return cast(list[FlightRow], flight_rows)


@dataclasses.dataclass(frozen=True)
class PlannedFlights:
    """Flights with plans of the certified planner, before they are flown."""

    numbers: list[int]  # indices of the cases that have a plan
    flights: list[Flight]  # flights of these cases
    fleets: list[TrimmedFleet]  # trimmed fleet of each flight
    plans: list[CertifiedPlan]  # plan of each flight


def plan_many(cases: Sequence[FlightCase]) -> PlannedFlights:
    """Trim and plan many flights of equal structure by the certified planner, up to the arrivals.

    Flights that cannot be trimmed or planned are left out. The search tries only the preferred arrival times and plans
    no holds (holding patterns). The arrival rule "earliest" has no preferred times and thus no plan.

    Raises
    ------
    ValueError
        If the scenarios have different structures, or a planner other than the certified planner.
    """
    enable_compilation_cache()
    result = PlannedFlights([], [], [], [])
    size, signatures = min(BATCH, len(cases)), set[Any]()
    for group, numbers, flights in _group_cases(cases, BATCH):
        signatures.add(tree_signature(flights[0]))
        if len(signatures) > 1 or not isinstance(flights[0].planner, CertifiedPlanner):
            raise ValueError(
                f"{cases[0].scenario.name}: arrived flights of different structure, or another planner; expected "
                "flights of equal structure with the certified planner"
            )
        chosen = [cases[k] for k in numbers]
        fleets, tasks = _trim_and_build_tasks(group.stacked(flights, size))
        refusals = _find_untrimmable(chosen, flights, fleets)

        rows = jax.tree.map(np.asarray, fleets)
        for k in [k for k in range(len(numbers)) if k not in refusals]:
            airspace, request = aircraft_planner(flights[k]).airspace, arrival_request(chosen[k].scenario)
            plan = search(0.0, _index_row(tasks, k), airspace, request, thorough=False).plan
            if plan is not None:
                result.numbers.append(numbers[k])
                result.flights.append(flights[k])
                result.fleets.append(_index_row(rows, k))
                result.plans.append(plan)
    return result


def _fly_alone(case: FlightCase, series: SeriesSelection | None, outputs: OutputRecording | None) -> FlightRow:
    """Fly one case as `anser.run` does; the row of a flight that cannot start contains the reason.

    Raises ValueError if the case has a number other than 0, or `randomness`.
    """
    if case.number != 0 or case.randomness is not None:
        received = f"the number {case.number}" if case.randomness is None else "random numbers of its own"
        raise ValueError(f"{case.scenario.name}: arrived {received}; expected 0 and none, as it is flown alone")
    try:
        scenario = case.scenario if case.seed is None else case.scenario.replace("seed", case.seed)
        # outputs need every step; the series then select their rows from all steps
        stride = 1 if outputs is not None else None if series is None else series.stride
        if stride is not None:
            scenario = scenario.replace("timing.record_period_s", stride * scenario.timing.step_s)
        result = run(scenario)
    except (NoPlanError, ScenarioError) as error:
        return FlightRow.failed_start(str(error))
    summary = result.summary
    # without wall times, by which repeated flights would differ
    fleet = {key: value for key, value in summary["fleet"].items() if key not in ("wall_s", "simulated_s")}
    dataset = result.dataset
    output_values = {} if outputs is None else outputs.values_from_dataset(dataset, scenario.timing.step_s)
    if series is not None and outputs is not None:
        dataset = dataset.isel(time=slice(None, None, series.stride))
    series_values = {} if series is None else series.values_from_dataset(dataset)
    rows = summary["aircraft"], fleet, summary["requirements"]
    return FlightRow(*rows, result.met, series=series_values, outputs=output_values)


class _FlightGroup:
    """Flights of equal structure that wait for a batch.

    An array that differs between the flights of a batch has a batch axis in this batch and in later batches, which then
    need no other compiled program; all flights share the arrays that do not differ.
    """

    def __init__(self) -> None:
        self.differ: np.ndarray | None = None
        self.numbers: list[int] = []
        self.flights: list[Flight] = []

    def stacked(self, flights: Sequence[Flight], size: int) -> _FlightBatch:
        """Stack flights to a batch of `size` flights, padded with copies of the last flight."""
        padding = [flights[-1]] * (size - len(flights))
        stacked = stack_objects([*flights, *padding], tables_only=False, batched=self._differing)
        # per leaf of a flight; absent parts (None) have no leaves; used for later batches to avoid recompilation
        self.differ = np.array(
            jax.tree.leaves(jax.tree.map(lambda _, batched: batched is not None, flights[-1], stacked.batched))
        )
        return stacked

    def _differing(self, flight: Flight) -> list[Any]:
        leaves = jax.tree.leaves(flight)
        # at least one leaf is batched: identical flights, too, need an axis to map over
        differ = np.arange(len(leaves)) == 0 if self.differ is None else self.differ
        return [leaf for leaf, differs in zip(leaves, differ, strict=True) if differs]


def _group_cases(
    cases: Sequence[FlightCase],
    batch: int,
    unbuildable: dict[int, str] | None = None,  # receives the reasons of ScenarioErrors by index; None: they are raised
) -> Iterator[tuple[_FlightGroup, list[int], list[Flight]]]:
    """Yield batches of at most `batch` flights of equal structure, step, replanning period and duration.

    Each item has the group, the indices in `cases` of the flights in the batch, and these flights.
    """
    groups: dict[Any, _FlightGroup] = {}
    previous: tuple[Scenario, Flight] | None = None
    for number, case in enumerate(cases):
        if previous is None or case.scenario is not previous[0]:
            try:
                previous = case.scenario, build_flight(case.scenario)
            except ScenarioError as error:
                if unbuildable is None:
                    raise
                unbuildable[number] = "; ".join(map(str, error.problems))
                continue
        seed = case.scenario.seed if case.seed is None else case.seed
        randomness = flight_randomness(seed, case.number) if case.randomness is None else case.randomness
        flight = dataclasses.replace(previous[1], randomness=randomness)
        timing = case.scenario.timing
        key = tree_signature(flight), timing.step_s, timing.replan_period_s, timing.duration_s
        group = groups.setdefault(key, _FlightGroup())
        group.numbers.append(number)
        group.flights.append(flight)
        if len(group.numbers) == batch:
            numbers, flights, group.numbers, group.flights = group.numbers, group.flights, [], []
            yield group, numbers, flights
    for group in groups.values():
        if group.numbers:
            yield group, group.numbers, group.flights


def _fly_batch(
    cases: Sequence[FlightCase],
    flights: _FlightBatch,
    single_flights: Sequence[Flight],
    series: SeriesSelection | None,
    precision: Precision,
    outputs: OutputRecording | None,
    on_share: Callable[[float], None],
) -> list[FlightRow]:
    """Trim, plan and fly one batch; return one result row for each of `cases`.

    `flights` is the batch, padded to a fixed size; `single_flights` has the same flights one by one. `on_share` is
    called with the completed share of the batch, 0..1.
    """
    searched = 0.0
    parts: list[tuple[list[int], _FlightBatch, FlightState, Sequence[int]]] = []
    if not isinstance(single_flights[0].planner, CertifiedPlanner):
        states, fleets = _start_flights(flights)
        refusals = _find_untrimmable(cases, single_flights, fleets)
        selected = [k for k in range(len(cases)) if k not in refusals]
        parts.append((selected, flights, states, selected))
    else:
        _start_planning_programs(cases[0].scenario, single_flights[0], flights)
        fleets, tasks = _trim_and_build_tasks(flights)
        refusals = _find_untrimmable(cases, single_flights, fleets)
        flown = _flown_batch(cases, flights, range(len(cases)), series, precision, outputs)
        plans = _search_plans(
            cases,
            single_flights,
            tasks,
            refusals,
            lambda share: on_share(0.5 * share),
            lambda plan: _start_flight_programs(flown, flights, fleets, plan, precision),
        )
        searched = 0.5
        for selected in _group_by_structure(plans):
            indices = np.array([*selected, *[selected[-1]] * (_size_of(flights) - len(selected))])
            chosen_flights = Stacked(take_rows(flights.batched, indices), flights.shared)
            chosen_plans = stack_rows([plans[k] for k in indices])
            states = _initialize_flights(chosen_flights, take_rows(fleets, indices), chosen_plans)
            parts.append((selected, chosen_flights, states, range(len(selected))))
    flight_rows = {k: FlightRow.failed_start(reason) for k, reason in refusals.items()}
    for selected, part_flights, states, positions in parts:
        selected_cases = [cases[k] for k in selected]
        share_before = searched + (1.0 - searched) * (len(flight_rows) - len(refusals)) / len(cases)
        part_share = (1.0 - searched) * len(selected) / len(cases)

        def on_part(share: float, before: float = share_before, part: float = part_share) -> None:
            on_share(before + part * share)

        finished_rows = _summarize_flights(
            selected_cases, part_flights, states, positions, series, precision, outputs, on_part
        )
        flight_rows |= dict(zip(selected, finished_rows, strict=True))
    return [flight_rows[k] for k in range(len(cases))]


def _start_planning_programs(scenario: Scenario, flight: Flight, flights: _FlightBatch) -> None:
    """Start to compile two kinds of programs: trim of the whole batch, and search for a plan of one flight."""
    _, tasks = _trim_and_build_tasks.prepare(flights).start().shapes
    one_flight = jax.tree.map(lambda shape: jax.ShapeDtypeStruct(shape.shape[1:], shape.dtype), tasks)
    start_search_programs(scenario, aircraft_planner(flight), one_flight)


def _search_plans(
    cases: Sequence[FlightCase],
    single_flights: Sequence[Flight],
    tasks: AircraftTask,
    refusals: dict[int, str],
    on_share: Callable[[float], None],
    on_first_plan: Callable[[CertifiedPlanState], None],  # called with the first plan that is found
) -> dict[int, CertifiedPlanState]:
    """Search the first plans of the flights of a batch that are not in `refusals`; return the plans by index.

    If no plan is found for a flight, its reason is added to `refusals`. Indices are positions in the batch.
    """
    plans: dict[int, CertifiedPlanState | None] = {}
    plans_by_input: dict[bytes, CertifiedPlanState | None] = {}
    for k in [k for k in range(len(cases)) if k not in refusals]:
        task, planner, scenario = _index_row(tasks, k), aircraft_planner(single_flights[k]), cases[k].scenario
        # flights with equal starts and equal requests share the search
        input_hash = _content_hash((task, planner, arrival_request(scenario)))
        if input_hash not in plans_by_input:
            plan = plans_by_input[input_hash] = _first_plan(scenario, planner, task)
            on_share((k + 1) / len(cases))
            if plan is not None and all(former is None for former in plans.values()):
                on_first_plan(plan)
        plans[k] = plans_by_input[input_hash]
    refusals |= {k: NO_PLAN for k, plan in plans.items() if plan is None}
    return {k: plan for k, plan in plans.items() if plan is not None}


def _find_untrimmable(
    cases: Sequence[FlightCase], single_flights: Sequence[Flight], fleets: TrimmedFleet
) -> dict[int, str]:
    """Return the reason for each flight that has an aircraft that cannot be trimmed, by index in the batch."""
    reasons = {}
    is_trimmed, alphas = np.asarray(fleets.is_trimmed), [np.asarray(group_alphas) for group_alphas in fleets.alphas]
    for k, (case, flight) in enumerate(zip(cases, single_flights, strict=True)):
        try:
            check_trimmable(case.scenario, flight, is_trimmed[k], [group_alphas[k] for group_alphas in alphas])
        except ScenarioError as error:
            reasons[k] = "; ".join(map(str, error.problems))
    return reasons


def _first_plan(scenario: Scenario, planner: CertifiedPlanner, tasks: AircraftTask) -> CertifiedPlanState | None:
    outcome, holds = planner.search_plan(0.0, tasks, arrival_request(scenario), scenario.timing.duration_s)
    return None if outcome.plan is None else certified_plan_state(outcome.plan, holds, tasks.limits)


@dataclasses.dataclass(frozen=True)
class _FlownBatch:
    """Batch in flight: the constant arguments of the program that flies segments."""

    flights: _FlightBatch  # flights in the precision of the steps
    required: _RequiredDistances  # separation and keep-outs with which the recorders compare the flown distances
    first_summaries: Any  # states of the recorders before the first step
    steps: int  # number of steps of a flight
    series: SeriesSelection | None
    outputs: OutputRecording | None

    @property
    def row_stride(self) -> int:
        """Number of steps between two recorded rows."""
        return 1 if self.series is None else self.series.recording_stride

    def arguments(self, state: BatchState, first_sample: int, step_count: int) -> tuple[Any, ...]:
        """Return the arguments of the program that flies a segment from `state`, a state or shapes of a state."""
        numbers = (as_array(number, np.int32) for number in (first_sample, step_count, self.steps))
        # the program of flights without outputs has no argument for them
        selections = (self.series,) if self.outputs is None else (self.series, self.outputs)
        return (self.flights, *state, self.required, *numbers, *selections)

    def fly_on(self, state: BatchState, first_sample: int, step_count: int) -> tuple[BatchState, Any]:
        """Fly `step_count` steps from sample `first_sample`; return the new state and the recorded rows."""
        flown = _fly_segment(*self.arguments(state, first_sample, step_count))
        return BatchState(*flown[:2]), flown[2]


def _flown_batch(
    cases: Sequence[FlightCase],
    flights: _FlightBatch,
    positions: Sequence[int],  # indices of the cases in the batch
    series: SeriesSelection | None,
    precision: Precision,
    outputs: OutputRecording | None,
) -> _FlownBatch:
    timing, size = cases[0].scenario.timing, _size_of(flights)
    scenarios = [cases[0].scenario] * size
    for case, position in zip(cases, positions, strict=True):
        scenarios[position] = case.scenario
    separations_m = np.array([scenario.separation.required_m or (0.0, 0.0) for scenario in scenarios])
    recorder = SummaryRecorder() if outputs is None else outputs.recorder(SummaryRecorder(), None)
    first_summaries = jax.tree.map(
        lambda leaf: as_array(np.broadcast_to(np.asarray(leaf), (size, *np.shape(leaf))), None),
        recorder.init(len(cases[0].scenario.aircraft)),
    )
    return _FlownBatch(
        Stacked(cast_flight(flights.batched, precision), cast_flight(flights.shared, precision)),
        _RequiredDistances(Separation(*map(as_array, separations_m.T)), keep_outs_of(*scenarios)),
        first_summaries,
        round(timing.duration_s / timing.step_s),
        None if series is None else series.for_segments(math.gcd(SEGMENT_STEPS, _replan_steps(cases[0]))),
        outputs,
    )


def _replan_steps(case: FlightCase) -> int:
    return round(case.scenario.timing.replan_period_s / case.scenario.timing.step_s)


def _start_flight_programs(
    flown: _FlownBatch, flights: _FlightBatch, fleets: TrimmedFleet, plan: CertifiedPlanState, precision: Precision
) -> None:
    """Start to compile the programs that fly a batch, for plans with the shapes of `plan`, the plan of one flight."""
    size = _size_of(flights)
    plans = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct((size, *leaf.shape), leaf.dtype), plan)
    states = _initialize_flights.prepare(flights, fleets, plans).start().shapes
    states = jax.eval_shape(lambda state: cast_state(state, precision), states)
    _fly_segment.prepare(*flown.arguments(BatchState(states, flown.first_summaries), 0, 0)).start()


def _summarize_flights(
    cases: Sequence[FlightCase],
    flights: _FlightBatch,
    states: FlightState,
    positions: Sequence[int],
    series: SeriesSelection | None,
    precision: Precision,
    outputs: OutputRecording | None,
    on_share: Callable[[float], None],
) -> list[FlightRow]:
    """Fly a planned batch to the end of its flights and return the result rows of the cases.

    `states` are the flights' states at time 0, with the plans. `positions` are the indices of the cases in the batch;
    other flights are padding. `on_share` is called with the completed share, 0..1.
    """
    if not cases:
        return []
    flown, replan_steps = _flown_batch(cases, flights, positions, series, precision, outputs), _replan_steps(cases[0])
    parts: list[dict[str, np.ndarray]] = []
    state = BatchState(cast_state(states, precision), flown.first_summaries)
    replan = functools.partial(replan_flights, flown.flights)
    segments = fly_segments(flown.fly_on, replan, state, positions, flown.steps, replan_steps, flown.row_stride)
    for segment in segments:
        state = segment.state
        if flown.series is not None:
            parts.append(flown.series.segment_rows(segment.rows, segment.first_sample, segment.end - 1))
        on_share(min(segment.end, flown.steps) / flown.steps)
    final_summaries = jax.tree.map(np.asarray, state.summaries)
    fleet_summaries, output_state = final_summaries if outputs is not None else (final_summaries, ())
    arrivals = np.asarray(_arrival_times(flown.flights, state.flights))
    finished_rows = []
    for case, position in zip(cases, positions, strict=True):
        flight_row = build_flight_row(_index_row(fleet_summaries[0], position), arrivals[position], case.scenario)
        series_values = {} if flown.series is None else flown.series.values(parts, position, case.scenario)
        output_values = {} if outputs is None else outputs.values(output_state, position)
        finished_rows.append(dataclasses.replace(flight_row, series=series_values, outputs=output_values))
    return finished_rows


@compiled
def _arrival_times(flights: _FlightBatch, states: FlightState) -> Array:
    return flights.map(lambda flight, state: flight.planner.plans(state.planner).arrival_time, states)


def _group_by_structure(plans: dict[int, CertifiedPlanState]) -> list[list[int]]:
    """Group the indices of the plans by equal array shapes, which depend on the durations of the paths."""
    groups: dict[Any, list[int]] = {}
    for k, plan in plans.items():
        groups.setdefault(tree_signature(plan), []).append(k)
    return list(groups.values())


def _size_of(flights: _FlightBatch) -> int:
    return len(jax.tree.leaves(flights.batched)[0])


def _index_row(tree: Any, k: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[k], tree)


def _content_hash(value: Any) -> bytes:
    leaves, structure = jax.tree.flatten(value)
    text = hashlib.sha256(repr(structure).encode())
    for leaf in leaves:
        array = np.asarray(leaf)
        text.update(array.tobytes() if array.dtype != object else repr(leaf).encode())
    return text.digest()
