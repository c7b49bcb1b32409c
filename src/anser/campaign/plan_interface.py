"""What a first plan is for people, whichever planner made it."""

from typing import Any, Protocol

import numpy as np

from anser.scenario import Scenario
from anser.simulation import Flight, FlightState, TrimmedFleet, TrimPoint

SPEED_TOLERANCE = 1e-3
"""Part of the fleet's speed by which a mean airspeed may differ without a note."""


class NoPlanError(Exception):
    """The certified planner found no plan; `reasons` says why, one sentence each."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class Planned(Protocol):
    """The first plan of a scenario; printed, it is when the aircraft arrive and what is wrong."""

    @property
    def scenario(self) -> Scenario:
        """What was planned."""
        ...

    @property
    def flight(self) -> Flight:
        """Its arrays."""
        ...

    @property
    def fleet(self) -> TrimmedFleet:
        """The fleet trimmed at its start."""
        ...

    @property
    def trims(self) -> TrimPoint:
        """Steady flight of each aircraft at its start; leading axis aircraft."""
        ...

    @property
    def plan(self) -> Any:
        """The planner's own plan; raises `NoPlanError` if there is none."""
        ...

    @property
    def refusals(self) -> tuple[str, ...]:
        """Why there is no plan, one sentence each; empty where there is one."""
        ...

    def problems(self) -> tuple[str, ...]:
        """Why there is no plan, or why it cannot be flown as it stands, one sentence each; empty where it can."""
        ...

    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from the scenario's words, one sentence each."""
        ...

    def path_words(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, in two or three words."""
        ...

    def begun(self) -> FlightState:
        """The fleet at its start, with the plan."""
        ...


def plan_in_words(planned: Planned) -> str:
    """A plan as it is printed: which planner, when they arrive, what is wrong."""
    scenario, problems = planned.scenario, planned.problems()
    head = f"{scenario.name}, {scenario.fleet.planner} planner: "
    if planned.refusals:
        return "\n  ".join([f"{head}no plan", *problems])
    arrivals_s = np.asarray(planned.plan.arrival_times)
    first, last = (f"{float(end(arrivals_s)):.2f} s" for end in (np.min, np.max))
    when = f"all arrive at {last}" if first == last else f"arrivals from {first} to {last}"
    notes = (f"note: {one}" for one in planned.notes())
    return "\n  ".join([head + when, *(f"not flyable: {one}" for one in problems), *notes])
