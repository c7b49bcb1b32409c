"""The autopilot: three nested loops of nonlinear dynamic inversion (theory section 5, [TH]).

The loops are functions: `rate_control` is the fast loop, `attitude_control` closes the attitude loop around the rate
loop, and `velocity_control` closes the velocity loop around both. The command to each loop can contain a test input.
The loops are sampled once per step; commands are constant over the step.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from anser.aircraft.airframe import Controls
from anser.aircraft.motion import angular_acceleration, moment_for_acceleration
from anser.control.allocation import SurfaceDemand, allocate
from anser.control.autopilot_state import AutopilotState
from anser.control.feedback import advance_integral, limit_to_braking, virtual_control, wrap_angle
from anser.control.gains import AutopilotGains
from anser.control.onboard_model import OnboardModel, PathMotion
from anser.control.velocity_loop import AttitudeDemand, ThrustDemand, attitude_demand, limit_bank_rate, thrust_demand
from anser.numerics.linear import solve3
from anser.parts.paths import LoopExcitation, PathCommand
from anser.shapes import Flag, Scalar, Vector, Vector3

_YAW = np.array([0.0, 0.0, 1.0])
_SAMPLED_GAIN_MAX = 1.5  # keeps the pole of the sampled surface loop above -0.5


class AutopilotSignals(eqx.Module):
    """Signals of one sample of the autopilot, for recording."""

    motion: PathMotion  # measured path and attitude angles
    thrust: ThrustDemand  # commanded throttle (0..1) and thrust (N)
    attitude: AttitudeDemand  # commanded (mu, alpha, beta), rad
    rates_b: Vector3  # commanded (P, Q, R), rad/s
    surfaces: Vector  # commands to the actuators, within the stops, rad
    speed_limited: Flag  # whether the commanded airspeed is outside the limits
    rates_limited: Flag  # whether a commanded body rate is at its limit
    surfaces_limited: Flag  # whether the demanded moment needs a deflection beyond a stop

    def variables(self) -> dict[str, Array]:
        """Return the recorded variables by their keys in `anser.variables.CATALOGUE`; SI units and radians."""
        attitude = self.attitude
        return {
            "thrust_command": self.thrust.thrust,
            **dict(zip(("bank_command", "alpha_command", "beta_command"), attitude.angles, strict=True)),
            **dict(zip(("roll_rate_command", "pitch_rate_command", "yaw_rate_command"), self.rates_b, strict=True)),
            "thrust_limited": self.thrust.saturated,
            "lift_limited": attitude.alpha_saturated | attitude.lift_short | attitude.load_factor_short,
            "bank_limited": attitude.bank_saturated,
            "speed_limited": self.speed_limited,
            "rates_limited": self.rates_limited,
            "surfaces_limited": self.surfaces_limited,
        }


def rate_control(
    model: OnboardModel,
    gains: AutopilotGains,
    controller_state: AutopilotState,
    rates_command: Vector3,
    rates_command_dot: Vector3,  # derivative of the command, rad/s^2
) -> tuple[SurfaceDemand, AutopilotState]:
    """Close the fast loop: compute actuator commands (rad) for commanded body rates (P, Q, R), rad/s, and derivatives.

    Returns the commands with saturation flags, and the new state of the autopilot. The actuators' lag is inverted up to
    `gains.actuator_bandwidth`, or less if the sampling period is long. If no surface controls yaw, the yaw rate is not
    controlled.
    """
    mass_properties, rates_b = model.airframe.mass_properties, model.state.rates_b
    error = limit_to_braking(gains.rates, rates_command - rates_b, model.authority.rates_jerk)
    measured_dot = angular_acceleration(mass_properties, rates_b, model.condition.wrench.moment_b)
    nu = virtual_control(gains.rates, error, controller_state.rates_integral, rates_command_dot, measured_dot)
    if not model.airframe.actuators.controls_yaw:
        nu = nu.at[2].set(measured_dot[2])  # without yaw control, the fin determines the yaw rate
    moment_b = moment_for_acceleration(mass_properties, rates_b, nu - model.residual.acceleration_b)
    demand = allocate(model.airframe, model.condition, rates_b, model.moments, moment_b)
    actuators, surfaces = model.airframe.actuators, model.state.surfaces
    target = demand.surfaces
    factor = _bandwidth_factor(model, gains)
    command_bandwidth = factor * gains.surfaces_command_bandwidth
    target_dot = controller_state.surfaces_filter.rate(target, command_bandwidth, model.step)
    rate = target_dot + factor * gains.actuator_bandwidth * (target - surfaces)
    if actuators.is_held:
        # A surface that jumps along leads its target by half a period on average; this makes it lag so much at samples.
        derivative = jnp.max(jnp.abs(gains.rates.derivative))
        rate = rate / (1 + 0.5 * (1 + derivative) * factor * gains.actuator_bandwidth * model.step)
    surfaces_filter = controller_state.surfaces_filter.advance(target, command_bandwidth, model.step)
    demand = SurfaceDemand(actuators.command_for_rate(surfaces, rate), demand.saturated)
    integral = advance_integral(controller_state.rates_integral, error, jnp.any(demand.saturated), model.step)
    filter_coefficient = 1 - jnp.exp(-gains.surface_bandwidth * model.step)
    surfaces_slow = model.surfaces_slow + filter_coefficient * (model.state.surfaces - model.surfaces_slow)
    return demand, eqx.tree_at(
        lambda m: (m.rates_integral, m.surfaces_filter, m.surfaces_slow, m.residual),
        controller_state,
        (integral, surfaces_filter, surfaces_slow, model.residual),
    )


def _bandwidth_factor(model: OnboardModel, gains: AutopilotGains) -> Scalar:
    """Return the factor (0..1) by which a long sampling period reduces the bandwidths of actuators and filter."""
    # The commanded rate N (target - x) + B (target - present) is constant over a period. N and x are the bandwidth and
    # the state of the filter on deflections; B is the bandwidth of the actuators. In a period, a surface moves by T
    # (`travel_per_rate`) times the rate. Because of the derivative gain K_D, the target has the slope -K_D over the
    # present deflection. The sampled loop has the pole 1 - T (K_D N + (1 + K_D) B); near -1, it has a limit cycle.
    actuators = model.airframe.actuators
    travel = actuators.travel_per_rate(model.step)[np.flatnonzero(actuators.is_commanded)]
    derivative = jnp.max(jnp.abs(gains.rates.derivative))
    bandwidth = derivative * gains.surfaces_command_bandwidth + (1 + derivative) * gains.actuator_bandwidth
    sampled_gain = jnp.max(travel) * bandwidth
    return _SAMPLED_GAIN_MAX / jnp.maximum(sampled_gain, _SAMPLED_GAIN_MAX)


def attitude_control(
    model: OnboardModel,
    gains: AutopilotGains,
    controller_state: AutopilotState,
    attitude_command: Vector3,
    attitude_command_dot: Vector3,  # derivative of the command, rad/s
    added_rates_b: Vector3 | None = None,  # test input that is added to the command of the rate loop, rad/s
) -> tuple[Vector3, SurfaceDemand, AutopilotState]:
    """Close attitude and rate loops: compute commands of body rates and surfaces for commanded (mu, alpha, beta), rad.

    Returns the commanded body rates (rad/s), the surface commands (rad) with saturation flags, and the new state of the
    autopilot. The returned body rates are limited, and do not contain `added_rates_b`.
    """
    motion = model.motion
    measured = jnp.stack([motion.mu, motion.alpha, motion.beta])
    acceleration = model.authority.attitude_acceleration(motion.rate_matrix)
    error = limit_to_braking(gains.attitude, wrap_angle(attitude_command - measured), acceleration)
    measured_dot = motion.force_rates + jnp.sum(motion.rate_matrix * model.state.rates_b[None, :], axis=1)
    nu = virtual_control(gains.attitude, error, controller_state.attitude_integral, attitude_command_dot, measured_dot)
    rate_matrix, target_rates = motion.rate_matrix, nu - motion.force_rates
    if not model.airframe.actuators.controls_yaw:
        # The fin determines the sideslip: bank and angle of attack are solved for the present yaw rate.
        rate_matrix = rate_matrix.at[2].set(_YAW.astype(target_rates.dtype))
        target_rates = target_rates.at[2].set(model.state.rates_b[2])
    unlimited_rates = solve3(rate_matrix, target_rates)
    # One common factor: limiting the roll rate without the coordinated yaw rate would cause sideslip.
    rates_command = unlimited_rates / jnp.maximum(jnp.max(jnp.abs(unlimited_rates) / model.limits.rates_max), 1.0)
    integral = advance_integral(controller_state.attitude_integral, error, rates_command != unlimited_rates, model.step)
    excited_rates = rates_command if added_rates_b is None else rates_command + added_rates_b
    rates_dot = controller_state.rates_filter.limited_rate(
        excited_rates, gains.rates_command_bandwidth, model.step, model.authority.rates_jerk
    )
    demand, controller_state = rate_control(model, gains, controller_state, excited_rates, rates_dot)
    rates_filter = controller_state.rates_filter.advance(excited_rates, gains.rates_command_bandwidth, model.step)
    controller_state = dataclasses.replace(controller_state, attitude_integral=integral, rates_filter=rates_filter)
    return rates_command, demand, controller_state


def rates_at_limit(rates_command: Vector3, rates_max: Vector3) -> Flag:
    """Whether a commanded body rate is at its limit, within rounding; all rates in rad/s."""
    rounding = 4.0 * float(jnp.finfo(rates_command.dtype).eps)
    return jnp.any(jnp.abs(rates_command) >= (1.0 - rounding) * rates_max)


def velocity_control(
    model: OnboardModel,
    gains: AutopilotGains,
    controller_state: AutopilotState,
    path_command: PathCommand,
) -> tuple[Controls, AutopilotSignals, AutopilotState]:
    """Close all three loops: compute surfaces and throttle for commanded airspeed, path angle and course in the air.

    Returns the controls, the signals to record, and the new state of the autopilot. The commanded airspeed is limited
    to the flight limits. The recorded commands are the values before the test inputs `path_command.excitation` are
    added.
    """
    zero = jnp.zeros_like(controller_state.velocity_integral)
    added = LoopExcitation(zero, zero) if path_command.excitation is None else path_command.excitation
    motion, limits = model.motion, model.limits
    V_command = jnp.clip(path_command.V, limits.speed_min, limits.speed_max)
    # At the end of the range of airspeeds, the command does not go on as it would outside.
    is_beyond = (path_command.V - V_command) * path_command.V_dot > 0.0
    V_dot = jnp.where(is_beyond, 0.0, path_command.V_dot)
    error = jnp.stack(
        [V_command - motion.V, path_command.gamma - motion.gamma, wrap_angle(path_command.chi - motion.chi)]
    )
    path_command_dot = jnp.stack([V_dot, path_command.gamma_dot, path_command.chi_dot])
    nu = virtual_control(gains.velocity, error, controller_state.velocity_integral, path_command_dot, motion.path_rates)
    thrust = thrust_demand(model, gains.engine_bandwidth, nu[0])
    unlimited_attitude = attitude_demand(model, nu[1], nu[2])
    attitude, bank_command = limit_bank_rate(unlimited_attitude, controller_state.bank_command, limits, model.step)
    saturated = jnp.stack([thrust.saturated, attitude.alpha_saturated, attitude.bank_saturated])
    integral = advance_integral(controller_state.velocity_integral, error, saturated, model.step)
    excited_attitude = attitude.angles + added.attitude
    acceleration = model.authority.attitude_acceleration(motion.rate_matrix)
    attitude_dot = controller_state.attitude_filter.limited_rate(
        excited_attitude, gains.attitude_command_bandwidth, model.step, acceleration
    )
    rates_command, demand, controller_state = attitude_control(
        model, gains, controller_state, excited_attitude, attitude_dot, added.rates_b
    )
    attitude_filter = controller_state.attitude_filter.advance(
        excited_attitude, gains.attitude_command_bandwidth, model.step
    )
    controller_state = eqx.tree_at(
        lambda m: (m.velocity_integral, m.attitude_filter), controller_state, (integral, attitude_filter)
    )
    if bank_command is not None:
        controller_state = eqx.tree_at(lambda m: m.bank_command, controller_state, bank_command)
    signals = AutopilotSignals(
        motion=motion,
        thrust=thrust,
        attitude=attitude,
        rates_b=rates_command,
        surfaces=demand.surfaces,
        speed_limited=V_command != path_command.V,
        rates_limited=rates_at_limit(rates_command, limits.rates_max),
        surfaces_limited=jnp.any(demand.saturated),
    )
    return Controls(surfaces=demand.surfaces, throttle=thrust.throttle), signals, controller_state
