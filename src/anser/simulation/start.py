"""The start of a flight: a fleet trimmed, what each aircraft brings to the planning, the state at time 0."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft import AbstractAirframe, AircraftState, Condition, condition, moving_state
from anser.control import AutopilotState, initial_autopilot_state
from anser.environment import Environment
from anser.planning import FleetPlan, PlanningTask, choose_sides, coordinate
from anser.planning.certified import CertifiedPlan, Traveller
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.simulation.fleet import Fleet, Flight, FlightState
from anser.simulation.planned_hold import PlannedHolds
from anser.simulation.sensing import Sensed, sense
from anser.simulation.status import NO_TRIM
from anser.simulation.trim import EXCESS_NOISE, TrimPoint, solve_trim
from anser.spatial import rotate_back


def velocity_over_ground_n(now: Condition, state: AircraftState) -> Vector3:
    """Velocity over the ground, NED, m/s."""
    return rotate_back(now.R_bn, state.velocity_b)


def planning_tasks(
    fleet: Fleet,
    time: ScalarLike,
    aircraft: AircraftState,
    now: Condition,
    sensed: Sensed,
    flown: Float[Array, " aircraft"],
    deceleration: Float[Array, " aircraft"],
    speed: ScalarLike,
    stopped: Bool[Array, " aircraft"],
) -> PlanningTask:
    """What each aircraft brings to the planning, of itself and of its goal as its sensor tells; stacked.

    Plans live in the Earth's chart: velocities become rates of its coordinates here. Those that have stopped are not
    active: the others are planned without them.
    """
    scale = now.earth.chart_scale
    wind_n = scale * now.wind_n
    return PlanningTask(
        position_n=aircraft.position_n,
        air_velocity_n=scale * jax.vmap(velocity_over_ground_n)(now, aircraft) - wind_n,
        goal_position_n=sensed.goal_position_n,
        goal_velocity_n=sensed.goal_velocity_n,
        rendezvous=fleet.rendezvous,
        wind_n=wind_n,
        origin_n=fleet.start_positions_n + wind_n * time,
        length_due=speed * time - flown,
        deceleration=deceleration,
        active=~stopped,
    )


def _along_path(airframe: AbstractAirframe, now: Condition, power: ScalarLike) -> Scalar:
    """Thrust at a power (percent) less drag, over mass, in the trimmed condition, m/s^2."""
    data = now.air_data
    pushed = airframe.propulsion(power, data.altitude, data.mach)
    direction_b = jnp.stack(
        [jnp.cos(data.alpha) * jnp.cos(data.beta), jnp.sin(data.beta), jnp.sin(data.alpha) * jnp.cos(data.beta)]
    )
    return jnp.sum(direction_b * (now.aerodynamic.force_b + pushed.force_b)) / airframe.mass_properties.mass


class Ready(eqx.Module):
    """A fleet trimmed at its start, which has no plan yet; leading axis aircraft.

    Attributes
    ----------
    trims
        Steady flight of each.
    now
        Its condition there.
    sensed
        What it sees of its goal.
    autopilots
        Their memory at the start.
    deceleration, acceleration
        What it can hold with the engine idle, and with all its thrust, in level flight, m/s^2.
    """

    trims: TrimPoint
    now: Condition
    sensed: Sensed
    autopilots: AutopilotState
    deceleration: Float[Array, " aircraft"]
    acceleration: Float[Array, " aircraft"]


def make_ready(flight: Flight) -> Ready:
    """Trim every aircraft at its start and look at its goal, at time 0."""
    fleet, environment = flight.fleet, flight.environment
    trims = jax.vmap(solve_trim, in_axes=(0, None, 0, 0))(
        fleet.airframes, environment, fleet.starts, fleet.start_positions_n
    )
    aircraft = trims.state
    autopilots = jax.vmap(
        lambda t: initial_autopilot_state(jnp.stack([t.mu, t.alpha, t.beta]), t.state.rates_b, t.state.surfaces)
    )(trims)
    now = jax.vmap(condition, in_axes=(0, None, None, 0))(fleet.airframes, environment, 0.0, aircraft)
    sensed = sense_all(environment, fleet, 0.0, aircraft, now)
    along = jax.vmap(_along_path, in_axes=(0, 0, None))
    return Ready(trims, now, sensed, autopilots, -along(fleet.airframes, now, 0.0), along(fleet.airframes, now, 100.0))


def _untrimmed(trims: TrimPoint) -> Bool[Array, " aircraft"]:
    """Which aircraft have no steady flight at their start: they are not flown, nor planned for."""
    return ~trims.converged | (trims.excess > EXCESS_NOISE)


def start_flight(flight: Flight) -> tuple[FlightState, TrimPoint]:
    """Trim every aircraft at its start, choose the sides of the detours and make the published plan, at time 0."""
    fleet, ready = flight.fleet, make_ready(flight)
    aircraft = ready.trims.state
    requested = fleet.sides.astype(float)
    flown = jnp.zeros_like(requested)
    stopped = _untrimmed(ready.trims)
    tasks = planning_tasks(
        fleet, 0.0, aircraft, ready.now, ready.sensed, flown, ready.deceleration, fleet.speed, stopped
    )
    start_time = jnp.zeros(())
    sides = choose_sides(coordinate(start_time, tasks, fleet.speed, requested, fleet.even_speed), requested)
    plan = coordinate(start_time, tasks, fleet.speed, sides, fleet.even_speed)
    return begin(flight, ready, plan, sides), ready.trims


def begin(
    flight: Flight,
    ready: Ready,
    plan: FleetPlan | CertifiedPlan,
    sides: Float[Array, " aircraft"],
    holds: PlannedHolds | None = None,
) -> FlightState:
    """State of a flight at time 0 with its first plan, and with the holds that belong to it."""
    trims = ready.trims
    stopped = _untrimmed(trims)
    status = jnp.where(stopped, NO_TRIM, plan.statuses).astype(jnp.int32)
    moving = jax.vmap(moving_state, in_axes=(None, 0))(flight.environment, trims.state)
    zero = jnp.asarray(0)
    return FlightState(
        zero,
        moving,
        ready.autopilots,
        plan,
        zero,
        sides,
        ready.deceleration,
        jnp.zeros_like(sides),
        status,
        stopped,
        holds,
    )


def travellers(
    fleet: Fleet, aircraft: AircraftState, now: Condition, sensed: Sensed, stopped: Bool[Array, " aircraft"]
) -> Traveller:
    """What each aircraft brings to the certified planner; in steady straight flight, as at the start.

    Those that have stopped are not active: the others are planned without them.
    """
    certified = fleet.certified
    if certified is None:
        raise ValueError("the fleet has no settings of the certified planner (Fleet.certified)")
    scale = now.earth.chart_scale
    wind_n = scale * now.wind_n
    air_velocity_n = scale * jax.vmap(velocity_over_ground_n)(now, aircraft) - wind_n
    count = fleet.sides.shape[0]
    return Traveller(
        position_n=aircraft.position_n,
        air_velocity_n=air_velocity_n,
        air_acceleration_n=jnp.zeros_like(air_velocity_n),
        goal_position_n=sensed.goal_position_n,
        goal_velocity_n=sensed.goal_velocity_n,
        rendezvous=fleet.rendezvous,
        speed=jnp.full(count, fleet.speed),
        side=fleet.sides,
        limits=certified.limits,
        roll_rate_max=certified.roll_rates_max,
        active=jnp.where(stopped, 0.0, 1.0),
    )


def sense_all(
    environment: Environment, fleet: Fleet, time: ScalarLike, aircraft: AircraftState, now: Condition
) -> Sensed:
    """What each aircraft sees of its goal; leading axis aircraft."""
    velocities_n = jax.vmap(velocity_over_ground_n)(now, aircraft)
    return jax.vmap(sense, in_axes=(None, 0, None, 0, 0))(
        environment.earth, fleet.goals, time, aircraft.position_n, velocities_n
    )
