"""The autopilot: three nested loops of nonlinear dynamic inversion (theory section 5.

[TH]), as functions and as a controller of the closed loop, with programmed test inputs. Each loop can be commanded
by itself: `rate_control` alone, `attitude_control` on top of it, `velocity_control` on top of both. All are sampled
once per step; their commands are held over it.
"""

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
from anser.parts.paths import PathCommand
from anser.shapes import Flag, Scalar, Vector, Vector3


class Excitation(eqx.Module):
    """Programmed test input: what is added to the commands that the outer loops pass inwards.

    Flight tests excite a loop in this way to measure its margins; so does the analysis of margins here.

    Attributes
    ----------
    attitude
        Added to the wanted (mu, alpha, beta), rad.
    rates_b
        Added to the wanted (P, Q, R), rad/s.
    """

    attitude: Vector3
    rates_b: Vector3


_YAW = np.array([0.0, 0.0, 1.0])
_REACH_MAX = 1.5  # the sampled loop of the surfaces keeps its pole above -0.5


class AutopilotSignals(eqx.Module):
    """What one autopilot step decided, for the record.

    Attributes
    ----------
    motion
        Path and attitude angles as measured.
    thrust
        Throttle and thrust wanted.
    attitude
        (mu, alpha, beta) wanted.
    rates_b
        (P, Q, R) wanted, rad/s.
    surfaces
        Deflections wanted, within the stops, rad.
    speed_limited
        Whether the airspeed that was asked for lies beyond the limits.
    rates_limited, surfaces_limited
        Whether a body rate is held at its limit, and whether a surface is wanted beyond its stop.
    """

    motion: PathMotion
    thrust: ThrustDemand
    attitude: AttitudeDemand
    rates_b: Vector3
    surfaces: Vector
    speed_limited: Flag
    rates_limited: Flag
    surfaces_limited: Flag

    def variables(self) -> dict[str, Array]:
        """For the record, keyed as in `anser.variables.CATALOGUE`."""
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
    rates_command_dot: Vector3,
) -> tuple[SurfaceDemand, AutopilotState]:
    """Fast loop: surfaces for wanted body rates (rad/s) and their rates of change (rad/s^2).

    The demand's surfaces are commands to the actuators: their lag is inverted too, up to `actuator_bandwidth`.
    """
    mass_properties, rates_b = model.airframe.mass_properties, model.state.rates_b
    error = limit_to_braking(gains.rates, rates_command - rates_b, model.authority.rates_jerk)
    measured_dot = angular_acceleration(mass_properties, rates_b, model.condition.wrench.moment_b)
    nu = virtual_control(gains.rates, error, controller_state.rates_integral, rates_command_dot, measured_dot)
    if not model.airframe.actuators.controls_yaw:
        nu = nu.at[2].set(measured_dot[2])  # the fin has it
    moment_b = moment_for_acceleration(mass_properties, rates_b, nu - model.residual.acceleration_b)
    demand = allocate(model.airframe, model.condition, rates_b, model.moments, moment_b)
    actuators, surfaces = model.airframe.actuators, model.state.surfaces
    wanted = demand.surfaces
    share = _sampled_share(model, gains)
    command_bandwidth = share * gains.surfaces_command_bandwidth
    wanted_dot = controller_state.surfaces_filter.rate(wanted, command_bandwidth, model.step)
    rate = wanted_dot + share * gains.actuator_bandwidth * (wanted - surfaces)
    surfaces_filter = controller_state.surfaces_filter.advance(wanted, command_bandwidth, model.step)
    demand = SurfaceDemand(actuators.command_for_rate(surfaces, rate), demand.saturated)
    integral = advance_integral(controller_state.rates_integral, error, jnp.any(demand.saturated), model.step)
    fade = 1 - jnp.exp(-gains.surface_bandwidth * model.step)
    surfaces_slow = model.surfaces_slow + fade * (model.state.surfaces - model.surfaces_slow)
    return demand, eqx.tree_at(
        lambda m: (m.rates_integral, m.surfaces_filter, m.surfaces_slow, m.residual),
        controller_state,
        (integral, surfaces_filter, surfaces_slow, model.residual),
    )


def _sampled_share(model: OnboardModel, gains: AutopilotGains) -> Scalar:
    """Share of the bandwidths of the surfaces that the sampling period bears; 1 for short periods.

    The derivative gain K_D makes the wanted deflection depend on the present one with slope -K_D. With the wanted rate
    N (wanted - x) + B (wanted - present) held over a period, a lag tau moves the surface by tau (1 - exp(-step/tau))
    times that rate: the sampled loop's pole is 1 - tau (1 - exp(-step/tau)) (K_D N + (1 + K_D) B), which must not come
    near -1 (a limit cycle at the rate limit).
    """
    lag = model.airframe.actuators.time_constant[np.flatnonzero(model.airframe.actuators.is_commanded)]
    derivative = jnp.max(jnp.abs(gains.rates.derivative))
    bandwidth = derivative * gains.surfaces_command_bandwidth + (1 + derivative) * gains.actuator_bandwidth
    reach = jnp.max(lag * (1 - jnp.exp(-model.step / lag))) * bandwidth
    return _REACH_MAX / jnp.maximum(reach, _REACH_MAX)


def attitude_control(
    model: OnboardModel,
    gains: AutopilotGains,
    controller_state: AutopilotState,
    attitude_command: Vector3,
    attitude_command_dot: Vector3,
    added_rates_b: Vector3 | None = None,
) -> tuple[Vector3, SurfaceDemand, AutopilotState]:
    """Slow loop on top of the fast one: wanted (mu, alpha, beta), rad, and their rates to body rates to surfaces.

    `added_rates_b` (rad/s) excites the fast loop; the rates that are returned are those wanted without it.
    """
    motion = model.motion
    measured = jnp.stack([motion.mu, motion.alpha, motion.beta])
    acceleration = model.authority.attitude_acceleration(motion.effectiveness)
    error = limit_to_braking(gains.attitude, wrap_angle(attitude_command - measured), acceleration)
    measured_dot = motion.drift + jnp.sum(motion.effectiveness * model.state.rates_b[None, :], axis=1)
    nu = virtual_control(gains.attitude, error, controller_state.attitude_integral, attitude_command_dot, measured_dot)
    effectiveness, asked = motion.effectiveness, nu - motion.drift
    if not model.airframe.actuators.controls_yaw:
        # The fin rules the sideslip: the yaw rate is what it is, and bank and angle of attack make do with it.
        effectiveness, asked = (
            effectiveness.at[2].set(_YAW.astype(asked.dtype)),
            asked.at[2].set(model.state.rates_b[2]),
        )
    free = solve3(effectiveness, asked)
    # Scaled together: a roll rate that is cut while its yaw rate is not would be a sideslip.
    rates_command = free / jnp.maximum(jnp.max(jnp.abs(free) / model.limits.rates_max), 1.0)
    integral = advance_integral(controller_state.attitude_integral, error, rates_command != free, model.step)
    passed = rates_command if added_rates_b is None else rates_command + added_rates_b
    rates_dot = controller_state.rates_filter.limited_rate(
        passed, gains.rates_command_bandwidth, model.step, model.authority.rates_jerk
    )
    demand, controller_state = rate_control(model, gains, controller_state, passed, rates_dot)
    rates_filter = controller_state.rates_filter.advance(passed, gains.rates_command_bandwidth, model.step)
    controller_state = eqx.tree_at(
        lambda m: (m.attitude_integral, m.rates_filter), controller_state, (integral, rates_filter)
    )
    return rates_command, demand, controller_state


def velocity_control(
    model: OnboardModel,
    gains: AutopilotGains,
    controller_state: AutopilotState,
    wanted: PathCommand,
    excitation: Excitation | None = None,
) -> tuple[Controls, AutopilotSignals, AutopilotState]:
    """Whole autopilot: wanted airspeed, path angle and course through the air, with rates, to surfaces and throttle.

    The signals are the commands before `excitation` is added.
    """
    none = jnp.zeros_like(controller_state.velocity_integral)
    added = Excitation(none, none) if excitation is None else excitation
    motion, limits = model.motion, model.limits
    V_wanted = jnp.clip(wanted.V, limits.speed_min, limits.speed_max)
    error = jnp.stack([V_wanted - motion.V, wanted.gamma - motion.gamma, wrap_angle(wanted.chi - motion.chi)])
    wanted_dot = jnp.stack([wanted.V_dot, wanted.gamma_dot, wanted.chi_dot])
    nu = virtual_control(gains.velocity, error, controller_state.velocity_integral, wanted_dot, motion.path_rates)
    thrust = thrust_demand(model, gains.engine_bandwidth, nu[0])
    free = attitude_demand(model, nu[1], nu[2])
    attitude, bank_command = limit_bank_rate(free, controller_state.bank_command, limits, model.step)
    saturated = jnp.stack([thrust.saturated, attitude.alpha_saturated, attitude.bank_saturated])
    integral = advance_integral(controller_state.velocity_integral, error, saturated, model.step)
    passed = attitude.angles + added.attitude
    acceleration = model.authority.attitude_acceleration(motion.effectiveness)
    attitude_dot = controller_state.attitude_filter.limited_rate(
        passed, gains.attitude_command_bandwidth, model.step, acceleration
    )
    rates_command, demand, controller_state = attitude_control(
        model, gains, controller_state, passed, attitude_dot, added.rates_b
    )
    attitude_filter = controller_state.attitude_filter.advance(passed, gains.attitude_command_bandwidth, model.step)
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
        speed_limited=V_wanted != wanted.V,
        rates_limited=jnp.any(jnp.abs(rates_command) >= (1 - 1e-9) * limits.rates_max),
        surfaces_limited=jnp.any(demand.saturated),
    )
    return Controls(surfaces=demand.surfaces, throttle=thrust.throttle), signals, controller_state
