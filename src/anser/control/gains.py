"""Gains of the three loops.

The published ones ([TH], theory section 5), gains designed for given bandwidths, and gains derived from the
aircraft.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.motion import FlightCondition
from anser.control.allocation import deflection_for_moment, surface_moments
from anser.numerics.arrays import as_array
from anser.numerics.linear import product3, times3
from anser.shapes import Scalar, ScalarLike, Vector, Vector3


class LoopGains(eqx.Module):
    """Gains of one loop, one value per channel, shape (3,) each.

    nu = feed_forward r_dot + proportional e + integral (time integral of e) + derivative e_dot, e = r - y.
    Units: proportional 1/s, integral 1/s^2, derivative and feed-forward none.
    """

    proportional: Vector3
    integral: Vector3
    derivative: Vector3
    feed_forward: Vector3


class AutopilotGains(eqx.Module):
    """Gains of the whole autopilot.

    Attributes
    ----------
    rates
        Channels P, Q, R.
    attitude
        Channels mu, alpha, beta.
    velocity
        Channels V, gamma, chi.
    attitude_command_bandwidth, rates_command_bandwidth, surfaces_command_bandwidth
        Bandwidths of the filters that differentiate the commands passed inwards, for the feed-forward, rad/s.
    actuator_bandwidth
        Bandwidth that the allocation asks of the actuators by inverting their lag, 1/s.
    surface_bandwidth
        Bandwidth of the low-pass filter on the deflections that the outer loops see, rad/s.
    engine_bandwidth
        Bandwidth that the throttle asks of the engine by inverting its lag, 1/s.
    sensor_bandwidth
        Bandwidth of the filter on what the sensors say beyond the model, rad/s: above 0 the inversion is incremental, 0
        is model-based.
    """

    rates: LoopGains
    attitude: LoopGains
    velocity: LoopGains
    attitude_command_bandwidth: Scalar
    rates_command_bandwidth: Scalar
    surfaces_command_bandwidth: Scalar
    actuator_bandwidth: Scalar
    surface_bandwidth: Scalar
    engine_bandwidth: Scalar
    sensor_bandwidth: Scalar


def loop_gains(
    proportional: float, integral: float = 0.0, derivative: float = 0.0, feed_forward: float = 1.0
) -> LoopGains:
    """Build the same gains for all three channels of a loop."""
    return LoopGains(*(as_array([g] * 3) for g in (proportional, integral, derivative, feed_forward)))


def published_gains() -> AutopilotGains:
    """Gains of [TH] (theory section 5), for model-based inversion."""
    return AutopilotGains(
        rates=loop_gains(10.0, 0.25, 1.0),
        attitude=loop_gains(2.0),
        velocity=loop_gains(1.0, 0.025),
        attitude_command_bandwidth=as_array(4.0),
        rates_command_bandwidth=as_array(3.0),
        surfaces_command_bandwidth=as_array(20.0),
        actuator_bandwidth=as_array(40.0),
        surface_bandwidth=as_array(0.5),
        engine_bandwidth=as_array(5.0),
        sensor_bandwidth=as_array(0.0),
    )


LOOP_SEPARATION_MIN = 2.0
"""Least ratio of the bandwidths of an inner and an outer loop: the least among the published gains.

Two nested first-order loops make a pair with damping sqrt(ratio)/2, 0.71 at 2; below, they swing against each other.
"""


class LoopSeparation(NamedTuple):
    """One loop inside another: names of the channels, bandwidths (1/s) and their ratio."""

    outer: str
    inner: str
    outer_bandwidth: Scalar
    inner_bandwidth: Scalar

    @property
    def ratio(self) -> Scalar:
        """Inner over outer bandwidth; infinite for an outer loop that is open."""
        closed = self.outer_bandwidth > 0.0
        return jnp.where(closed, self.inner_bandwidth / jnp.where(closed, self.outer_bandwidth, 1.0), jnp.inf)


def design_gains(
    bandwidth: Vector3, damping: Vector3, derivative: Vector3 | float = 0.0, feed_forward: Vector3 | float = 1.0
) -> LoopGains:
    """Gains of a loop whose error obeys (1 + K_D) s^2 + K_P s + K_I = 0 with a wanted bandwidth and damping.

    Bandwidth is K_P/(1 + K_D), the sum of both poles and nearly the faster one where damping is large; damping is that
    of the quadratic, so that K_I = (1 + K_D) (bandwidth/(2 damping))^2. The published gains are bandwidths of 5, 2 and
    1 1/s with dampings of sqrt(50), infinity and sqrt(10).

    Parameters
    ----------
    bandwidth
        Per channel (3,), 1/s.
    damping
        Per channel (3,); infinite for a loop without integral.
    derivative, feed_forward
        K_D and K_FF.
    """
    derivative, feed_forward = (jnp.asarray(x) * jnp.ones(3) for x in (derivative, feed_forward))
    inertia = 1.0 + derivative
    return LoopGains(
        proportional=inertia * bandwidth,
        integral=inertia * (0.5 * bandwidth / damping) ** 2,
        derivative=derivative,
        feed_forward=feed_forward,
    )


def loop_bandwidth(gains: LoopGains) -> Vector3:
    """Bandwidth K_P/(1 + K_D) of each channel, 1/s."""
    return gains.proportional / (1.0 + gains.derivative)


def loop_separations(gains: AutopilotGains) -> tuple[LoopSeparation, ...]:
    """Every loop with the one that it rests on: path angle on alpha, course on bank, speed on the engine, and so on."""
    rates, attitude, velocity = (loop_bandwidth(loop) for loop in (gains.rates, gains.attitude, gains.velocity))
    return (
        LoopSeparation("V", "engine", velocity[0], gains.engine_bandwidth),
        LoopSeparation("gamma", "alpha", velocity[1], attitude[1]),
        LoopSeparation("chi", "mu", velocity[2], attitude[0]),
        LoopSeparation("mu", "P", attitude[0], rates[0]),
        LoopSeparation("alpha", "Q", attitude[1], rates[1]),
        LoopSeparation("beta", "R", attitude[2], rates[2]),
        *(LoopSeparation(name, "surfaces", rates[k], gains.actuator_bandwidth) for k, name in enumerate("PQR")),
    )


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


def derived_bandwidths(
    airframe: AbstractAirframe, now: FlightCondition, surfaces: Vector, power: ScalarLike, step: ScalarLike
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
    commanded = np.flatnonzero(actuators.is_commanded)
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
        return engine.rate(engine.steady_state(of), engine.throttle_for_power(power), now.air_data).power

    own = -jax.grad(power_rate)(jnp.asarray(power, dtype=float))
    of_engine = jnp.clip(_ENGINE * own, 1e-2, _ENGINE_MOST)
    # path angle rests on angle of attack, course on bank, airspeed on the engine
    velocity = jnp.stack([jnp.minimum(of_engine, attitude[1]), attitude[1], attitude[0]]) / _VELOCITY
    return Bandwidths(of_actuators, of_engine, rates, attitude, velocity)


def _cancelled(airframe: AbstractAirframe, now: FlightCondition, surfaces: Vector, of_actuators: Scalar) -> Vector:
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
    lag = jnp.max(airframe.actuators.time_constant[np.flatnonzero(airframe.actuators.is_commanded)])
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
        rates=design_gains(b.rates, _INTEGRAL_RATES * damping, _RATE_DERIVATIVE),
        attitude=design_gains(b.attitude, jnp.inf * damping),
        velocity=design_gains(b.velocity, _INTEGRAL_VELOCITY * damping),
        attitude_command_bandwidth=2.0 * slowest["attitude"],
        rates_command_bandwidth=0.6 * slowest["rates"],
        surfaces_command_bandwidth=0.5 * b.actuators,
        actuator_bandwidth=b.actuators,
        surface_bandwidth=published.surface_bandwidth * slowest["attitude"] / 2.0,
        engine_bandwidth=b.engine,
        sensor_bandwidth=published.sensor_bandwidth,
    )
