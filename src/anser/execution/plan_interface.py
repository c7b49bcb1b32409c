"""What a first plan is for people, whichever planner made it."""

import abc
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from anser.compiling import Prepared
from anser.numerics import each_of
from anser.scenario import Scenario
from anser.simulation import Flight, FlightState, TrimmedFleet, TrimPoint

SPEED_TOLERANCE = 1e-3
"""Part of the fleet's speed by which a mean airspeed may differ without a note."""


Ahead = Callable[[Flight, Any], Prepared | None]
"""Prepares the program that is needed after the plan, for a flight and the shapes of its first state."""


class NoPlanError(Exception):
    """The certified planner found no plan; `reasons` says why, one sentence each."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class PlanFileError(ValueError):
    """A file that holds no plan, or not one for the scenario."""


@dataclass(frozen=True, repr=False)
class Planned(abc.ABC):
    """The first plan of a scenario; printed, it is when the aircraft arrive and what is wrong.

    Attributes
    ----------
    scenario
        What was planned.
    flight
        Its arrays, filled up to a size with aircraft that never fly.
    fleet
        All of these, trimmed at the start.
    refusals
        Why there is no plan, one sentence each; empty where there is one.
    """

    scenario: Scenario
    flight: Flight
    fleet: TrimmedFleet
    refusals: tuple[str, ...]

    @property
    def trims(self) -> tuple[TrimPoint, ...]:
        """Steady flight of each aircraft at its start."""
        of_kinds = zip(self.flight.kinds, self.fleet.trims, strict=True)
        found = {place: one for kind, rows in of_kinds for place, one in zip(kind.members, each_of(rows), strict=True)}
        return tuple(found[place] for place in range(len(self.scenario.aircraft)))

    @functools.cached_property
    @abc.abstractmethod
    def plan(self) -> Any:
        """The planner's own plan; raises `NoPlanError` if there is none."""

    @abc.abstractmethod
    def problems(self) -> tuple[str, ...]:
        """Why there is no plan, or why it cannot be flown as it stands, one sentence each; empty where it can."""

    @abc.abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Where the plan differs from the scenario's words, one sentence each."""

    @abc.abstractmethod
    def path_words(self) -> tuple[str, ...]:
        """How the path of each aircraft goes, in two or three words."""

    @abc.abstractmethod
    def begun(self) -> FlightState:
        """The fleet at its start, with the plan."""

    def kept(self) -> Any:
        """What a file keeps of it: arrays in a module."""
        return self.begun().planner

    def __repr__(self) -> str:
        return "\n  ".join([self._head(), *self._told()])

    def _repr_html_(self) -> str:
        from anser.results import notebook_table

        rows = []
        if not self.refusals:
            arrivals = np.broadcast_to(np.asarray(self.plan.arrival_times), len(self.scenario.aircraft))
            rows = [
                {"aircraft": one.name, "goal": one.goal, "arrives at, s": f"{float(time):.2f}", "path": words}
                for one, time, words in zip(self.scenario.aircraft, arrivals, self.path_words(), strict=True)
            ]
        return notebook_table(self._head(), rows, self._told())

    def _head(self) -> str:
        head = f"{self.scenario.name}, {self.scenario.fleet.planner} planner: "
        if self.refusals:
            return f"{head}no plan"
        from anser.results import planned_arrivals

        arrivals_s = np.asarray(self.plan.arrival_times)
        first_s, last_s = (float(end(arrivals_s)) for end in (np.min, np.max))
        return head + planned_arrivals(len(self.scenario.aircraft), first_s, last_s)

    def _told(self) -> list[str]:
        """What is wrong with it, and what is to be noted."""
        problems = self.problems() if self.refusals else [f"not flyable: {one}" for one in self.problems()]
        return [*problems, *(f"note: {one}" for one in self.notes())]
