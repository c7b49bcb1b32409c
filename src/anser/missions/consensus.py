"""First plan of a fleet without a central planner: the aircraft agree on arrivals, paths and holds by messages."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling.options import compiled_quickly
from anser.missions.first_plan import (
    CertifiedFirstPlan,
    OnProgress,
    PrepareNext,
    aircraft_planner,
    arrival_request,
    certified_plan_state,
    initialize_compiled,
    start_next,
    start_programs,
    trim_and_build_tasks_compiled,
)
from anser.missions.refusal import Refusal
from anser.numerics.arrays import as_array, select_rows
from anser.planning.certified.arrival_times import first_index
from anser.planning.certified.certified_plan import CertifiedPlan, FixedPaths, certify, choose_interval_count
from anser.planning.certified.planner import CertifiedPlanState
from anser.planning.certified.replanning import interval_count
from anser.planning.certified.search import DELAY_RATIO, search
from anser.planning.certified.task import AircraftTask, ArrivalRequest
from anser.planning.decentralised.network import Network
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.holds.hold_paths import PlannedHolds
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.scenario.schema_settings import Network as NetworkTable
from anser.shapes import Scalar
from anser.simulation.flight import Flight
from anser.simulation.start import TrimmedFleet

_DELAY_COUNT = 34
"""Number of proposed arrival times, from the first agreed time to 1.3 times this time, in steps of `DELAY_RATIO`."""


@compiled_quickly
def _certify_fleet(plan: CertifiedPlan, tasks: AircraftTask, airspace: Any) -> Any:
    return certify(plan.paths, tasks, airspace, interval_count(plan.paths))


@compiled_quickly
def _links(network: Network, positions_n: Any, active: Any, randomness: Any, rounds: Any) -> Any:
    """Return the mask of the links that are up at each exchange before the flight, (exchange, receiver, sender).

    `positions_n` are the positions of the aircraft, NED, m; `active` is the mask of the aircraft that fly; `rounds` has
    the sample number of each exchange.
    """

    def links_at(outages: Any, exchange_number: Any) -> Any:
        return network.links(outages, positions_n, active, exchange_number, randomness)

    fleet_size = active.shape[0]
    return jax.lax.scan(links_at, jnp.zeros((fleet_size, fleet_size), dtype=bool), rounds)[1]


_Plan = TypeVar("_Plan")


class Agreement(eqx.Module):
    """Content of a plan file for a fleet without a central planner: the result of the negotiation."""

    plan_state: CertifiedPlanState  # paths and holds
    negotiation_s: Scalar  # duration of the negotiation, s


@dataclass(frozen=True, repr=False, kw_only=True)
class DecentralisedFirstPlan(CertifiedFirstPlan):
    """First plan of a fleet without a central planner, on which the aircraft have agreed by messages."""

    state_type = Agreement
    agreed_after_s: float  # duration of the negotiation, s

    @classmethod
    def make(
        cls, scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
    ) -> "DecentralisedFirstPlan":
        """Trim every aircraft and negotiate the first plan by messages.

        Unless the scenario prescribes the arrival times, the fleet agrees on the latest of the aircraft's earliest
        arrivals (max-consensus). Then the aircraft plan one after the other, in the order of the scenario; a path
        arrives at the agreed time and keeps the separation from the paths planned before. If an aircraft finds no path,
        or no holds (holding patterns after the arrivals) keep the separation, the fleet tries later times, unless the
        times are prescribed.

        If the fleet does not agree, `refusals` has the reason. For the arguments and errors see `anser.plan`.
        """
        on_progress("trimming")
        planner = aircraft_planner(flight)
        start_programs(
            scenario, flight, planner, trim_and_build_tasks_compiled.prepare(flight, planner).start(), prepare_next
        )
        fleet, tasks = trim_and_build_tasks_compiled(flight, planner)
        check_trimmable(scenario, flight, fleet.is_trimmed, fleet.alphas)
        plan, holds, agreed_after_s, reason = negotiate_plan(scenario, flight, tasks, on_progress)
        plan_state = None if plan is None else certified_plan_state(plan, holds, tasks.limits)
        if plan_state is not None:
            program = initialize_compiled.prepare(flight, fleet, plan_state).start()
            start_next(prepare_next, flight, program.shapes)
        refusals = (Refusal(reason),) if reason else ()
        return cls(scenario, flight, fleet, refusals, plan_state, padded_tasks=tasks, agreed_after_s=agreed_after_s)

    @classmethod
    def restore(cls, scenario: Scenario, flight: Flight, fleet: TrimmedFleet, state: Any) -> "DecentralisedFirstPlan":
        """Rebuild the first plan from a trimmed fleet and the content of a plan file (`state`, an `Agreement`)."""
        plan_state, agreed_after_s = state.plan_state, float(state.negotiation_s)
        tasks = aircraft_planner(flight).aircraft_tasks(fleet.reports, plan_state.limits)
        return cls(scenario, flight, fleet, (), plan_state, padded_tasks=tasks, agreed_after_s=agreed_after_s)

    def saved_state(self) -> Agreement:
        """Return the content of a plan file; raises `NoPlanError` if the fleet has not agreed on a plan."""
        return Agreement(self._planned_state(), as_array(self.agreed_after_s))

    def network_summary(self, time_s: np.ndarray, history: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Compute the entry `network` of a flight's summary, from the recorded times (s) and variables by key."""
        from anser.results.network_summary import summarize_network

        return summarize_network(time_s, history, self.scenario, self.agreed_after_s)

    def notes(self) -> tuple[str, ...]:
        """Return a sentence with the duration of the negotiation, and the notes of `CertifiedFirstPlan.notes`."""
        negotiation_note = f"agreed without a centre after {self.agreed_after_s:.1f} s"
        return (negotiation_note, *super().notes())


class NoAgreementError(Exception):
    """The negotiation ended without a plan; the argument is the reason, in one sentence."""


@dataclass
class MessageFlood:
    """Exchanges of messages before the flight, in which each aircraft passes on every received message."""

    links: np.ndarray  # mask of the links that are up, (exchange, receiver, sender)
    delay: int  # time from sending to reception, in exchanges
    names: tuple[str, ...]  # names of the aircraft
    period_s: float  # time between two exchanges, s
    exchange_index: int = 0  # exchange that the negotiation has reached

    def broadcast(self, sources: list[int]) -> None:
        """Advance to the exchange by which messages of all `sources` (aircraft indices) have reached the whole fleet.

        Raises NoAgreementError if the messages do not reach the whole fleet by the last exchange.
        """
        self.exchange_index = max(self._reached(source) for source in sources)

    def _reached(self, source: int) -> int:
        fleet_size = len(self.names)
        received_at = np.full(fleet_size, np.iinfo(int).max)
        received_at[source] = self.exchange_index
        for exchange in range(self.exchange_index, len(self.links)):
            if (received_at <= exchange).all():
                return exchange
            senders = received_at <= exchange
            receives = (self.links[exchange][:fleet_size, :fleet_size] & senders[None, :]).any(axis=1)
            received_at = np.where(receives, np.minimum(received_at, exchange + max(self.delay, 1)), received_at)
        unreached = ", ".join(f'"{self.names[k]}"' for k in np.flatnonzero(received_at > len(self.links)))
        raise NoAgreementError(
            f"the fleet does not agree within network.agree_within_s = {len(self.links) * self.period_s:g} s: what "
            f'aircraft "{self.names[source]}" says does not reach {unreached or "all others in time"}'
        )


def negotiate_plan(
    scenario: Scenario, flight: Flight, tasks: AircraftTask, on_progress: Callable[[str], None] = lambda message: None
) -> tuple[CertifiedPlan | None, PlannedHolds | None, float, str]:
    """Negotiate a plan before the flight by messages, see `DecentralisedFirstPlan.make`.

    Returns the plan, the holds, the duration of the negotiation (s), and "". If the fleet does not agree, plan and
    holds are None, and the last entry is the reason as a sentence.
    """
    flood = _make_message_flood(scenario, flight, tasks)
    try:
        plan, holds = _reach_agreement(scenario, cast(DecentralisedPlanner, flight.planner), tasks, flood, on_progress)
    except NoAgreementError as error:
        return None, None, flood.exchange_index * flood.period_s, str(error)
    return plan, holds, flood.exchange_index * flood.period_s, ""


def _make_message_flood(scenario: Scenario, flight: Flight, tasks: AircraftTask) -> MessageFlood:
    table = scenario.network or NetworkTable()
    planner = cast(DecentralisedPlanner, flight.planner)
    rounds = np.arange(round(table.agree_within_s / table.period_s), 0, -1, dtype=np.int32)
    # negative sample numbers: no collision with random numbers of the flight or of its start
    links = _links(
        planner.network,
        tasks.position_n,
        as_array(np.asarray(tasks.active) > 0.0, bool),
        flight.randomness,
        as_array(-1 - rounds, np.int32),
    )
    names = tuple(aircraft.name for aircraft in scenario.aircraft)
    return MessageFlood(np.asarray(links), int(planner.network.delay), names, table.period_s)


def _single_task(tasks: AircraftTask, aircraft: int) -> AircraftTask:
    """Return the tasks of the fleet with only the aircraft of index `aircraft` active."""
    is_planned = np.arange(np.asarray(tasks.active).size) == aircraft
    active = np.where(is_planned, np.asarray(tasks.active), 0.0)
    return eqx.tree_at(lambda t: t.active, tasks, as_array(active))


def _reach_agreement(
    scenario: Scenario,
    planner: DecentralisedPlanner,
    tasks: AircraftTask,
    flood: MessageFlood,
    on_progress: Callable[[str], None],
) -> tuple[CertifiedPlan, PlannedHolds]:
    """Return the paths and holds on which the fleet agrees; raises `NoAgreementError` with the reason for a failure."""
    names, request = flood.names, arrival_request(scenario, np.asarray(tasks.active).size)
    offsets = request.offsets(np.asarray(tasks.active).size)
    is_fixed = request.times_s is not None
    airspace, latest_s = planner.aircraft_planner.airspace, request.latest_s
    if is_fixed:
        agreed_times_s = np.asarray(request.times_s)
    else:
        first_arrivals = []
        for k, name in enumerate(names):
            on_progress(f"{name} looks for its first arrival")
            first_plan = search(0.0, _single_task(tasks, k), airspace, ArrivalRequest("together", latest_s)).plan
            if first_plan is None:
                raise NoAgreementError(f'aircraft "{name}" finds no path of its own that arrives within {latest_s:g} s')
            first_arrivals.append(float(np.asarray(first_plan.arrival_times)[k]) - offsets[k])
        flood.broadcast(list(range(len(names))))
        agreed_times_s = max(first_arrivals) + offsets
    delay_factors = DELAY_RATIO ** np.arange(1 if is_fixed else _DELAY_COUNT)
    delayed_times_s = (agreed_times_s - offsets) * delay_factors[:, None] + offsets
    delayed_times_s = delayed_times_s[np.max(delayed_times_s[:, : len(names)], axis=1) <= latest_s]

    def propose(index: int) -> tuple[tuple[CertifiedPlan, PlannedHolds] | None, str]:
        plan, failure = _plan_in_turn(planner, tasks, delayed_times_s[index], flood, on_progress)
        if plan is None:
            return None, failure
        on_progress("choosing the holds")
        holds = planner.aircraft_planner.assign_holds(plan.paths, tasks, 0.0, scenario.timing.duration_s)
        if np.asarray(holds.clear)[: len(names)].all():
            return (plan, holds), ""
        return None, "no holds keep the aircraft clear of each other after their arrivals"

    agreement, failure = find_agreement(len(delayed_times_s), propose, flood)
    if agreement is None:
        raise NoAgreementError(failure or f"the fleet agrees on no arrival within {latest_s:g} s")
    return agreement


def find_agreement(
    count: int, propose: Callable[[int], tuple[_Plan | None, str]], flood: MessageFlood
) -> tuple[_Plan | None, str]:
    """Find the smallest of `count` increasing delays of the arrivals to which the fleet agrees.

    If the exchanges of messages (`flood`) end after a first agreement, the result is the earliest agreement so far.

    Parameters
    ----------
    propose
        Function that proposes a delay to the fleet, by its index from 0 to `count` - 1; returns (agreement, "") or, if
        the fleet refuses the delay, (None, reason).

    Returns
    -------
    tuple
        Agreement (None if the fleet refused every delay), and the reason from the last call of `propose`.

    Raises
    ------
    NoAgreementError
        If the messages end before the first agreement.
    """
    agreement, failure, is_agreed = None, "", None
    scan = first_index(count)
    with contextlib.suppress(StopIteration):
        while True:
            index = scan.send(is_agreed)
            try:
                proposed, failure = propose(index)
            except NoAgreementError:
                if agreement is None:
                    raise
                flood.exchange_index = len(flood.links)
                break
            is_agreed = proposed is not None
            agreement = proposed if is_agreed else agreement
    return agreement, failure


def _plan_in_turn(
    planner: DecentralisedPlanner,
    tasks: AircraftTask,
    arrival_times_s: np.ndarray,
    flood: MessageFlood,
    on_progress: Callable[[str], None],
) -> tuple[CertifiedPlan | None, str]:
    """Plan the aircraft in turn for `arrival_times_s` (s); a path keeps the separation from the paths planned before.

    Returns the certified plan and "", or None and the reason for a failure. Raises NoAgreementError if the exchanges of
    messages end before the plan is complete.
    """
    airspace, plan = planner.aircraft_planner.airspace, None
    request = ArrivalRequest("times", float(np.max(arrival_times_s)), times_s=arrival_times_s)
    intervals = choose_interval_count(float(np.max(arrival_times_s)))
    for k, name in enumerate(flood.names):
        on_progress(f"{name} plans for its arrival at {arrival_times_s[k]:.1f} s")
        fixed_paths = None
        if plan is not None:
            fixed_paths = FixedPaths(
                as_array(np.arange(arrival_times_s.size) < k, bool), plan.paths, plan.arrival_times
            )
        candidate = search(
            0.0, _single_task(tasks, k), airspace, request, fixed_paths=fixed_paths, intervals=intervals
        ).plan
        if candidate is None:
            flood.broadcast([k])
            arrival = f"arrives at {arrival_times_s[k]:.1f} s"
            return None, f'aircraft "{name}" finds no path that {arrival} and keeps clear of the others'
        is_planned = as_array(np.arange(arrival_times_s.size) == k, bool)
        ratios = candidate.certificate.clearance_ratio
        plan = candidate if plan is None else _with_aircraft_rows(plan, candidate, is_planned)
        plan = eqx.tree_at(lambda p: p.certificate.clearance_ratio, plan, ratios)
        flood.broadcast([k])
    assert plan is not None
    return eqx.tree_at(lambda p: p.certificate, plan, _certify_fleet(plan, tasks, airspace)), ""


@compiled_quickly
def _with_aircraft_rows(plan: CertifiedPlan, candidate: CertifiedPlan, is_planned: Any) -> CertifiedPlan:
    """Return `plan`, in which the aircraft in the mask `is_planned` have their paths and data from `candidate`."""
    return select_rows(is_planned, candidate, plan)
