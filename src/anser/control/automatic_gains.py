"""Gains from the aircraft itself: as fast as its actuators, its sampling, its authority and its engine bear."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft import AbstractAirframe, Condition
from anser.control.allocation import deflection_for_moment, surface_moments
from anser.control.gain_design import designed_gains
from anser.control.gains import AutopilotGains, published_gains
from anser.numerics import product3, times3
from anser.shapes import Scalar, ScalarLike, Vector

_ACTUATORS = 2.0
"""Bandwidth that is asked of an actuator, over that of its own lag: 40 1/s of the F-16's 20.2 1/s."""
_SAMPLES = 0.4
"""Bandwidth that is asked of an actuator, at most, times the sampling period."""
_RATES, _ATTITUDE, _VELOCITY = 8.0, 2.5, 2.0
"""Bandwidth of each loop: that of the one inside it over this, as in the published gains (40, 5, 2, 1 1/s)."""
_GAIN_MARGIN, _NEAREST = 3.0, 4.0
"""Gain margin of an actuator (9.5 dB) that pitch and yaw leave: the stiffer the aircraft, the faster they are; at most
they come as near to the bandwidth of the actuators as this."""
_RATE_DERIVATIVE = 1.0
"""K_D of the body rates, as in the published gains."""
_RATE_ERROR = np.radians(20.0)
"""Error of a body rate that the surfaces must be able to work on in full, rad/s."""
_ENGINE, _ENGINE_MOST = 5.0, 5.0
"""Bandwidth that is asked of the engine, over that of its own lag and in 1/s, at most."""
_INTEGRAL_RATES, _INTEGRAL_VELOCITY = np.sqrt(50.0), np.sqrt(10.0)
"""Damping of the pairs that the integrals make, as in the published gains."""


class Bandwidths(eqx.Module):
    """Bandwidths of the loops, 1/s.

    Attributes
    ----------
    actuators, engine
        That are asked of them by inverting their lags.
    rates, attitude, velocity
        Of (P, Q, R), (mu, alpha, beta), (V, gamma, chi).
    """

    actuators: Scalar
    engine: Scalar
    rates: Vector
    attitude: Vector
    velocity: Vector


def own_bandwidths(
    airframe: AbstractAirframe, now: Condition, surfaces: Vector, power: ScalarLike, step: ScalarLike
) -> Bandwidths:
    """Bandwidths that an aircraft bears in a steady condition.

    The ratios are those of the published gains of the F-16 ([TH]; theory section 5), which come out for it but for the
    rounding of its actuators' lag.

    Parameters
    ----------
    airframe, now
        In steady flight.
    surfaces, power
        There, rad and percent.
    step
        Sampling period, s.
    """
    actuators = airframe.actuators
    commanded = np.flatnonzero(actuators.commanded)
    fastest = _ACTUATORS / jnp.max(actuators.time_constant[commanded])
    of_actuators = jnp.minimum(fastest, _SAMPLES / step)
    moments = surface_moments(airframe, now, jnp.zeros(3), surfaces)
    each = product3(deflection_for_moment(actuators, moments.slope), airframe.mass_properties.inertia_b)
    left = jnp.minimum(surfaces - actuators.lower, actuators.upper - surfaces)
    used = jnp.abs(each) / jnp.maximum(left, 1e-3)[:, None]
    able = 1.0 / jnp.maximum(jnp.max(used[commanded], axis=0), 1e-6)
    rates = jnp.minimum(of_actuators / _RATES, able / _RATE_ERROR)
    stiff = jnp.sqrt(_ATTITUDE * jnp.maximum(_cancelled(airframe, now, surfaces, of_actuators), 1e-6))
    rates = jnp.maximum(rates, jnp.minimum(stiff, jnp.minimum(of_actuators / _NEAREST, able / _RATE_ERROR)))
    if not actuators.controls_yaw:
        rates = rates.at[2].set(jnp.min(rates[:2]))
    attitude = rates / _ATTITUDE

    def power_rate(of: Scalar) -> Scalar:
        engine = airframe.engine
        return engine.rate(engine.settled(of), engine.throttle_for_power(power), now.air_data).power

    own = -jax.grad(power_rate)(jnp.asarray(power, dtype=float))
    of_engine = jnp.clip(_ENGINE * own, 1e-2, _ENGINE_MOST)
    # path angle rests on angle of attack, course on bank, airspeed on the engine
    velocity = jnp.stack([jnp.minimum(of_engine, attitude[1]), attitude[1], attitude[0]]) / _VELOCITY
    return Bandwidths(of_actuators, of_engine, rates, attitude, velocity)


def _cancelled(airframe: AbstractAirframe, now: Condition, surfaces: Vector, of_actuators: Scalar) -> Vector:
    """Stiffness (1/s^2, of P, Q, R) that the loops must have beside the aircraft's own, -M_alpha or N_beta.

    Inversion takes the own stiffness S out and puts that of the loops in its place, the product of their bandwidths.
    An actuator with the lag tau and k times its gain goes to the wanted deflection with k tau B (1 + K_D) and beyond it
    with k - 1: r = k tau B (1 + K_D)/(k tau B (1 + K_D) - (k - 1)) times as far. What is left, S - r S and r times that
    of the loops, is stable where the loops have more than (1 - 1/r) S = S (k - 1)/(k tau B (1 + K_D)); where that is
    more than S, with actuators much faster than the samples, no loops make it so, and S is asked for.
    """

    def turned(angles: Vector) -> Vector:
        data = eqx.tree_at(lambda d: (d.alpha, d.beta), now.air_data, (angles[0], angles[1]))
        moment_b = airframe.aerodynamics(data, jnp.zeros(3), surfaces).moment_b
        return times3(airframe.mass_properties.inertia_inverse_b, moment_b)

    slope = jax.jacfwd(turned)(jnp.stack([now.air_data.alpha, now.air_data.beta]))
    own = jnp.stack([jnp.zeros_like(slope[0, 0]), jnp.maximum(-slope[1, 0], 0.0), jnp.maximum(slope[2, 1], 0.0)])
    lag = jnp.max(airframe.actuators.time_constant[np.flatnonzero(airframe.actuators.commanded)])
    nearer = _GAIN_MARGIN * lag * of_actuators * (1.0 + _RATE_DERIVATIVE)
    return own * jnp.minimum((_GAIN_MARGIN - 1.0) / nearer, 1.0)


def automatic_gains(bandwidths: Bandwidths) -> AutopilotGains:
    """Gains of all loops from their bandwidths; feed-forward and dampings keep the published proportions.

    So do the filters of commands, to the slowest axis of each loop.
    """
    published, b = published_gains(), bandwidths
    damping = jnp.ones(3)
    slowest = {"rates": jnp.min(b.rates), "attitude": jnp.min(b.attitude[:2])}
    return AutopilotGains(
        rates=designed_gains(b.rates, _INTEGRAL_RATES * damping, _RATE_DERIVATIVE),
        attitude=designed_gains(b.attitude, jnp.inf * damping),
        velocity=designed_gains(b.velocity, _INTEGRAL_VELOCITY * damping),
        attitude_command_bandwidth=2.0 * slowest["attitude"],
        rates_command_bandwidth=0.6 * slowest["rates"],
        surfaces_command_bandwidth=0.5 * b.actuators,
        actuator_bandwidth=b.actuators,
        surface_bandwidth=published.surface_bandwidth * slowest["attitude"] / 2.0,
        engine_bandwidth=b.engine,
        sensor_bandwidth=published.sensor_bandwidth,
    )
