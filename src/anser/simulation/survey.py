"""One flight of an envelope survey: from a trim point, a step of the path command, summed up while it is flown."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.aircraft import AbstractAirframe, AircraftState, Condition, Controls, condition
from anser.control import (
    AutopilotGains,
    AutopilotSignals,
    AutopilotState,
    FlightLimits,
    Plant,
    make_plant,
    velocity_control,
    wrapped,
)
from anser.environment import Environment
from anser.planning import PathCommand
from anser.shapes import Count, Flag, Scalar, ScalarLike, Vector3
from anser.simulation.flight_summary import FlightSummary, Sample, including, nothing_yet
from anser.simulation.motion import advance
from anser.simulation.response import trimmed_memory
from anser.simulation.trim import TrimPoint, TrimTarget

_END = 0.1
"""Last part of the flight over which the error at the end is taken."""
_COS_UNLOADING = 0.5


def survey_flight(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    trim: TrimPoint,
    target: TrimTarget,
    size: Vector3,
    tolerance: Vector3,
    step: ScalarLike,
    count: int,
) -> FlightSummary:
    """Fly a step of the path command away from steady flight under the velocity loop, and sum it up.

    The command is the steady flight itself, its turn included, plus the step: (V, gamma, chi) jump at time 0 and the
    course goes on turning as before. The memory needed does not grow with the length of the flight.

    Parameters
    ----------
    airframe, environment, gains, limits
        What flies, where and how.
    trim, target
        Steady flight that the step leaves, and what it is a solution of.
    size
        Step of (V, gamma, chi), m/s and rad.
    tolerance
        Error that counts as settled, m/s and rad.
    step
        Sampling period, s.
    count
        Number of periods.
    """
    late_from = round((1.0 - _END) * count)
    start = condition(airframe, environment, 0.0, trim.state)

    def one(carry: tuple, k: Count) -> tuple[tuple, None]:
        state, memory, summary = carry
        time = k * step
        command = PathCommand(
            target.speed + size[0],
            target.path_angle + size[1],
            target.course + target.turn_rate * time + size[2],
            jnp.zeros(()),
            jnp.zeros(()),
            target.turn_rate,
        )
        controls, memory, sample = _controlled(
            airframe, environment, gains, limits, time, state, memory, command, start, step
        )
        after = advance(airframe, environment, time, state, controls, step)
        return (after, memory, including(summary, sample, size, tolerance, step, k >= late_from)), None

    carry = (trim.state, trimmed_memory(trim), nothing_yet())
    (state, _, summary), _ = jax.lax.scan(one, carry, jnp.arange(count))
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(state)]))
    last = (count - 1) * step
    # of the running summary: the sum of the late errors, and the last time outside the tolerance
    return eqx.tree_at(
        lambda s: (s.final_error, s.settling_time, s.finite),
        summary,
        (
            summary.final_error / (count - late_from),
            jnp.where(summary.settling_time >= last, jnp.inf, summary.settling_time),
            finite,
        ),
    )


def _controlled(
    airframe: AbstractAirframe,
    environment: Environment,
    gains: AutopilotGains,
    limits: FlightLimits,
    time: ScalarLike,
    state: AircraftState,
    memory: AutopilotState,
    command: PathCommand,
    start: Condition,
    step: ScalarLike,
) -> tuple[Controls, AutopilotState, Sample]:
    now = condition(airframe, environment, time, state)
    plant = make_plant(airframe, limits, gains, state, now, memory, environment.gravity, step)
    controls, signals, memory = velocity_control(plant, memory, command)
    motion, actuators = plant.motion, airframe.actuators
    wanted = jnp.stack([command.V, command.gamma, command.chi])
    error = wanted - jnp.stack([motion.V, motion.gamma, motion.chi])
    weight = airframe.mass_properties.mass * environment.gravity
    rate_share = jnp.abs(actuators.rate(state.surfaces, controls.surfaces)) / actuators.rate_limit
    sample = Sample(
        time=time,
        error=error.at[2].set(wrapped(error[2])),
        alpha=now.air_data.alpha,
        beta=now.air_data.beta,
        load_factor=-now.wrench.force_b[2] / weight,
        surface_share=surface_share(airframe, state.surfaces),
        surface_rate_share=rate_share,
        body_rate_share=jnp.abs(state.rates_b) / limits.rates_max,
        limited=jnp.append(_limited(plant, signals), jnp.any(rate_share >= 1.0)),
        outside=outside_axes(airframe, now, start),
    )
    return controls, memory, sample


def surface_share(airframe: AbstractAirframe, surfaces: Vector3) -> Vector3:
    """Part of the way from the middle to the stop at which each surface (rad) stands."""
    lower, upper = airframe.actuators.lower, airframe.actuators.upper
    return jnp.abs(2 * surfaces - lower - upper) / (upper - lower)


def outside_axes(airframe: AbstractAirframe, now: Condition, inside: Condition) -> Bool[Array, "4"]:
    """Along which of `TABLE_AXES` a condition lies outside the airframe's data; `inside` is one that lies within.

    The airframe says only whether it is outside: altitude and Mach number are told apart by putting one of them back
    inside.
    """
    data, known = now.air_data, inside.air_data

    def beyond(value: Scalar, ends: tuple[Scalar, Scalar]) -> Flag:
        return (value < ends[0]) | (value > ends[1])

    of_altitude = eqx.tree_at(lambda d: d.altitude, known, data.altitude)
    of_mach = eqx.tree_at(lambda d: d.mach, known, data.mach)
    return jnp.stack(
        [
            beyond(data.alpha, airframe.alpha_range),
            beyond(data.beta, airframe.beta_range),
            airframe.outside_tables(of_altitude),
            airframe.outside_tables(of_mach),
        ]
    )


def _limited(plant: Plant, signals: AutopilotSignals) -> Bool[Array, "8"]:
    """At which of `AUTOPILOT_LIMITS` the autopilot's commands stand, all but the last."""
    data, limits = plant.now.air_data, plant.limits
    thrust, attitude = signals.thrust, signals.attitude
    most = plant.airframe.propulsion(100.0, data.altitude, data.mach).force_b[0]
    bank, alpha, _ = attitude.angles
    at_alpha = attitude.alpha_saturated & ((alpha <= limits.alpha_min) | (alpha >= limits.alpha_max))
    unloading = attitude.alpha_saturated & ~at_alpha & (jnp.cos(signals.motion.mu - bank) < _COS_UNLOADING)
    return jnp.stack(
        [
            thrust.saturated & (thrust.thrust > most),
            thrust.saturated & (thrust.thrust <= most),
            at_alpha | attitude.lift_short,
            (attitude.alpha_saturated & ~at_alpha & ~unloading) | attitude.load_factor_short,
            unloading,
            jnp.abs(bank) >= (1 - 1e-9) * limits.bank_max,
            signals.rates_limited,
            signals.surfaces_limited,
        ]
    )
