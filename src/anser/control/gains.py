"""Gains of the three loops: published ([TH], theory section 5), computed from bandwidths, or derived from the aircraft.

For a flight from a scenario, `anser.scenario.build_aircraft` derives the gains once, before the flight, at the start
altitude and the preferred airspeed; they are not scheduled. Exception: the library's F-16 has the published gains.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import AirDataAndForces
from anser.control.allocation import deflection_for_moment, surface_moments
from anser.control.loop_separations import PUBLISHED_ACTUATOR_BANDWIDTH, PUBLISHED_ENGINE_BANDWIDTH
from anser.numerics.arrays import as_array, namespace
from anser.numerics.linear import product3, times3
from anser.shapes import Scalar, ScalarLike, Vector, Vector3


class LoopGains(eqx.Module):
    """Gains of one loop, one value per channel, shape (3,).

    nu = feed_forward r_dot + proportional e + integral (time integral of e) + derivative e_dot is the demanded rate of
    the output y, with the reference r and the error e = r - y.
    """

    proportional: Vector3  # 1/s
    integral: Vector3  # 1/s^2
    derivative: Vector3  # dimensionless
    feed_forward: Vector3  # dimensionless


class AutopilotGains(eqx.Module):
    """Gains of the three loops, and bandwidths of filters, actuators and engine."""

    rates: LoopGains  #: Gains of channels P, Q, R.
    attitude: LoopGains  #: Gains of channels mu, alpha, beta.
    velocity: LoopGains  #: Gains of channels V, gamma, chi.
    attitude_command_bandwidth: Scalar  #: Bandwidth of the filter that differentiates attitude commands, rad/s.
    rates_command_bandwidth: Scalar  #: Bandwidth of the filter that differentiates rate commands, rad/s.
    surfaces_command_bandwidth: Scalar  #: Bandwidth of the filter that differentiates deflections, rad/s.
    actuator_bandwidth: Scalar  #: Bandwidth of the actuators after inversion of their lag, 1/s.
    surface_bandwidth: Scalar  #: Bandwidth of the low-pass filter on the deflections used by the outer loops, rad/s.
    engine_bandwidth: Scalar  #: Bandwidth of the engine after inversion of its lag, 1/s.
    #: Bandwidth of the filter on the measured model residual, rad/s; 0: model-based inversion, above 0: incremental.
    sensor_bandwidth: Scalar


def loop_gains(proportional: float, integral: float = 0.0, derivative: float = 0.0) -> LoopGains:
    """Build equal gains for the three channels of a loop, with a feed-forward gain of 1."""
    return LoopGains(*(as_array([g] * 3) for g in (proportional, integral, derivative, 1.0)))


def published_gains() -> AutopilotGains:
    """Return the gains of the F-16's autopilot published in [TH] (theory section 5), for model-based inversion."""
    return AutopilotGains(
        rates=loop_gains(10.0, 0.25, 1.0),
        attitude=loop_gains(2.0),
        velocity=loop_gains(1.0, 0.025),
        attitude_command_bandwidth=as_array(4.0),
        rates_command_bandwidth=as_array(3.0),
        surfaces_command_bandwidth=as_array(20.0),
        actuator_bandwidth=as_array(PUBLISHED_ACTUATOR_BANDWIDTH),
        surface_bandwidth=as_array(0.5),
        engine_bandwidth=as_array(PUBLISHED_ENGINE_BANDWIDTH),
        sensor_bandwidth=as_array(0.0),
    )


def design_gains(
    bandwidth: Vector3,  # bandwidth per channel (3,), 1/s
    damping: Vector3,  # damping per channel (3,); infinite for a loop without integral
    derivative: Vector3 | float = 0.0,  # K_D
    feed_forward: Vector3 | float = 1.0,
) -> LoopGains:
    """Compute gains that give the error dynamics (1 + K_D) s^2 + K_P s + K_I = 0 a bandwidth and a damping.

    The bandwidth is K_P / (1 + K_D). The damping is the damping ratio of the two poles; from it follows
    K_I = (1 + K_D) (bandwidth / (2 damping))^2. The published gains of rate, attitude and velocity loop have bandwidths
    of 5, 2 and 1 1/s, and dampings of sqrt(50), infinity and sqrt(10).
    """
    xp = namespace(bandwidth, damping, derivative, feed_forward)
    bandwidth, damping, derivative, feed_forward = (
        xp.asarray(x) * xp.ones(3) for x in (bandwidth, damping, derivative, feed_forward)
    )
    inertia = 1.0 + derivative
    integral = inertia * (0.5 * bandwidth / damping) ** 2
    return LoopGains(*map(as_array, (inertia * bandwidth, integral, derivative, feed_forward)))


_ACTUATOR_SPEEDUP = 2.0
"""Bandwidth of an actuator with inverted lag over the bandwidth of the lag alone: 40 1/s over 20.2 1/s for the F-16."""
_ACTUATOR_BANDWIDTH_STEP_MAX = 0.4
"""Greatest bandwidth of an actuator with inverted lag, times the sampling period."""
_RATES_RATIO, _ATTITUDE_RATIO, _VELOCITY_RATIO = 8.0, 2.5, 2.0
"""Ratio of the next inner loop's bandwidth to the loop's bandwidth, for (P, Q, R), (mu, alpha, beta) and (V, gamma,
chi), as in the published gains (40, 5, 2, 1 1/s from the actuators outwards)."""
_GAIN_MARGIN, _RATES_RATIO_MIN = 3.0, 4.0
"""Factor on an actuator's gain (9.5 dB) that the pitch and yaw loops must tolerate, so that stiffer aircraft get faster
loops; and least ratio of the actuators' bandwidth to the bandwidth of the body rates."""
_RATE_DERIVATIVE = 1.0
"""K_D of the body rates, as in the published gains."""
_RATE_ERROR = np.radians(20.0)
"""Largest body-rate error within the linear range of the surfaces, rad/s."""
_ENGINE_SPEEDUP, _ENGINE_BANDWIDTH_MAX = 5.0, 5.0
"""Bandwidth of the engine with inverted lag: multiple of the lag's bandwidth, and greatest value, 1/s."""
_RATES_DAMPING, _VELOCITY_DAMPING = np.sqrt(50.0), np.sqrt(10.0)
"""Damping of the pole pairs of the rate and velocity loops, which have integrals, as in the published gains."""


class Bandwidths(eqx.Module):
    """Bandwidths of the three loops, the actuators and the engine, 1/s, from which `automatic_gains` computes gains."""

    actuators: Scalar  # after inversion of the lag
    engine: Scalar  # after inversion of the lag
    rates: Vector  # of (P, Q, R)
    attitude: Vector  # of (mu, alpha, beta)
    velocity: Vector  # of (V, gamma, chi)


def derived_bandwidths(
    airframe: AbstractAirframe,
    condition: AirDataAndForces,
    surfaces: Vector,  # trimmed deflections, rad
    power: ScalarLike,  # trimmed engine power, percent
    step: ScalarLike,  # sampling period, s
) -> Bandwidths:
    """Compute the loop bandwidths (1/s) that an aircraft's actuators, engine and control authority allow.

    `condition` must be the trimmed flight condition. The ratios of the bandwidths are as in the published gains of the
    F-16 ([TH]; theory section 5). For the F-16, the result agrees with the published bandwidths within 1 percent.
    """
    actuators = airframe.actuators
    commanded = np.flatnonzero(actuators.is_commanded)
    lag_limit = _ACTUATOR_SPEEDUP / jnp.max(actuators.time_constant[commanded])
    actuator_bandwidth = jnp.minimum(lag_limit, _ACTUATOR_BANDWIDTH_STEP_MAX / step)
    moments = surface_moments(airframe, condition, jnp.zeros(3), surfaces)
    deflection = product3(deflection_for_moment(actuators, moments.effectiveness), airframe.mass_properties.inertia_b)
    margin = jnp.minimum(surfaces - actuators.lower, actuators.upper - surfaces)
    margin_share = jnp.abs(deflection) / jnp.maximum(margin, 1e-3)[:, None]
    authority_limit = 1.0 / jnp.maximum(jnp.max(margin_share[commanded], axis=0), 1e-6) / _RATE_ERROR
    required = _required_stiffness(airframe, condition, surfaces, actuator_bandwidth)
    stiff = jnp.minimum(
        jnp.sqrt(_ATTITUDE_RATIO * jnp.maximum(required, 1e-6)),
        jnp.minimum(actuator_bandwidth / _RATES_RATIO_MIN, authority_limit),
    )
    rates = jnp.maximum(jnp.minimum(actuator_bandwidth / _RATES_RATIO, authority_limit), stiff)
    if not actuators.controls_yaw:
        rates = rates.at[2].set(jnp.min(rates[:2]))
    attitude = rates / _ATTITUDE_RATIO

    def power_rate(engine_power: Scalar) -> Scalar:
        engine = airframe.engine
        return engine.rate(
            engine.steady_state(engine_power), engine.throttle_for_power(power), condition.air_data
        ).power

    lag_bandwidth = -jax.grad(power_rate)(jnp.asarray(power, dtype=float))
    engine_bandwidth = jnp.clip(_ENGINE_SPEEDUP * lag_bandwidth, 1e-2, _ENGINE_BANDWIDTH_MAX)
    # inner loops: angle of attack for the path angle, bank for the course, engine for the airspeed
    velocity = jnp.stack([jnp.minimum(engine_bandwidth, attitude[1]), attitude[1], attitude[0]]) / _VELOCITY_RATIO
    return Bandwidths(actuator_bandwidth, engine_bandwidth, rates, attitude, velocity)


def _required_stiffness(
    airframe: AbstractAirframe, condition: AirDataAndForces, surfaces: Vector, actuator_bandwidth: Scalar
) -> Vector3:
    """Return the least stiffness (1/s^2) at which the P, Q, R loops bear `_GAIN_MARGIN` times the actuators' gain."""

    # Stiffness is angular acceleration per rad of error. Inversion replaces the natural stiffness S by the stiffness C
    # of the loops. With k times the nominal gain, an actuator with lag tau and bandwidth B after inversion moves r
    # times as far as commanded: r = c / (c - (k - 1)) with c = k tau B (1 + K_D). The remaining stiffness
    # S - r S + r C is positive if C > (1 - 1/r) S = S (k - 1) / c.
    def angular_acceleration(angles: Float[Array, "2"]) -> Vector3:
        data = eqx.tree_at(lambda d: (d.alpha, d.beta), condition.air_data, (angles[0], angles[1]))
        moment_b = airframe.aerodynamics(data, jnp.zeros(3), surfaces).moment_b
        return times3(airframe.mass_properties.inertia_inverse_b, moment_b)

    slope = jax.jacfwd(angular_acceleration)(jnp.stack([condition.air_data.alpha, condition.air_data.beta]))
    natural_stiffness = jnp.stack(
        [jnp.zeros_like(slope[0, 0]), jnp.maximum(-slope[1, 0], 0.0), jnp.maximum(slope[2, 1], 0.0)]
    )
    lag = jnp.max(airframe.actuators.time_constant[np.flatnonzero(airframe.actuators.is_commanded)])
    stiffness_ratio = _GAIN_MARGIN * lag * actuator_bandwidth * (1.0 + _RATE_DERIVATIVE)
    return natural_stiffness * jnp.minimum((_GAIN_MARGIN - 1.0) / stiffness_ratio, 1.0)


def automatic_gains(bandwidths: Bandwidths) -> AutopilotGains:
    """Compute all gains of the autopilot from loop bandwidths.

    Feed-forward, damping, and the ratios of filter to loop bandwidths are as in the published gains.
    """
    xp = namespace(bandwidths)
    bandwidths, published = jax.tree.map(xp.asarray, (bandwidths, published_gains()))
    damping = xp.ones(3)
    slowest = {"rates": xp.min(bandwidths.rates), "attitude": xp.min(bandwidths.attitude[:2])}
    gains = AutopilotGains(
        rates=design_gains(bandwidths.rates, _RATES_DAMPING * damping, _RATE_DERIVATIVE),
        attitude=design_gains(bandwidths.attitude, np.inf * damping),
        velocity=design_gains(bandwidths.velocity, _VELOCITY_DAMPING * damping),
        attitude_command_bandwidth=2.0 * slowest["attitude"],
        rates_command_bandwidth=0.6 * slowest["rates"],
        surfaces_command_bandwidth=0.5 * bandwidths.actuators,
        actuator_bandwidth=bandwidths.actuators,
        surface_bandwidth=published.surface_bandwidth * slowest["attitude"] / 2.0,
        engine_bandwidth=bandwidths.engine,
        sensor_bandwidth=published.sensor_bandwidth,
    )
    return jax.tree.map(as_array, gains)
