"""What is recorded of every aircraft at every step, keyed as in the catalogue of variables."""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.aircraft import AbstractAirframe
from anser.control import signal_variables
from anser.environment import AirFlow, Gust
from anser.planning import NetworkView, polar
from anser.planning.vectors import root
from anser.sensing import Belief, Uncertainty
from anser.shapes import Vector3
from anser.spatial import bank_about_velocity, euler_from_quaternion, path_angles, rotate, rotate_back, safe_norm
from anser.variables import surface_variables

if TYPE_CHECKING:
    from anser.simulation.recorder import AircraftSample, GoalApproach

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
    truth, state, now, data = sample.truth, sample.truth.state, sample.truth.now, sample.truth.now.air_data
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
        root(jnp.stack([matrix[k, k] for k in range(3)])) for matrix in (known.own_covariance, known.goal_covariance)
    )
    axes, level = ("north", "east", "altitude"), goal[0] * goal[1]
    return {
        **_point("own_estimate_", belief.state.position_n),
        **{f"own_sigma_{axis}": own[k] for k, axis in enumerate(axes)},
        **{f"goal_sigma_{axis}": goal[k] for k, axis in enumerate(axes)},
        "goal_correlation": known.goal_covariance[0, 1] / jnp.where(level > 0.0, level, 1.0),
        "goal_sigma_speed": root(known.goal_covariance[3, 3] + known.goal_covariance[4, 4]),
        "goal_nis": known.nis,
        "goal_seen": known.seen,
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
        "renewal": plan.renewal,
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
