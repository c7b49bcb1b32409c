"""Planning a scenario with the certified planner, or saying why no plan exists."""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.campaign.refusal import explain, explain_unheld
from anser.campaign.untrimmable import refuse_untrimmable
from anser.compilation_cache import enable_compilation_cache
from anser.numerics import compiled_quickly
from anser.planning.certified import Airspace, ArrivalRequest, CertifiedPlan, Outcome, Traveller, search
from anser.scenario import Scenario, build_flight
from anser.simulation import Flight, PlannedHolds, Ready, assign_holds, cells_for, make_ready, travellers

_ready = compiled_quickly(make_ready)
_holds = compiled_quickly(assign_holds)


@dataclass(frozen=True)
class CertifiedPlanned:
    """What came of planning a scenario.

    Attributes
    ----------
    scenario
        What was planned.
    flight
        Its arrays, with the accelerations found at the start where the scenario leaves them out.
    ready
        The fleet at its start.
    outcome
        Of the search.
    travellers, airspace
        The task of the planner.
    holds
        What the aircraft fly after their arrivals; None where there is no plan.
    refusals
        Why there is no plan, one sentence each; empty where there is one.
    """

    scenario: Scenario
    flight: Flight
    ready: Ready
    outcome: Outcome
    travellers: Traveller
    airspace: Airspace
    holds: PlannedHolds | None
    refusals: tuple[str, ...]

    @property
    def plan(self) -> CertifiedPlan:
        """The plan.

        Raises
        ------
        ValueError
            If there is none.
        """
        if self.outcome.plan is None:
            raise ValueError(f"{self.scenario.name} has no plan: {'; '.join(self.refusals)}")
        return self.outcome.plan

    def problems(self) -> tuple[str, ...]:
        """Why the plan cannot be flown as it stands: none."""
        return ()


def with_own_accelerations(flight: Flight, ready: Ready) -> Flight:
    """The flight with the accelerations that the engine gives at the start, where none are prescribed.

    The reserve that the other limits leave is not taken off: it is a plan's, and these change on the way.
    """
    certified = flight.fleet.certified
    assert certified is not None
    limits = certified.limits
    own = (
        jnp.where(jnp.isinf(limits.acceleration_max), jnp.maximum(ready.acceleration, 0.1), limits.acceleration_max),
        jnp.where(jnp.isinf(limits.deceleration_max), jnp.maximum(ready.deceleration, 0.1), limits.deceleration_max),
    )
    return eqx.tree_at(
        lambda f: (f.fleet.certified.limits.acceleration_max, f.fleet.certified.limits.deceleration_max), flight, own
    )


def arrival_request(scenario: Scenario) -> ArrivalRequest:
    """When the aircraft of a scenario are to arrive."""
    arrival, aircraft = scenario.arrival, scenario.aircraft
    times = offsets = windows = None
    if arrival.rule == "at":
        times = np.full(len(aircraft), arrival.time_s)
    if arrival.rule == "times":
        times = np.array([one.arrive_s for one in aircraft], dtype=float)
    if arrival.rule == "windows":
        windows = np.array([(one.arrive_from_s, one.arrive_to_s) for one in aircraft], dtype=float)
    if arrival.rule == "sequence":
        names = arrival.order if arrival.order is not None else tuple(one.name for one in aircraft)
        assert arrival.spacing_s is not None
        offsets = np.array([names.index(one.name) for one in aircraft]) * arrival.spacing_s
    return ArrivalRequest(arrival.rule, scenario.timing.latest_arrival_s, times, offsets, windows)


def plan_certified(scenario: Scenario, told: Callable[[str], None] = lambda what: None) -> CertifiedPlanned:
    """Trim every aircraft, look for a plan that keeps everything, and where none is found say why.

    Parameters
    ----------
    scenario
        With `fleet.planner = "certified"`.
    told
        Called with what is being done.

    Raises
    ------
    ScenarioError
        If an aircraft cannot fly steadily at its start.
    """
    enable_compilation_cache()
    told("trimming (the first time, this compiles)")
    flight = build_flight(scenario)
    ready = _ready(flight)
    refuse_untrimmable(scenario, flight, ready.trims)
    flight = with_own_accelerations(flight, ready)
    certified = flight.fleet.certified
    assert certified is not None
    none_stopped = jnp.zeros(len(scenario.aircraft), dtype=bool)  # those without steady flight were refused
    task = travellers(flight.fleet, ready.trims.state, ready.now, ready.sensed, none_stopped)
    request = arrival_request(scenario)
    tried: list[tuple[CertifiedPlan, PlannedHolds]] = []

    def after(plan: CertifiedPlan) -> np.ndarray:
        told("choosing the holds")
        until = scenario.timing.duration_s
        shared = certified.airspace, flight.fleet.guidance
        holds = _holds(plan.paths, task, *shared, 0.0, until, cells_for(until))
        tried.append((plan, holds))
        return ~np.asarray(holds.clear)

    outcome = search(0.0, task, certified.airspace, request, told=told, after=after)
    holds = next((holds for plan, holds in tried if plan is outcome.plan), None)
    refusals: tuple[str, ...] = ()
    if outcome.plan is None:
        told("looking for what stands in the way")
        unheld = next((holds for plan, holds in tried if plan is outcome.unheld), None)
        refusals = (
            explain(scenario, task, certified.airspace, request, outcome)
            if unheld is None
            else explain_unheld(scenario, task, unheld)
        )
    return CertifiedPlanned(scenario, flight, ready, outcome, task, certified.airspace, holds, refusals)
