"""Recorders: the signals of one aircraft and of a fleet at one sample.

The variables recorded from them, and how often; rows by aircraft group and in fleet order.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.aircraft.airframe import AbstractAirframe, Controls
from anser.control.ground_clearance import GroundClearance
from anser.environment.gusts import AirFlow, Gust
from anser.numerics.arrays import zeros_like_result
from anser.parts.controllers import signal_variables
from anser.parts.paths import polar
from anser.parts.perception import Belief, GoalState, Instant, Truth, Uncertainty
from anser.parts.planners import AircraftPlan, NetworkView
from anser.shapes import Count, Vector3
from anser.spatial.rotations import euler_from_quaternion, rotate, rotate_back, safe_norm
from anser.spatial.vectors import safe_sqrt
from anser.spatial.wind_axes import bank_about_velocity, path_angles
from anser.variables import all_surface_names, surface_variables

Members = tuple[int, ...]
"""Places in the fleet of the members of a kind."""


def to_fleet_order(kinds: Sequence[Any], members: tuple[Members, ...]) -> Any:
    """Stacked rows of each kind's members as those of the fleet, in its order."""
    if len(members) == 1 and _is_whole(members[0]):
        return kinds[0]
    places = [place for of_kind in members for place in of_kind]
    order = jnp.asarray([places.index(k) for k in range(len(places))])
    return jax.tree.map(lambda *rows: jnp.concatenate(rows)[order], *kinds)


def to_group_order(rows: Any, members: Members, count: int) -> Any:
    """Rows of some members, of those of a fleet of so many aircraft."""
    if len(members) == count and _is_whole(members):
        return rows
    places = jnp.asarray(members)
    return jax.tree.map(lambda leaf: leaf[places], rows)


def _is_whole(members: Members) -> bool:
    return members == tuple(range(len(members)))


_TOLD_BY_CONTROLLER = (
    "thrust_command",
    "bank_command",
    "alpha_command",
    "beta_command",
    "roll_rate_command",
    "pitch_rate_command",
    "yaw_rate_command",
)
_FLAGGED_BY_CONTROLLER = (
    "thrust_limited",
    "lift_limited",
    "bank_limited",
    "speed_limited",
    "rates_limited",
    "surfaces_limited",
)


def record(sample: "AircraftSample") -> dict[str, Array]:
    """One row of the history of one aircraft, SI units and radians, keyed as in `anser.variables.catalogue`.

    The control surfaces are the airframe's own.
    What its controller does not tell is NaN, and no limit of it is flagged.
    """
    truth, state, now, data = sample.truth, sample.truth.state, sample.truth.condition, sample.truth.condition.air_data
    velocity_n = rotate_back(now.R_bn, state.velocity_b)
    inertial_b = state.rates_b + rotate(now.R_bn, now.earth.earth_rate_n + now.earth.transport_rate_n)
    euler = euler_from_quaternion(state.quaternion)
    _, ground_course = path_angles(velocity_n)
    through_air = polar(velocity_n - now.wind_n, jnp.zeros_like(velocity_n))
    force_b = now.wrench.force_b
    weight = truth.airframe.mass_properties.mass * now.earth.gravity
    controls = sample.controls
    return {
        **_point("", state.position_n),
        **_vector("velocity", ("north", "east", "down"), velocity_n),
        **_vector("velocity", ("u", "v", "w"), state.velocity_b),
        "ground_speed": safe_norm(velocity_n),
        "ground_course": ground_course,
        "airspeed": data.V,
        "alpha": data.alpha,
        "beta": data.beta,
        "mach": data.mach,
        "dynamic_pressure": data.qbar,
        **{f"quaternion_{k}": state.quaternion[k] for k in range(4)},
        "roll": euler[0],
        "pitch": euler[1],
        "yaw": euler[2],
        **_rates("", state.rates_b),
        **{f"inertial_{key}": value for key, value in _rates("", inertial_b).items()},
        "bank": bank_about_velocity(now.R_bn, data.alpha, data.beta),
        "path_angle": through_air.gamma,
        "course": through_air.chi,
        "load_factor": -force_b[2] / weight,
        **dict(zip(_surface_keys(truth.airframe), (*state.surfaces, *controls.surfaces), strict=True)),
        "throttle": controls.throttle,
        "power": state.power,
        "thrust": now.propulsive.force_b[0],
        "airspeed_command": sample.command.V,
        "path_angle_command": sample.command.gamma,
        "course_command": sample.command.chi,
        **{key: jnp.full_like(data.V, jnp.nan) for key in _TOLD_BY_CONTROLLER},
        **{key: jnp.asarray(False) for key in _FLAGGED_BY_CONTROLLER},
        **signal_variables(sample.signals),
        "outside_tables": truth.airframe.outside_tables(data),
        "status": sample.status,
        **({} if sample.approach is None else _of_approach(sample, sample.approach)),
        **({} if sample.flow is None else _of_gusts(truth.disturbance.gust, sample.flow)),
        **({} if sample.belief.uncertainty is None else _of_knowledge(sample.belief, sample.belief.uncertainty)),
        **(
            {}
            if sample.approach is None or sample.approach.plan.network is None
            else _of_network(sample.approach.plan.network)
        ),
    }


def _of_gusts(gust: Gust, flow: AirFlow) -> dict[str, Array]:
    turning = {f"gust_{key}": value for key, value in _rates("", gust.rates_b).items()}
    return {"airspeed_mean_wind": flow.airspeed, **_vector("gust", ("u", "v", "w"), gust.velocity_b), **turning}


def _of_network(view: NetworkView) -> dict[str, Array]:
    weights = 2 ** np.arange(view.hears.shape[0])
    return {
        "clock_lag": view.lag,
        "clock_rate": view.rate,
        "heard_from": jnp.sum(jnp.where(view.hears, weights, 0)).astype(jnp.int32),
        "path_offered": view.offers,
    }


def _of_knowledge(belief: Belief, known: Uncertainty) -> dict[str, Array]:
    own, goal = (
        safe_sqrt(jnp.stack([matrix[k, k] for k in range(3)]))
        for matrix in (known.position_covariance, known.goal_covariance)
    )
    axes, level = ("north", "east", "altitude"), goal[0] * goal[1]
    return {
        **_point("own_estimate_", belief.state.position_n),
        **{f"own_sigma_{axis}": own[k] for k, axis in enumerate(axes)},
        **{f"goal_sigma_{axis}": goal[k] for k, axis in enumerate(axes)},
        "goal_correlation": known.goal_covariance[0, 1] / jnp.where(level > 0.0, level, 1.0),
        "goal_sigma_speed": safe_sqrt(known.goal_covariance[3, 3] + known.goal_covariance[4, 4]),
        "goal_nis": known.nis,
        "goal_seen": known.goal_is_measured,
        "goal_known": known.goal_status,
    }


def _of_approach(sample: "AircraftSample", approach: "GoalApproach") -> dict[str, Array]:
    goal, seen, sight, reference_n = approach.goal, sample.belief.goal, sample.belief.sight, sample.reference_n
    assert seen is not None
    assert sight is not None
    assert reference_n is not None
    plan, axes = approach.plan, ("north", "east", "down")
    return {
        **_point("reference_", reference_n),
        "position_error": safe_norm(reference_n - sample.truth.state.position_n),
        **_point("goal_", goal.position_n),
        **_point("goal_estimate_", seen.position_n),
        **_vector("goal_velocity", axes, goal.velocity_n),
        **_vector("goal_estimate_velocity", axes, seen.velocity_n),
        **_point("rendezvous_", approach.rendezvous_n),
        "range_to_rendezvous": safe_norm(approach.to_rendezvous_n),
        "clearance": safe_norm(approach.to_goal_n),
        "sight_range": sight.range,
        "sight_azimuth": sight.azimuth,
        "sight_elevation": sight.elevation,
        "sight_range_rate": sight.range_rate,
        "sight_azimuth_rate": sight.azimuth_rate,
        "sight_elevation_rate": sight.elevation_rate,
        "arrival_time": jnp.asarray(plan.arrival_time),
        "planned_length": jnp.asarray(plan.length),
        "lateral_bend": jnp.asarray(plan.lateral_bend),
        "phase": approach.phase,
        "renewal": plan.replanning,
    }


def _point(prefix: str, position_n: Vector3) -> dict[str, Array]:
    return {
        f"{prefix}north": position_n[0],
        f"{prefix}east": position_n[1],
        f"{prefix}altitude": -position_n[2],
    }


def _vector(prefix: str, names: tuple[str, str, str], vector: Vector3) -> dict[str, Array]:
    return {f"{prefix}_{name}": vector[k] for k, name in enumerate(names)}


def _rates(suffix: str, rates_b: Vector3) -> dict[str, Array]:
    return {f"{name}_rate{suffix}": rates_b[k] for k, name in enumerate(("roll", "pitch", "yaw"))}


def _surface_keys(airframe: AbstractAirframe) -> list[str]:
    """Keys of positions, then of commands."""
    return [variable.key for variable in surface_variables(airframe.actuators.names)]


class GoalApproach(eqx.Module):
    """Where one aircraft is on its way to its goal at one instant.

    Attributes
    ----------
    goal
        The truth.
    rendezvous_n
        Where it is to be, NED, m.
    to_goal_n, to_rendezvous_n
        Straight lines through space from the aircraft, m.
    clearance
        Between it and the ground.
    plan
        Its own.
    phase
        One of `APPROACH`, `FROZEN`, `HOLD`.
    """

    goal: GoalState
    rendezvous_n: Vector3
    to_goal_n: Vector3
    to_rendezvous_n: Vector3
    clearance: GroundClearance
    plan: AircraftPlan
    phase: Count


class AircraftSample(eqx.Module):
    """All signals of one aircraft at one sampling instant.

    Attributes
    ----------
    truth, belief
        True and estimated state.
    controls, signals
        Outputs and signals of its controller.
    command, reference_n
        What it was commanded, and where it is to be (NED, m).
    approach
        None for an aircraft without a mission.
    status
        Index into `STATUS_MESSAGES`.
    """

    truth: Truth
    belief: Belief
    controls: Controls
    signals: Any
    command: Any
    reference_n: Vector3 | None
    approach: GoalApproach | None
    status: Count
    flow: AirFlow | None = None


class FleetSample(eqx.Module):
    """Samples of a fleet by kinds of aircraft, with a leading axis over members; and their places in the fleet."""

    groups: tuple[AircraftSample, ...]
    members: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    def rows(self, of_one: Callable[[AircraftSample], dict[str, Array]]) -> dict[str, Array]:
        """What a function gives of each aircraft, in the fleet's order.

        Of several kinds of aircraft it is what all of them give, and the control surfaces of any: NaN of an aircraft
        that has no such surface.
        """
        found = [jax.vmap(of_one)(samples) for samples in self.groups]
        surfaces = all_surface_names(samples.truth.airframe.actuators.names for samples in self.groups)
        of_some = {variable.key for variable in surface_variables(surfaces)}
        keys = dict.fromkeys(key for one in found for key in one)
        kept = [key for key in keys if key in of_some or all(key in one for one in found)]
        like = {key: one[key] for one in found for key in one}
        rows = [
            {key: one[key] if key in one else jnp.full(len(places), jnp.nan, like[key].dtype) for key in kept}
            for one, places in zip(found, self.members, strict=True)
        ]
        return to_fleet_order(rows, self.members)


class AbstractRecorder(eqx.Module):
    """What is kept of a flight; concrete ones are final.

    What it sees is the `AircraftSample` of one aircraft flown alone, or the `FleetSample` of a fleet.

    Attributes
    ----------
    every
        Number of samples between two rows.
    """

    stride: eqx.AbstractVar[int]

    @abc.abstractmethod
    def init(self, aircraft: int) -> Any:
        """Memory before the first sample, of so many aircraft."""

    @abc.abstractmethod
    def update(self, recorder_state: Any, sample: Any, instant: Instant) -> Any:
        """Memory with one more sample."""

    @abc.abstractmethod
    def output(self, sample: Any, instant: Instant) -> Any:
        """What is kept of one sample, as arrays; None: nothing."""


class History(AbstractRecorder):
    """Variables of a fleet over time.

    Attributes
    ----------
    every
        Number of samples between two rows.
    keys
        Of `anser.variables.catalogue`; None: all that are recorded.
    """

    stride: int = eqx.field(static=True, default=1)
    keys: tuple[str, ...] | None = eqx.field(static=True, default=None)

    def init(self, aircraft: int) -> None:
        """Nothing is kept."""

    def update(self, recorder_state: None, sample: Any, instant: Instant) -> None:
        """Nothing is kept."""

    def output(self, sample: FleetSample, instant: Instant) -> dict[str, Array]:
        """Each variable of each aircraft, SI units and radians.

        Raises
        ------
        ValueError
            No such variable is recorded.
        """
        found = sample.rows(record)
        if self.keys is None:
            return found
        unknown = [key for key in self.keys if key not in found]
        if unknown:
            raise ValueError(f"not recorded: {', '.join(unknown)}; what is: {', '.join(found)}")
        return {key: found[key] for key in self.keys}


def scan_steps(
    one: Callable[[Any, Count], tuple[Any, Any, Instant]],
    state: Any,
    since: Count,
    count: int,
    recorder: AbstractRecorder,
    recorder_state: Any,
    flown: Count | None = None,
) -> tuple[Any, Any, Any]:
    """Run steps and keep what the recorder wants.

    Parameters
    ----------
    one
        One step: from state and number of the sample to the state after it, what is known at it, and the instant.
    state
        Before the first step.
    since
        Number of the first sample, not batched.
    count
        Number of steps; a multiple of what lies between two rows.
    recorder, recorder_state
        What is kept, and what has been so far.
    flown
        How many of the steps are run, where that is known only when it runs and each has a row; None: all.

    Returns
    -------
    State after the last step, the recorder's memory, and its rows, stacked: of samples `since`, `since + every`, ...

    Raises
    ------
    ValueError
        Rows do not fill the steps.
    """
    every = recorder.stride
    if every < 1 or count % every:
        raise ValueError(f"a row every {every} samples does not fit a flight of {count} samples")

    def step(carry: tuple[Any, Any], number: Count) -> tuple[tuple[Any, Any], Any]:
        state, recorder_state = carry
        after, sample, instant = one(state, number)
        return (after, recorder.update(recorder_state, sample, instant)), recorder.output(sample, instant)

    if flown is not None:
        if every != 1:
            raise ValueError(f"a row every {every} samples does not fit a number of steps that is not known")
        empty = zeros_like_result(lambda c, n: step(c, n)[1], (state, recorder_state), since)

        def some(carry: tuple[Any, Any], k: Count) -> tuple[tuple[Any, Any], Any]:
            return jax.lax.cond(k < flown, lambda: step(carry, since + k), lambda: (carry, empty))

        (state, recorder_state), rows = jax.lax.scan(
            some, (state, recorder_state), jnp.arange(count, dtype=since.dtype)
        )
        return state, recorder_state, rows

    if every == 1:
        (state, recorder_state), rows = jax.lax.scan(
            step, (state, recorder_state), since + jnp.arange(count, dtype=since.dtype)
        )
        return state, recorder_state, rows

    def sparse(carry: tuple[Any, Any, Any], k: Count) -> tuple[tuple[Any, Any, Any], None]:
        state, recorder_state, number = carry[0], carry[1], carry[2][0]
        after, sample, instant = one(state, number)
        row = jax.lax.cond(k == 0, lambda: recorder.output(sample, instant), lambda: carry[2][1])
        return (after, recorder.update(recorder_state, sample, instant), (number + 1, row)), None

    empty = zeros_like_result(lambda c, n: step(c, n)[1], (state, recorder_state), since)

    def block(carry: tuple[Any, Any, Count], _: None) -> tuple[tuple[Any, Any, Count], Any]:
        state, recorder_state, number = carry
        begun = (state, recorder_state, (number, empty))
        (state, recorder_state, (number, row)), _ = jax.lax.scan(sparse, begun, jnp.arange(every))
        return (state, recorder_state, number), row

    (state, recorder_state, _), rows = jax.lax.scan(block, (state, recorder_state, since), length=count // every)
    return state, recorder_state, rows
