"""A fleet's flight: its constant data.

Its state between two steps, and the closed loop of all aircraft with planning and replanning.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.compiling.single_kernel import as_single_kernel
from anser.environment.environment import Environment
from anser.numerics.arrays import (
    Stacked,
    any_in_batch,
    as_array,
    cast_to_precision,
    stack_objects,
    stack_rows,
    tree_signature,
)
from anser.numerics.randomness import AbstractRandomness
from anser.parts.perception import GoalState, Instant, velocity_over_ground_n
from anser.parts.planners import AbstractPlanner, AircraftPlan, AircraftReport
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.simulation.closed_loop import PLAN_TOO_NEAR, Perception, act, is_breakaway, perceive
from anser.simulation.recorders import (
    AbstractRecorder,
    FleetSample,
    History,
    scan_steps,
    to_fleet_order,
    to_group_order,
)
from anser.simulation.vehicle import Vehicle, VehicleState
from anser.spatial.rotations import safe_norm
from anser.steady.trim import TrimTarget


class Timing(eqx.Module):
    """Periods of a flight, s.

    Attributes
    ----------
    step
        Sampling period of the aircraft's parts and step of the integrator.
    replan_steps
        Number of steps between plans; 0 plans once, at the start.
    freeze
        The plan stands still for this long before the arrival.
    """

    step: Scalar
    replan_steps: Count
    freeze: Scalar


class AircraftGroup(eqx.Module):
    """Aircraft of one structure, which fly as one batch.

    Attributes
    ----------
    vehicles
        Their parts.
    starts
        Steady flight from which each starts; leading axis members.
    start_positions_n
        Where, m.
    flies
        Whether each is one of the fleet's aircraft; the others fill it up to a size and never fly.
    members
        Place of each in the fleet.
    """

    vehicles: Stacked[Vehicle]
    starts: TrimTarget
    start_positions_n: Float[Array, "members 3"]
    is_real: Bool[Array, " members"]
    members: tuple[int, ...] = eqx.field(static=True)


class Flight(eqx.Module):
    """Everything that determines a flight.

    Attributes
    ----------
    environment
        Where.
    kinds
        The fleet, by kinds of aircraft; whatever has a leading axis aircraft goes by `Kind.members`.
    planner
        Of all.
    timing
        Periods.
    randomness
        Source of random numbers, of the seed and the flight; None: nothing may draw any.
    """

    environment: Environment
    groups: tuple[AircraftGroup, ...]
    planner: AbstractPlanner
    timing: Timing
    randomness: AbstractRandomness | None = None

    @property
    def members(self) -> tuple[tuple[int, ...], ...]:
        """Places in the fleet of the members of each kind."""
        return tuple(kind.members for kind in self.groups)

    @property
    def count(self) -> int:
        """Number of aircraft."""
        return sum(len(kind.members) for kind in self.groups)

    @property
    def surfaces(self) -> tuple[tuple[str, ...], ...]:
        """Names of the control surfaces of each aircraft, in the fleet's order."""
        named = {
            place: kind.vehicles.batched.airframe.actuators.names for kind in self.groups for place in kind.members
        }
        return tuple(named[place] for place in range(self.count))

    def aircraft(self, place: int) -> tuple[Vehicle, TrimTarget, Vector3]:
        """The aircraft at a place in the fleet, the steady flight that it starts from, and where, m."""
        for kind in self.groups:
            if place in kind.members:
                k = kind.members.index(place)
                start = jax.tree.map(lambda leaf, k=k: leaf[k], (kind.starts, kind.start_positions_n))
                return kind.vehicles.at(k), *start
        raise IndexError(f"a fleet of {self.count} aircraft has none at place {place}")


class FlightState(eqx.Module):
    """A flight between two steps.

    Attributes
    ----------
    vehicles
        By kind; leading axis members.
    planner
        What the planner carries along, the plan in force among it.
    """

    vehicles: tuple[VehicleState, ...]
    planner: Any


def assemble(
    environment: Environment,
    aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]],
    planner: AbstractPlanner,
    step: ScalarLike,
    replan_steps: int,
    freeze: ScalarLike = 0.0,
    randomness: AbstractRandomness | None = None,
    flying: int | None = None,
) -> Flight:
    """Put a flight together; aircraft of one structure become one kind.

    Parameters
    ----------
    environment
        Where.
    aircraft
        Of each: its parts, the steady flight that it starts from, and where (NED, m).
    planner
        Of all.
    step
        Sampling period, s.
    replan_steps
        Number of steps between plans; 0 plans once.
    freeze
        How long the plan stands still before the arrival, s.
    randomness
        Source of random numbers.
    flying
        How many of the aircraft, from the first on, fly: the others fill the fleet up to a size for which a program is
        compiled already. None: all.

    Raises
    ------
    ValueError
        No aircraft, or one without a mission.
    """
    if not aircraft:
        raise ValueError("a flight needs at least one aircraft")
    without = [str(k) for k, (vehicle, _, _) in enumerate(aircraft) if vehicle.mission is None]
    if without:
        raise ValueError(f"aircraft without a goal cannot be planned for: place {', '.join(without)} of the fleet")
    kinds: dict[Any, list[int]] = {}
    for k, (vehicle, _, _) in enumerate(aircraft):
        kinds.setdefault(tree_signature(vehicle), []).append(k)
    return Flight(
        environment=environment,
        groups=tuple(
            _kind(aircraft, members, len(aircraft) if flying is None else flying) for members in kinds.values()
        ),
        planner=planner,
        timing=Timing(
            step=as_array(step),
            replan_steps=as_array(replan_steps, np.int32),
            freeze=as_array(freeze),
        ),
        randomness=randomness,
    )


def _kind(
    aircraft: Sequence[tuple[Vehicle, TrimTarget, Vector3]], members: Sequence[int], flying: int
) -> AircraftGroup:
    vehicles, starts, places = zip(*(aircraft[k] for k in members), strict=True)
    return AircraftGroup(
        vehicles=stack_objects(vehicles, batched=lambda vehicle: vehicle.mission),
        starts=stack_rows(starts),
        start_positions_n=stack_rows(places),
        is_real=as_array([k < flying for k in members], bool),
        members=tuple(members),
    )


def merge_groups(flight: Flight, of_kinds: Sequence[Any]) -> Any:
    """Stacked rows of each kind's members as those of the fleet, in its order."""
    return to_fleet_order(list(of_kinds), flight.members)


def select_group_rows(rows: Any, kind: AircraftGroup, count: int) -> Any:
    """Rows of a kind's members, of those of a fleet of so many aircraft."""
    return to_group_order(rows, kind.members, count)


def statuses(flight: Flight, state: FlightState) -> tuple[Array, Bool[Array, " aircraft"]]:
    """Status of each aircraft, and whether it stands still."""
    return merge_groups(flight, [(one.status, one.stopped) for one in state.vehicles])


SEGMENT_STEPS = 500
"""Steps compiled as one: a flight of any duration is a number of these, so the duration does not recompile."""
_ROUNDING_M = 1e-3  # by which a plan that ends at the least distance itself may be nearer


def report(vehicle: Vehicle, seen: Perception, active: Flag) -> AircraftReport:
    """What an aircraft with a mission reports to the planner."""
    belief, mission = seen.belief, vehicle.mission
    if belief.goal is None or mission is None:
        raise ValueError("only an aircraft with a goal reports to a planner")
    now = belief.condition
    scale = now.earth.chart_scale
    wind_n = scale * now.wind_n
    return AircraftReport(
        position_n=belief.state.position_n,
        air_velocity_n=scale * velocity_over_ground_n(now, belief.state) - wind_n,
        wind_n=wind_n,
        airspeed=now.air_data.V,
        goal_position_n=belief.goal.position_n,
        goal_velocity_n=belief.goal.velocity_n,
        rendezvous=mission.rendezvous,
        active=active,
        goal_covariance=None if belief.uncertainty is None else belief.uncertainty.goal_covariance,
    )


def fleet_reports(
    flight: Flight, state: FlightState, instant: Instant, *, one_kernel: bool = False
) -> tuple[list[Perception], AircraftReport]:
    """What each aircraft perceives, by kinds, and what all of them report to the planner; leading axis aircraft."""
    compiled = as_single_kernel if one_kernel else lambda function: function

    def perceived(vehicle: Vehicle, before: VehicleState) -> Perception:
        return perceive(vehicle, before, instant)

    def reported(vehicle: Vehicle, seen: Perception, before: VehicleState) -> AircraftReport:
        away = before.stopped | is_breakaway(before.status) | vehicle.faults.has_departed(instant.time)
        return report(vehicle, seen, ~away)

    pairs = list(zip(flight.groups, state.vehicles, strict=True))
    seen = [compiled(kind.vehicles.map)(perceived, states) for kind, states in pairs]
    told = [kind.vehicles.map(reported, one, states) for (kind, states), one in zip(pairs, seen, strict=True)]
    return seen, merge_groups(flight, told)


def plans_too_near(
    flight: Flight, plans: AircraftPlan, reports: AircraftReport, time: ScalarLike
) -> Bool[Array, " aircraft"]:
    """Which plans end nearer to the goal, as it is foreseen at steady velocity, than a rendezvous may be."""
    earth = flight.environment.earth

    def one(vehicle: Vehicle, plan: AircraftPlan, report: AircraftReport) -> Flag:
        assert vehicle.mission is not None
        ahead = jnp.maximum(plan.arrival_time - time, 0.0)
        goal = GoalState(report.goal_position_n + ahead * report.goal_velocity_n, report.goal_velocity_n)
        end_n = plan.trajectory.position_n(plan.arrival_time)
        to_goal_n, _ = earth.sight(end_n, goal.position_n, goal.velocity_n)
        # not a number: there is no such plan
        return ~(safe_norm(to_goal_n) >= vehicle.mission.distance_min - _ROUNDING_M)

    found = [kind.vehicles.map(one, *select_group_rows((plans, reports), kind, flight.count)) for kind in flight.groups]
    # What has arrived is flown no more, and what does not fly has no plan of now.
    return merge_groups(flight, found) & reports.active & (plans.arrival_time > time)


def _renewed(
    flight: Flight, state: FlightState, number: Count, reports: AircraftReport
) -> tuple[Any, Bool[Array, " aircraft"]]:
    """The planner's state with a plan renewed where that is due, and which new plans are refused."""
    timing, planner = cast_to_precision(flight.timing, float), flight.planner
    time = number * timing.step
    plans = planner.plans(state.planner)
    frozen = time >= plans.arrival_time - timing.freeze
    needed = ~jnp.all(frozen | ~reports.active)
    # Free of what a batch of flights has different: planning is costly, and would run at every step otherwise.
    due = (timing.replan_steps > 0) & (number % jnp.maximum(timing.replan_steps, 1) == 0) & any_in_batch(needed)

    def anew() -> tuple[Any, Bool[Array, " aircraft"]]:
        made = planner.replan(state.planner, time, reports)
        made = jax.tree.map(lambda new, old: jnp.where(needed, new, old), made, state.planner)
        return made, needed & plans_too_near(flight, planner.plans(made), reports, time)

    return jax.lax.cond(due, anew, lambda: (state.planner, jnp.zeros(flight.count, dtype=bool)))


def send_to_hold(
    flight: Flight, vehicles: Sequence[VehicleState], refused: Bool[Array, " aircraft"]
) -> tuple[VehicleState, ...]:
    """The aircraft, those with a refused plan on their way into their holds."""

    def one(state: VehicleState, no_plan: Array) -> VehicleState:
        away = no_plan & ~state.stopped & ~is_breakaway(state.status)
        return eqx.tree_at(lambda s: s.status, state, jnp.where(away, PLAN_TOO_NEAR, state.status))

    return tuple(
        one(state, select_group_rows(refused, kind, flight.count))
        for kind, state in zip(flight.groups, vehicles, strict=True)
    )


def step_fleet(
    flight: Flight, state: FlightState, number: Count, *, one_kernel: bool = False
) -> tuple[FlightState, FleetSample, Instant]:
    """Fly the fleet over one step; the next state, and everything known at the step's start (see `fly`)."""
    instant = Instant(flight.environment, number, flight.timing.step, flight.randomness)
    compiled = as_single_kernel if one_kernel else lambda function: function
    seen, reports = fleet_reports(flight, state, instant, one_kernel=one_kernel)
    reports = cast_to_precision(reports, float)
    planner, refused = _renewed(flight, state, number, reports)
    plans = cast_to_precision(flight.planner.plans(planner), instant.step.dtype)
    vehicles = send_to_hold(flight, state.vehicles, refused)

    def acted(vehicle: Vehicle, before: VehicleState, perceived: Perception, plan: AircraftPlan) -> Any:
        return act(vehicle, before, perceived, instant, plan, flight.timing.freeze)

    moved = [
        compiled(kind.vehicles.map)(acted, before, one, select_group_rows(plans, kind, flight.count))
        for kind, before, one in zip(flight.groups, vehicles, seen, strict=True)
    ]
    step = cast_to_precision(flight.timing.step, float)
    planner = flight.planner.observe(planner, reports, number, step, flight.randomness)
    after = FlightState(tuple(states for states, _ in moved), planner)
    return after, FleetSample(tuple(samples for _, samples in moved), flight.members), instant


def fly(
    flight: Flight,
    state: FlightState,
    since: Count,
    count: int = SEGMENT_STEPS,
    recorder: AbstractRecorder | None = None,
    memory: Any = None,
    *,
    one_kernel: bool = False,
    flown: Count | None = None,
) -> tuple[FlightState, Any, Any]:
    """Fly a number of steps.

    Pure: to be compiled, batched by `vmap` over flights and states (`since` must not be batched, nor should `timing`
    be: planning would run at every step), differentiated, or moved to a GPU.

    Parameters
    ----------
    flight
        What flies.
    state
        Before the first step, from `start_flight` or from here.
    since
        Number of the first step: 0 at the start.
    count
        Number of steps.
    recorder, memory
        What is to be kept, and what has been so far (None: nothing yet); every variable at every step where no recorder
        is given.
    one_kernel
        Whether what each aircraft does in a step is compiled as one kernel where the machine is a CPU. It makes a
        flight by itself two to three times as fast; one that is to be batched must not be compiled so.
    flown
        How many of the steps are flown; the rows of the others mean nothing. None: all.

    Returns
    -------
    The state after the last step, the recorder's memory, and its rows: leading axis time, then aircraft.
    """
    recorder = History() if recorder is None else recorder
    memory = recorder.init(flight.count) if memory is None else memory

    def one(before: FlightState, number: Count) -> tuple[FlightState, FleetSample, Instant]:
        return step_fleet(flight, before, number, one_kernel=one_kernel)

    return scan_steps(one, state, jnp.asarray(since, dtype=jnp.int32), count, recorder, memory, flown)
