"""What is recorded of every aircraft at every step, keyed as in the catalogue of variables."""

import equinox as eqx
from jaxtyping import Array

from anser.aircraft import AbstractAirframe, AircraftState, Condition, Controls
from anser.control import AutopilotSignals
from anser.planning import LineOfSight, PathCommand
from anser.shapes import Count, Scalar, Vector3
from anser.spatial import euler_from_quaternion, path_angles, rotate, rotate_back, safe_norm

APPROACH, FROZEN, HOLD = range(3)


class Moment(eqx.Module):
    """Everything known of one aircraft at one instant."""

    airframe: AbstractAirframe
    state: AircraftState
    now: Condition
    controls: Controls
    signals: AutopilotSignals
    command: PathCommand
    reference_n: Vector3
    sight: LineOfSight
    goal_n: Vector3
    goal_velocity_n: Vector3
    goal_estimate_n: Vector3
    goal_velocity_estimate_n: Vector3
    stand_off_n: Vector3
    to_goal_n: Vector3
    to_rendezvous_n: Vector3
    arrival_time: Scalar
    lateral_bend: Scalar
    planned_length: Scalar
    phase: Count
    renewal: Count
    status: Count


def record(moment: Moment) -> dict[str, Array]:
    """One row of the history of one aircraft, SI units and radians, keyed as in `anser.variables.CATALOGUE`."""
    state, now, data = moment.state, moment.now, moment.now.air_data
    signals, motion = moment.signals, moment.signals.motion
    velocity_n = rotate_back(now.R_bn, state.velocity_b)
    inertial_b = state.rates_b + rotate(now.R_bn, now.earth.earth_rate_n + now.earth.transport_rate_n)
    euler = euler_from_quaternion(state.quaternion)
    _, ground_course = path_angles(velocity_n)
    reference_n = moment.reference_n
    rendezvous_n = moment.goal_n + moment.stand_off_n
    force_b = now.wrench.force_b
    weight = moment.airframe.mass_properties.mass * now.earth.gravity
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
        "bank": motion.mu,
        "path_angle": motion.gamma,
        "course": motion.chi,
        "load_factor": -force_b[2] / weight,
        **_surfaces("", state.surfaces),
        **_surfaces("_command", moment.controls.surfaces),
        "throttle": moment.controls.throttle,
        "power": state.power,
        "thrust": now.propulsive.force_b[0],
        "thrust_command": signals.thrust.thrust,
        "airspeed_command": moment.command.V,
        "path_angle_command": moment.command.gamma,
        "course_command": moment.command.chi,
        "bank_command": signals.attitude.angles[0],
        "alpha_command": signals.attitude.angles[1],
        "beta_command": signals.attitude.angles[2],
        **_rates("_command", signals.rates_b),
        **_point("reference_", reference_n),
        "position_error": safe_norm(reference_n - state.position_n),
        **_point("goal_", moment.goal_n),
        **_point("goal_estimate_", moment.goal_estimate_n),
        **_vector("goal_velocity", ("north", "east", "down"), moment.goal_velocity_n),
        **_vector("goal_estimate_velocity", ("north", "east", "down"), moment.goal_velocity_estimate_n),
        **_point("rendezvous_", rendezvous_n),
        "range_to_rendezvous": safe_norm(moment.to_rendezvous_n),
        "clearance": safe_norm(moment.to_goal_n),
        "sight_range": moment.sight.range,
        "sight_azimuth": moment.sight.azimuth,
        "sight_elevation": moment.sight.elevation,
        "sight_range_rate": moment.sight.range_rate,
        "sight_azimuth_rate": moment.sight.azimuth_rate,
        "sight_elevation_rate": moment.sight.elevation_rate,
        "arrival_time": moment.arrival_time,
        "planned_length": moment.planned_length,
        "lateral_bend": moment.lateral_bend,
        "phase": moment.phase,
        "renewal": moment.renewal,
        "thrust_limited": signals.thrust.saturated,
        "lift_limited": signals.attitude.alpha_saturated
        | signals.attitude.lift_short
        | signals.attitude.load_factor_short,
        "bank_limited": signals.attitude.bank_saturated,
        "speed_limited": signals.speed_limited,
        "rates_limited": signals.rates_limited,
        "surfaces_limited": signals.surfaces_limited,
        "outside_tables": moment.airframe.outside_tables(data),
        "status": moment.status,
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


def _surfaces(suffix: str, surfaces: Vector3) -> dict[str, Array]:
    return {f"{name}{suffix}": surfaces[k] for k, name in enumerate(("elevator", "aileron", "rudder"))}


__all__ = ["APPROACH", "FROZEN", "HOLD", "Moment", "record"]
