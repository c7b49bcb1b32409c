"""What a survey takes of each sample of a flight, the command that it flies, and what it makes of the whole."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from anser.aircraft import AbstractAirframe, Condition, MotionState
from anser.control import AutopilotSignals, FlightLimits, wrapped
from anser.environment import Environment
from anser.planning import PathCommand
from anser.sensing import Belief
from anser.shapes import Flag, Scalar, ScalarLike, Vector3
from anser.simulation.flight_summary import FlightSummary, Sample
from anser.simulation.recorder import AircraftSample
from anser.simulation.survey_trim import surface_share
from anser.simulation.trim import TrimTarget
from anser.spatial import path_angles, rotate_back

_END = 0.1
"""Last part of the flight over which the error at the end is taken."""
_COS_UNLOADING = 0.5


def stepped_command(target: TrimTarget, size: Vector3, time: ScalarLike) -> PathCommand:
    """Steady flight, its turn included, plus a step of (V, gamma, chi), m/s and rad."""
    zero = jnp.zeros(())
    return PathCommand(
        target.speed + size[0],
        target.path_angle + size[1],
        target.course + target.turn_rate * time + size[2],
        zero,
        zero,
        target.turn_rate,
    )


def late_from(count: int) -> int:
    """First of the `count` samples that belong to the end of a flight."""
    return round((1.0 - _END) * count)


def finished(summary: FlightSummary, state: MotionState, step: ScalarLike, count: int) -> FlightSummary:
    """Summary of a whole flight, made of the running one: sum of the late errors, last time outside the tolerance."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(state)]))
    last = (count - 1) * step
    return eqx.tree_at(
        lambda s: (s.final_error, s.settling_time, s.finite),
        summary,
        (
            summary.final_error / (count - late_from(count)),
            jnp.where(summary.settling_time >= last, jnp.inf, summary.settling_time),
            finite,
        ),
    )


def sample_of(
    sample: AircraftSample, environment: Environment, time: ScalarLike, limits: FlightLimits, start: Condition
) -> Sample:
    """What an aircraft does, and at which limits its autopilot believes to stand.

    Parameters
    ----------
    sample
        The aircraft, under `InversionAutopilot` with its velocity loop commanded.
    environment, time
        Where and when it flies, s.
    limits
        Of its autopilot.
    start
        Condition at the start, inside the airframe's data.
    """
    truth, state, now, command = sample.truth.airframe, sample.truth.state, sample.truth.now, sample.command
    actuators = truth.actuators
    gamma, chi = path_angles(rotate_back(now.R_bn, state.velocity_b) - now.wind_n)
    error = jnp.stack([command.V - now.air_data.V, command.gamma - gamma, wrapped(command.chi - chi)])
    moving = actuators.rate(state.actuators, sample.controls.surfaces, now.air_data).position
    rate_share = jnp.abs(moving) / actuators.rate_limit
    return Sample(
        time=time,
        error=error,
        alpha=now.air_data.alpha,
        beta=now.air_data.beta,
        load_factor=-now.wrench.force_b[2] / (truth.mass_properties.mass * environment.gravity),
        surface_share=surface_share(truth, state.surfaces),
        surface_rate_share=rate_share,
        body_rate_share=jnp.abs(state.rates_b) / limits.rates_max,
        limited=jnp.append(_limited(sample.belief, limits, sample.signals), jnp.any(rate_share >= 1.0)),
        outside=outside_axes(truth, now, start),
    )


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


def _limited(belief: Belief, limits: FlightLimits, signals: AutopilotSignals) -> Bool[Array, "8"]:
    """At which of `AUTOPILOT_LIMITS` the autopilot's commands stand, all but the last."""
    data, thrust, attitude = belief.now.air_data, signals.thrust, signals.attitude
    most = belief.airframe.engine.propulsion(100.0, data).force_b[0]
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
