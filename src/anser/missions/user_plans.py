"""First plan of a scenario by a user-defined planner, a planner from outside the package."""

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.environment.environment import AbstractWind
from anser.missions.first_plan import FirstPlan, OnProgress, PrepareNext, trim_and_plan
from anser.numerics.arrays import first_rows
from anser.parts.paths import AbstractReference, PathPoint
from anser.parts.planners import AircraftPlan
from anser.scenario.schema import Scenario
from anser.scenario.user_parts import part_error, trace_method
from anser.shapes import ScalarLike, Vector3
from anser.simulation.closed_loop import STATUS_MESSAGES, plan_status
from anser.simulation.flight import Flight, statuses
from anser.simulation.start import trimmed_fleet

if TYPE_CHECKING:
    from anser.missions.plan_output import RecordedPlan


class PathThroughAir(eqx.Module):
    """Trajectory of a user-defined planner; the velocity relative to the air is computed with the flight's wind."""

    trajectory: AbstractReference
    wind: AbstractWind

    def at(self, time: ScalarLike) -> PathPoint:
        """Return position, velocity and acceleration over the ground at a time (s); NED, m, m/s, m/s^2."""
        return self.trajectory.at(time)

    def air_velocity_n(self, time: ScalarLike) -> Vector3:
        """Return the velocity relative to the air at a time (s), NED, m/s."""
        point = self.trajectory.at(time)
        return point.velocity_n - self.wind.at(point.position_n, time)


@dataclass(frozen=True, repr=False)
class UserFirstPlan(FirstPlan):
    """First plan by a user-defined planner, which always yields a plan; `problems` lists obstacles to the flight."""

    state_type = type(None)

    @classmethod
    def make(
        cls, scenario: Scenario, flight: Flight, on_progress: OnProgress, prepare_next: PrepareNext
    ) -> "UserFirstPlan":
        """Trim every aircraft at its start and plan by the user-defined planner.

        Raises ScenarioError if JAX cannot trace the planner, if its plans are not one `AircraftPlan` with leading axis
        aircraft, if an arrival time is NaN or not after the start, or if an aircraft cannot be trimmed.
        """
        _check_plans(flight)
        state, fleet = trim_and_plan(scenario, flight, on_progress, prepare_next)
        planned = cls(scenario, flight, fleet, (), state.planner, state)
        if not np.all(planned.arrivals_s > 0.0):
            arrived = f"arrival times {', '.join(f'{time_s:g}' for time_s in planned.arrivals_s)} s"
            raise part_error("planner", flight.planner, "plans", arrived, "times after the start of the flight, 0 s")
        return planned

    @functools.cached_property
    def plan(self) -> AircraftPlan:
        """Plans of the scenario's aircraft, without the padding of `flight`; leading axis aircraft."""
        return first_rows(self.flight.planner.plans(self.plan_state), len(self.scenario.aircraft))

    @property
    def arrivals_s(self) -> np.ndarray:
        """Planned arrival time of each aircraft, s after the start of the flight."""
        return np.broadcast_to(np.asarray(self.plan.arrival_time), len(self.scenario.aircraft))

    def notes(self) -> tuple[str, ...]:
        """Return an empty tuple: a user-defined planner has no means to report notes."""
        return ()

    def problems(self) -> tuple[str, ...]:
        """Return the obstacles to flying the plan, one sentence each; empty for a flyable plan.

        Obstacles are a last arrival at or after the end of the flight, and aircraft with an error status.
        """
        duration_s = self.scenario.timing.duration_s
        late = f"the fleet arrives at {self.arrival_s:.1f} s, the flight ends at {duration_s:g} s"
        own_codes = statuses(self.flight, self.initial_state())[0][: len(self.scenario.aircraft)]
        codes = np.asarray(plan_status(own_codes, self.plan.status))
        named = zip(self.scenario.aircraft, codes, strict=True)
        problems = [f'aircraft "{aircraft.name}": {STATUS_MESSAGES[int(code)]}' for aircraft, code in named if code]
        return (*([late] if self.arrival_s >= duration_s else []), *problems)

    def path_descriptions(self) -> tuple[str, ...]:
        """Return the name of the planner's class, repeated for every aircraft of the scenario."""
        return (type(self.flight.planner).__name__,) * len(self.scenario.aircraft)

    def saved_state(self) -> Any:
        """Raise ValueError: a plan file cannot describe the construction of a user-defined planner."""
        raise ValueError(
            "a plan by a user-defined planner is not written to a file; plan again in the process that flies it"
        )

    def record(self) -> "RecordedPlan":
        """Return samples of the plan over time and a report, in which no path is compared with the limits."""
        from anser.missions.plan_output import record_user_plan

        # paths have a leading axis aircraft throughout, and so has their wind
        count = len(self.scenario.aircraft)
        wind = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), self.flight.environment.wind)
        paths = PathThroughAir(self.plan.trajectory, wind)
        return record_user_plan(self.scenario, paths, self.arrivals_s, self.flight.environment.gravity, self.problems())


def _check_plans(flight: Flight) -> None:
    """Trace `first_plan` and `plans` of a user-defined planner on shapes alone, without numbers.

    Raises ScenarioError if a method fails, or if `plans` returns no AircraftPlan with leading axis aircraft.
    """
    planner, fleet = flight.planner, eqx.filter_eval_shape(trimmed_fleet, flight)
    state = trace_method("planner", planner, "first_plan", jnp.zeros(()), fleet.reports, fleet.performance)
    plans = trace_method("planner", planner, "plans", state)
    if not isinstance(plans, AircraftPlan):
        wrong = [type(plans).__name__]
    else:
        wrong = [
            f"{jax.tree_util.keystr(path, simple=True, separator='.')} of shape {leaf.shape}"
            for path, leaf in jax.tree_util.tree_leaves_with_path(plans)
            if leaf.shape[:1] != (flight.count,)
        ]
    if wrong:
        expected = f"an AircraftPlan with a leading axis of {flight.count} aircraft throughout, as jax.vmap makes it"
        raise part_error("planner", planner, "plans", wrong[0], expected)
