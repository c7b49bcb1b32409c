"""Planning a scenario with the certified planner, or saying why no plan exists."""

import math
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
from anser.results import turn_words
from anser.scenario import Scenario, build_flight
from anser.simulation import (
    Flight,
    FlightState,
    PlannedHolds,
    Ready,
    TrimPoint,
    assign_holds,
    begin,
    cells_for,
    make_ready,
    travellers,
)

_ready = compiled_quickly(make_ready)
_holds = compiled_quickly(assign_holds)
SAME_SPEED = 1e-3
"""Part of the fleet's speed that nobody needs to be told of."""


NOT_PROVEN = "nothing proves that it keeps its limits, the separation and the keep-outs"
"""Message of a path that the certified planner delivers without a proof."""


class NoPlanError(Exception):
    """The certified planner found no plan; `reasons` says why, one sentence each."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


@dataclass(frozen=True, repr=False)
class CertifiedPlanned:
    """What came of planning a scenario for the certified planner; printed, it is when they arrive, or why not.

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
        NoPlanError
            If there is none; the message says why.
        """
        if self.outcome.plan is None:
            raise NoPlanError(self.refusals)
        return self.outcome.plan

    @property
    def trims(self) -> TrimPoint:
        """Steady flight of each aircraft at its start; leading axis aircraft."""
        return self.ready.trims

    def problems(self) -> tuple[str, ...]:
        """Why there is no plan, or why it cannot be flown as it stands, one sentence each; empty where it can."""
        if self.outcome.plan is None:
            return self.refusals
        pairs = zip(self.scenario.aircraft, np.asarray(self.plan.good), strict=True)
        return tuple(f'aircraft "{one.name}": {NOT_PROVEN}' for one, good in pairs if not good)

    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from what the scenario prefers, the mean airspeed, in one sentence; or nothing."""
        if self.outcome.plan is None:
            return ()
        asked_m_s, found_m_s = self.scenario.fleet.speed_m_s, np.asarray(self.plan.lengths / self.plan.arrival_times)
        others = np.flatnonzero(np.abs(found_m_s / asked_m_s - 1.0) > SAME_SPEED)
        if not others.size:
            return ()
        names = ", ".join(f"{self.scenario.aircraft[k].name} {found_m_s[k]:.1f} m/s" for k in others)
        return (f"mean airspeeds other than the preferred fleet.speed_m_s = {asked_m_s:g} m/s: {names}",)

    def path_words(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, such as "turns 83 deg"."""
        return tuple(turn_words(math.degrees(float(turned))) for turned in np.asarray(self.plan.turned))

    def begun(self) -> FlightState:
        """The fleet at its start, with the plan."""
        return begin(self.flight, self.ready, self.plan, jnp.zeros(len(self.scenario.aircraft)), self.holds)

    def __repr__(self) -> str:
        arrivals = None if self.outcome.plan is None else np.asarray(self.outcome.plan.arrival_times)
        return plan_in_words(self.scenario, arrivals, self.problems(), self.notes())


def plan_in_words(
    scenario: Scenario, arrivals_s: np.ndarray | None, problems: tuple[str, ...], notes: tuple[str, ...]
) -> str:
    """A plan as it is printed: which planner, when they arrive, what is wrong.

    Parameters
    ----------
    scenario
        What was planned.
    arrivals_s
        When each arrives, s; None without a plan.
    problems
        Why there is none, or why it cannot be flown.
    notes
        Where it differs from the scenario's words.
    """
    head = f"{scenario.name}, {scenario.fleet.planner} planner: "
    if arrivals_s is None:
        return "\n  ".join([f"{head}no plan", *problems])
    first, last = (f"{float(end(arrivals_s)):.2f} s" for end in (np.min, np.max))
    when = f"all arrive at {last}" if first == last else f"arrivals from {first} to {last}"
    return "\n  ".join([head + when, *(f"not flyable: {one}" for one in problems), *(f"note: {one}" for one in notes)])


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
