"""Planning a scenario with the certified planner, or saying why no plan exists."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import jax.numpy as jnp
import numpy as np

from anser.campaign.refusal import explain, explain_unheld
from anser.campaign.untrimmable import refuse_untrimmable
from anser.compilation_cache import enable_compilation_cache
from anser.numerics import compiled_quickly
from anser.planning.certified import Airspace, ArrivalRequest, CertifiedPlan, Outcome, Traveller
from anser.results import turn_words
from anser.scenario import Scenario, build_flight
from anser.simulation import (
    CertifiedPlanner,
    CertifiedPlanState,
    Flight,
    FlightState,
    PlannedHolds,
    TrimmedFleet,
    TrimPoint,
    begin,
    trimmed_fleet,
)

_trimmed = compiled_quickly(trimmed_fleet)
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
        Its arrays.
    fleet
        The fleet trimmed at its start.
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
    fleet: TrimmedFleet
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
        return self.fleet.trims

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
        state = CertifiedPlanState(self.plan, jnp.asarray(0), self.holds, self.travellers.limits)
        return begin(self.flight, self.fleet, state)

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
    fleet = _trimmed(flight)
    refuse_untrimmable(scenario, flight, fleet.trims)
    planner = cast(CertifiedPlanner, flight.planner)
    task = planner.travellers(fleet.reports, planner.limits_with(fleet.performance))
    request = arrival_request(scenario)
    outcome, holds = planner.searched(0.0, task, request, scenario.timing.duration_s, told)
    refusals: tuple[str, ...] = ()
    if outcome.plan is None:
        told("looking for what stands in the way")
        refusals = (
            explain(scenario, task, planner.airspace, request, outcome)
            if holds is None
            else explain_unheld(scenario, task, holds)
        )
        holds = None
    return CertifiedPlanned(scenario, flight, fleet, outcome, task, planner.airspace, holds, refusals)
