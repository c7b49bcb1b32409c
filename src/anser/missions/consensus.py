"""The first plan of a fleet without a centre: agreed on over the network, first the arrival time, then the paths."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.compiling.options import compiled_quickly, enable_compilation_cache
from anser.missions.first_plan import (
    CertifiedFirstPlan,
    NoPlanError,
    PrepareNext,
    arrival_request,
    first_plan_status,
    trim_and_build_tasks,
)
from anser.numerics.arrays import as_array, select_rows
from anser.planning.certified.certified_plan import CertifiedPlan, FixedPaths, certify, choose_interval_count
from anser.planning.certified.planner import CertifiedPlanState
from anser.planning.certified.replanning import interval_count
from anser.planning.certified.search import SearchOutcome, search
from anser.planning.certified.task import AircraftTask, ArrivalRequest
from anser.planning.decentralised.network import Network
from anser.planning.decentralised.planner import DecentralisedPlanner
from anser.planning.holds.assignment import assign_holds
from anser.planning.holds.hold_paths import PlannedHolds, choose_cell_count
from anser.scenario.build import build_flight
from anser.scenario.flight_checks import check_trimmable
from anser.scenario.schema import Scenario
from anser.scenario.schema_network import Network as NetworkTable
from anser.shapes import Scalar
from anser.simulation.flight import Flight, FlightState
from anser.simulation.start import TrimmedFleet, initialize_flight

DELAY_FACTORS = (1.0, 1.03, 1.08, 1.15, 1.3)
"""What is proposed one after the other, of the arrival time on which the fleet had agreed."""
_assign_holds = compiled_quickly(assign_holds)


@compiled_quickly
def _initialize_compiled(flight: Flight, fleet: TrimmedFleet, plan_state: CertifiedPlanState) -> FlightState:
    return initialize_flight(
        flight, fleet, cast(DecentralisedPlanner, flight.planner).initial_state(plan_state, flight.randomness)
    )


@compiled_quickly
def _certify_fleet(plan: CertifiedPlan, tasks: AircraftTask, airspace: Any) -> Any:
    return certify(plan.paths, tasks, airspace, interval_count(plan.paths))


@compiled_quickly
def _links(network: Network, positions_n: Any, active: Any, randomness: Any, rounds: Any) -> Any:
    """Which links are up at each exchange before the flight."""

    def one(outages: Any, number: Any) -> Any:
        return network.links(outages, positions_n, active, number, randomness)

    count = active.shape[0]
    return jax.lax.scan(one, jnp.zeros((count, count), dtype=bool), rounds)[1]


class Agreement(eqx.Module):
    """What a fleet has agreed on, as arrays.

    Attributes
    ----------
    first
        Paths and holds.
    after_s
        How long it talked.
    """

    plan_state: CertifiedPlanState
    negotiation_s: Scalar


@dataclass(frozen=True, repr=False)
class DecentralisedFirstPlan(CertifiedFirstPlan):
    """What the aircraft of a fleet without a centre have agreed on.

    Attributes
    ----------
    agreed_after_s
        How long they talked.
    """

    agreed_after_s: float

    def initial_state(self) -> FlightState:
        """The fleet at its start, with the plan."""
        return _initialize_compiled(self.flight, self.fleet, self.saved_state().plan_state)

    def saved_state(self) -> Agreement:
        """Paths, holds, and how long they talked."""
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        first = CertifiedPlanState(self.outcome.plan, first_plan_status(), self.holds, self.padded_tasks.limits)
        return Agreement(first, as_array(self.agreed_after_s))

    def notes(self) -> tuple[str, ...]:
        """As of the certified planner, and how long they talked."""
        talked = f"agreed without a centre after {self.agreed_after_s:.1f} s"
        return (talked, *super().notes())


class _NoAgreementError(Exception):
    """No plan came of it; its argument says why."""


@dataclass
class _MessageFlood:
    """Messages before the flight: what was sent by some reaches all others after so many exchanges."""

    links: np.ndarray  # (exchange, aircraft, aircraft)
    delay: int
    names: tuple[str, ...]
    period_s: float
    exchange_index: int = 0

    def broadcast(self, sources: list[int]) -> None:
        """Wait until what each of some aircraft says has reached everyone, passed on by the others."""
        self.exchange_index = max(self._reached(source) for source in sources)

    def _reached(self, source: int) -> int:
        count = len(self.names)
        known = np.full(count, np.iinfo(int).max)
        known[source] = self.exchange_index
        for exchange in range(self.exchange_index, len(self.links)):
            if (known <= exchange).all():
                return exchange
            senders = known <= exchange
            heard = (self.links[exchange][:count, :count] & senders[None, :]).any(axis=1)
            known = np.where(heard, np.minimum(known, exchange + max(self.delay, 1)), known)
        unheard = ", ".join(f'"{self.names[k]}"' for k in np.flatnonzero(known > len(self.links)))
        raise _NoAgreementError(
            f"the fleet does not agree within network.agree_within_s = {len(self.links) * self.period_s:g} s: what "
            f'aircraft "{self.names[source]}" says does not reach {unheard or "all others in time"}'
        )


def plan_decentralised(
    scenario: Scenario,
    on_progress: Callable[[str], None] = lambda what: None,
    prepare_next: PrepareNext = lambda *of: None,
) -> DecentralisedFirstPlan:
    """Trim every aircraft and let the fleet agree.

    Each looks for its own first arrival; the latest of these is what all agree on (max-consensus). Then, in the order
    of the scenario, each looks for a path that arrives then and keeps clear of the paths it has heard of; one that
    finds none proposes a later time, and all begin again. The holds follow from the paths by a rule that all know.

    Parameters
    ----------
    scenario
        With `fleet.planner = "decentralised"`.
    on_progress, ahead
        As of `anser.plan`.

    Raises
    ------
    ScenarioError
        If an aircraft cannot fly steadily at its start.
    """
    enable_compilation_cache()
    on_progress("trimming")
    flight = build_flight(scenario, pad_fleet=True)
    planner = cast(DecentralisedPlanner, flight.planner)
    fleet, tasks = trim_and_build_tasks(flight, planner.aircraft_planner)
    check_trimmable(scenario, flight, fleet.is_trimmed)
    plan, holds, talked_s, why = negotiate_plan(scenario, flight, tasks, on_progress)
    if plan is not None:
        first = CertifiedPlanState(plan, first_plan_status(), holds, tasks.limits)
        program = _initialize_compiled.prepare(flight, fleet, first).start()
        following = prepare_next(flight, program.shapes)
        if following is not None:
            following.start()
    refusals = (why,) if why else ()
    airspace = planner.aircraft_planner.airspace
    return DecentralisedFirstPlan(
        scenario, flight, fleet, refusals, SearchOutcome(plan, 1), tasks, airspace, holds, talked_s
    )


def negotiate_plan(
    scenario: Scenario, flight: Flight, tasks: AircraftTask, on_progress: Callable[[str], None] = lambda what: None
) -> tuple[CertifiedPlan | None, PlannedHolds | None, float, str]:
    """What a fleet agrees on: plan and holds, or why there are none; and how long it talked, s."""
    talk = _make_message_flood(scenario, flight, tasks)
    try:
        plan, holds = _reach_agreement(scenario, cast(DecentralisedPlanner, flight.planner), tasks, talk, on_progress)
    except _NoAgreementError as error:
        return None, None, talk.exchange_index * talk.period_s, str(error)
    return plan, holds, talk.exchange_index * talk.period_s, ""


def _make_message_flood(scenario: Scenario, flight: Flight, tasks: AircraftTask) -> _MessageFlood:
    numbers = scenario.network or NetworkTable()
    planner = cast(DecentralisedPlanner, flight.planner)
    rounds = np.arange(round(numbers.agree_within_s / numbers.period_s), 0, -1, dtype=np.int32)
    # before the flight: samples below that of what is drawn once
    links = _links(
        planner.network,
        tasks.position_n,
        as_array(np.asarray(tasks.active) > 0.0, bool),
        flight.randomness,
        as_array(-1 - rounds, np.int32),
    )
    names = tuple(one.name for one in scenario.aircraft)
    return _MessageFlood(np.asarray(links), int(planner.network.delay), names, numbers.period_s)


def _single_task(tasks: AircraftTask, who: int) -> AircraftTask:
    """The tasks of a fleet of which one is to be planned."""
    itself = np.arange(np.asarray(tasks.active).size) == who
    active = np.where(itself, np.asarray(tasks.active), 0.0)
    return eqx.tree_at(lambda t: t.active, tasks, as_array(active))


def _reach_agreement(
    scenario: Scenario,
    planner: DecentralisedPlanner,
    tasks: AircraftTask,
    talk: _MessageFlood,
    on_progress: Callable[[str], None],
) -> tuple[CertifiedPlan, PlannedHolds]:
    names, request = talk.names, arrival_request(scenario, np.asarray(tasks.active).size)
    offsets = request.offsets(np.asarray(tasks.active).size)
    fixed = request.times_s is not None
    airspace, latest = planner.aircraft_planner.airspace, request.latest_s
    if fixed:
        wanted = np.asarray(request.times_s)
    else:
        firsts = []
        for k, name in enumerate(names):
            on_progress(f"{name} looks for its first arrival")
            found = search(0.0, _single_task(tasks, k), airspace, ArrivalRequest("together", latest)).plan
            if found is None:
                raise _NoAgreementError(f'aircraft "{name}" finds no path of its own that arrives within {latest:g} s')
            firsts.append(float(np.asarray(found.arrival_times)[k]) - offsets[k])
        talk.broadcast(list(range(len(names))))
        wanted = max(firsts) + offsets
    failed = ""
    for later in DELAY_FACTORS[:1] if fixed else DELAY_FACTORS:
        times = (wanted - offsets) * later + offsets
        if np.max(times[: len(names)]) > latest:
            break
        made, failed = _plan_in_turn(planner, tasks, times, talk, on_progress)
        if made is None:
            continue
        on_progress("choosing the holds")
        until = as_array(scenario.timing.duration_s)
        holds = _assign_holds(
            made.paths,
            tasks,
            airspace,
            planner.aircraft_planner.guidance,
            as_array(0.0),
            until,
            choose_cell_count(scenario.timing.duration_s),
        )
        if np.asarray(holds.clear)[: len(names)].all():
            return made, holds
        failed = "no holds keep the aircraft clear of each other after their arrivals"
    raise _NoAgreementError(failed or f"the fleet agrees on no arrival within {latest:g} s")


def _plan_in_turn(
    planner: DecentralisedPlanner,
    tasks: AircraftTask,
    times: np.ndarray,
    talk: _MessageFlood,
    on_progress: Callable[[str], None],
) -> tuple[CertifiedPlan | None, str]:
    """A plan in which each keeps clear of those before it; or why there is none."""
    airspace, made = planner.aircraft_planner.airspace, None
    request = ArrivalRequest("times", float(np.max(times)), times_s=times)
    intervals = choose_interval_count(float(np.max(times)))
    for k, name in enumerate(talk.names):
        on_progress(f"{name} plans for its arrival at {times[k]:.1f} s")
        standing = None
        if made is not None:
            standing = FixedPaths(as_array(np.arange(times.size) < k, bool), made.paths, made.arrival_times)
        found = search(0.0, _single_task(tasks, k), airspace, request, fixed_paths=standing, intervals=intervals).plan
        if found is None:
            talk.broadcast([k])
            return (
                None,
                f'aircraft "{name}" finds no path that arrives at {times[k]:.1f} s and keeps clear of the others',
            )
        own = as_array(np.arange(times.size) == k, bool)
        ratios = found.certificate.clearance_ratio
        made = found if made is None else _with_aircraft_rows(made, found, own)
        made = eqx.tree_at(lambda p: p.certificate.clearance_ratio, made, ratios)
        talk.broadcast([k])
    assert made is not None
    return eqx.tree_at(lambda p: p.certificate, made, _certify_fleet(made, tasks, airspace)), ""


@compiled_quickly
def _with_aircraft_rows(made: CertifiedPlan, found: CertifiedPlan, own: Any) -> CertifiedPlan:
    """A plan with the rows of one aircraft from another."""
    return select_rows(own, found, made)
