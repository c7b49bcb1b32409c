"""The autopilot: three nested loops of nonlinear dynamic inversion (theory section 5; [TH]).

Each loop can be commanded by itself: `rate_control` alone, `attitude_control` on top of it, `velocity_control` on top
of both. All are sampled once per step; their commands are held over it.
"""

import equinox as eqx
import jax.numpy as jnp

from anser.aircraft import (
    AbstractAirframe,
    AircraftState,
    Condition,
    Controls,
    Wrench,
    angular_acceleration,
    moment_for_acceleration,
)
from anser.control.allocation import SurfaceDemand, allocate
from anser.control.beyond_model import BeyondModel, nothing_beyond
from anser.control.feedback import Differentiator, advanced_integral, virtual_control, wrapped
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.control.path_motion import PathMotion, path_motion
from anser.control.velocity_loop import AttitudeDemand, ThrustDemand, attitude_demand, thrust_demand
from anser.numerics import solve3, times3
from anser.planning import PathCommand
from anser.shapes import Flag, Scalar, ScalarLike, Vector3

_REACH_MAX = 1.5  # the sampled loop of the surfaces keeps its pole above -0.5


class AutopilotState(eqx.Module):
    """Memory of one autopilot: the loops' integrals and the filters that differentiate inner commands.

    Attributes
    ----------
    velocity_integral, attitude_integral, rates_integral
        Time integrals of the errors in (V, gamma, chi), (mu, alpha, beta) and (P, Q, R).
    attitude_filter, rates_filter
        Filters on the commands that the outer loops pass inwards.
    surfaces_filter
        Filter on the deflections that the fast loop wants.
    surfaces_slow
        Deflections through a low-pass filter, rad.
    beyond
        What the sensors say beyond the model.
    """

    velocity_integral: Vector3
    attitude_integral: Vector3
    rates_integral: Vector3
    attitude_filter: Differentiator
    rates_filter: Differentiator
    surfaces_filter: Differentiator
    surfaces_slow: Vector3
    beyond: BeyondModel


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
    rates_limited, surfaces_limited
        Whether a body rate is held at its limit, and whether a surface is wanted beyond its stop.
    """

    motion: PathMotion
    thrust: ThrustDemand
    attitude: AttitudeDemand
    rates_b: Vector3
    surfaces: Vector3
    rates_limited: Flag
    surfaces_limited: Flag


class Plant(eqx.Module):
    """What an autopilot needs of its own aircraft at one instant.

    `airframe` and the forces in `now` and `slow` are what the autopilot believes: the model, with what the sensors say
    beyond it where the inversion is incremental.

    The two outer loops see the forces as they are with `surfaces_slow`, low-passed deflections: the lift of the moving
    elevator, differentiated twice on its way through the feed-forward, would come back to the elevator with a loop gain
    above one (a limit cycle at the rate limit). Neglecting fast surface forces in the slow loops is the two-time-scale
    assumption of dynamic inversion.
    """

    airframe: AbstractAirframe
    limits: FlightLimits
    gains: AutopilotGains
    state: AircraftState
    now: Condition
    slow: Condition
    surfaces_slow: Vector3
    beyond: BeyondModel
    motion: PathMotion
    gravity: ScalarLike
    step: ScalarLike


def make_plant(
    airframe: AbstractAirframe,
    limits: FlightLimits,
    gains: AutopilotGains,
    state: AircraftState,
    now: Condition,
    memory: AutopilotState,
    gravity: ScalarLike,
    step: ScalarLike,
    specific_force_b: Vector3 | None = None,
) -> Plant:
    """Gather what the loops share.

    Parameters
    ----------
    airframe
        The autopilot's model of its aircraft.
    limits, gains, memory
        Of the autopilot.
    state
        As measured.
    now
        Condition of the model.
    gravity
        m/s^2.
    step
        Sampling period, s.
    specific_force_b
        What accelerometers at the centre of gravity read (3,), m/s^2; that of a perfect model where None.
    """
    mass_properties = airframe.mass_properties
    model_force_b = now.wrench.force_b
    measured_b = model_force_b if specific_force_b is None else mass_properties.mass * specific_force_b
    beyond = memory.beyond.advanced(
        measured_b - model_force_b,
        state.rates_b,
        angular_acceleration(mass_properties, state.rates_b, now.wrench.moment_b),
        gains.sensor_bandwidth,
        step,
    )
    beyond_wrench = Wrench(beyond.force_b, times3(mass_properties.inertia_b, beyond.acceleration_b))
    now = eqx.tree_at(lambda c: c.aerodynamic, now, now.aerodynamic + beyond_wrench)
    surfaces_slow = memory.surfaces_slow
    slow_wrench = airframe.aerodynamics(now.air_data, state.rates_b, surfaces_slow) + beyond_wrench
    slow = eqx.tree_at(lambda c: c.aerodynamic, now, slow_wrench)
    motion = path_motion(now, slow.wrench.force_b, state.velocity_b, mass_properties.mass, gravity)
    return Plant(airframe, limits, gains, state, now, slow, surfaces_slow, beyond, motion, gravity, step)


def initial_autopilot_state(attitude: Vector3, rates_b: Vector3, surfaces: Vector3) -> AutopilotState:
    """Memory of an autopilot that has been holding the given (mu, alpha, beta), (P, Q, R) and surfaces."""
    zero = jnp.zeros(3)
    return AutopilotState(
        zero,
        zero,
        zero,
        Differentiator(attitude),
        Differentiator(rates_b),
        Differentiator(surfaces),
        surfaces,
        nothing_beyond(rates_b),
    )


def rate_control(
    plant: Plant, memory: AutopilotState, rates_wanted: Vector3, rates_wanted_dot: Vector3
) -> tuple[SurfaceDemand, AutopilotState]:
    """Fast loop: surfaces for wanted body rates (rad/s) and their rates of change (rad/s^2).

    The demand's surfaces are commands to the actuators: their lag is inverted too, up to `actuator_bandwidth`.
    """
    mass_properties, rates_b = plant.airframe.mass_properties, plant.state.rates_b
    error = rates_wanted - rates_b
    measured_dot = angular_acceleration(mass_properties, rates_b, plant.now.wrench.moment_b)
    nu = virtual_control(plant.gains.rates, error, memory.rates_integral, rates_wanted_dot, measured_dot)
    moment_b = moment_for_acceleration(mass_properties, rates_b, nu - plant.beyond.acceleration_b)
    demand = allocate(plant.airframe, plant.now, rates_b, plant.state.surfaces, moment_b)
    actuators, surfaces = plant.airframe.actuators, plant.state.surfaces
    wanted = actuators.limited(demand.surfaces)
    share = _sampled_share(plant)
    command_bandwidth = share * plant.gains.surfaces_command_bandwidth
    wanted_dot = memory.surfaces_filter.rate(wanted, command_bandwidth, plant.step)
    rate = wanted_dot + share * plant.gains.actuator_bandwidth * (wanted - surfaces)
    surfaces_filter = memory.surfaces_filter.advanced(wanted, command_bandwidth, plant.step)
    demand = SurfaceDemand(actuators.command_for_rate(surfaces, rate), demand.saturated)
    integral = advanced_integral(memory.rates_integral, error, jnp.any(demand.saturated), plant.step)
    fade = 1 - jnp.exp(-plant.gains.surface_bandwidth * plant.step)
    surfaces_slow = plant.surfaces_slow + fade * (plant.state.surfaces - plant.surfaces_slow)
    return demand, eqx.tree_at(
        lambda m: (m.rates_integral, m.surfaces_filter, m.surfaces_slow, m.beyond),
        memory,
        (integral, surfaces_filter, surfaces_slow, plant.beyond),
    )


def _sampled_share(plant: Plant) -> Scalar:
    """Share of the bandwidths of the surfaces that the sampling period bears; 1 for short periods.

    The derivative gain K_D makes the wanted deflection depend on the present one with slope -K_D. With the wanted rate
    N (wanted - x) + B (wanted - present) held over a period, a lag tau moves the surface by tau (1 - exp(-step/tau))
    times that rate: the sampled loop's pole is 1 - tau (1 - exp(-step/tau)) (K_D N + (1 + K_D) B), which must not come
    near -1 (a limit cycle at the rate limit).
    """
    gains, lag = plant.gains, plant.airframe.actuators.time_constant
    derivative = jnp.max(jnp.abs(gains.rates.derivative))
    bandwidth = derivative * gains.surfaces_command_bandwidth + (1 + derivative) * gains.actuator_bandwidth
    reach = jnp.max(lag * (1 - jnp.exp(-plant.step / lag))) * bandwidth
    return _REACH_MAX / jnp.maximum(reach, _REACH_MAX)


def attitude_control(
    plant: Plant, memory: AutopilotState, attitude_wanted: Vector3, attitude_wanted_dot: Vector3
) -> tuple[Vector3, SurfaceDemand, AutopilotState]:
    """Slow loop on top of the fast one: wanted (mu, alpha, beta), rad, and their rates to body rates to surfaces."""
    motion, gains = plant.motion, plant.gains
    measured = jnp.stack([motion.mu, motion.alpha, motion.beta])
    error = wrapped(attitude_wanted - measured)
    measured_dot = motion.drift + jnp.sum(motion.effectiveness * plant.state.rates_b[None, :], axis=1)
    nu = virtual_control(gains.attitude, error, memory.attitude_integral, attitude_wanted_dot, measured_dot)
    free = solve3(motion.effectiveness, nu - motion.drift)
    # Scaled together: a roll rate that is cut while its yaw rate is not would be a sideslip.
    rates_wanted = free / jnp.maximum(jnp.max(jnp.abs(free) / plant.limits.rates_max), 1.0)
    integral = advanced_integral(memory.attitude_integral, error, rates_wanted != free, plant.step)
    rates_dot = memory.rates_filter.rate(rates_wanted, gains.rates_command_bandwidth, plant.step)
    demand, memory = rate_control(plant, memory, rates_wanted, rates_dot)
    rates_filter = memory.rates_filter.advanced(rates_wanted, gains.rates_command_bandwidth, plant.step)
    memory = eqx.tree_at(lambda m: (m.attitude_integral, m.rates_filter), memory, (integral, rates_filter))
    return rates_wanted, demand, memory


def velocity_control(
    plant: Plant, memory: AutopilotState, wanted: PathCommand
) -> tuple[Controls, AutopilotSignals, AutopilotState]:
    """Whole autopilot: wanted airspeed, path angle and course through the air, with rates, to surfaces and throttle."""
    motion, gains, limits = plant.motion, plant.gains, plant.limits
    V_wanted = jnp.clip(wanted.V, limits.speed_min, limits.speed_max)
    error = jnp.stack([V_wanted - motion.V, wanted.gamma - motion.gamma, wrapped(wanted.chi - motion.chi)])
    wanted_dot = jnp.stack([wanted.V_dot, wanted.gamma_dot, wanted.chi_dot])
    nu = virtual_control(gains.velocity, error, memory.velocity_integral, wanted_dot, motion.path_rates)
    thrust = thrust_demand(
        plant.airframe, gains.engine_bandwidth, plant.slow, plant.state.power, motion, nu[0], plant.gravity
    )
    attitude = attitude_demand(
        plant.airframe,
        limits,
        plant.slow,
        plant.state.rates_b,
        plant.surfaces_slow,
        plant.beyond.force_b,
        motion,
        nu[1],
        nu[2],
        plant.gravity,
    )
    saturated = jnp.stack([thrust.saturated, attitude.alpha_saturated, attitude.bank_saturated])
    integral = advanced_integral(memory.velocity_integral, error, saturated, plant.step)
    attitude_dot = memory.attitude_filter.rate(attitude.angles, gains.attitude_command_bandwidth, plant.step)
    rates_wanted, demand, memory = attitude_control(plant, memory, attitude.angles, attitude_dot)
    attitude_filter = memory.attitude_filter.advanced(attitude.angles, gains.attitude_command_bandwidth, plant.step)
    memory = eqx.tree_at(lambda m: (m.velocity_integral, m.attitude_filter), memory, (integral, attitude_filter))
    signals = AutopilotSignals(
        motion=motion,
        thrust=thrust,
        attitude=attitude,
        rates_b=rates_wanted,
        surfaces=demand.surfaces,
        rates_limited=jnp.any(jnp.abs(rates_wanted) >= (1 - 1e-9) * limits.rates_max),
        surfaces_limited=jnp.any(demand.saturated),
    )
    return Controls(surfaces=demand.surfaces, throttle=thrust.throttle), signals, memory
