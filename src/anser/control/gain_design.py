"""Gains from wanted bandwidths and damping, and whether the loops stay apart in time."""

from typing import NamedTuple

import jax.numpy as jnp

from anser.control.gains import AutopilotGains, LoopGains
from anser.shapes import Scalar, Vector3

SEPARATION_MIN = 2.0
"""Least ratio of the bandwidths of an inner and an outer loop: the least among the published gains.

Two nested first-order loops make a pair with damping sqrt(ratio)/2, 0.71 at 2; below, they swing against each other.
"""


class Separation(NamedTuple):
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


def designed_gains(
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


def separations(gains: AutopilotGains) -> tuple[Separation, ...]:
    """Every loop with the one that it rests on: path angle on alpha, course on bank, speed on the engine, and so on."""
    rates, attitude, velocity = (loop_bandwidth(loop) for loop in (gains.rates, gains.attitude, gains.velocity))
    return (
        Separation("V", "engine", velocity[0], gains.engine_bandwidth),
        Separation("gamma", "alpha", velocity[1], attitude[1]),
        Separation("chi", "mu", velocity[2], attitude[0]),
        Separation("mu", "P", attitude[0], rates[0]),
        Separation("alpha", "Q", attitude[1], rates[1]),
        Separation("beta", "R", attitude[2], rates[2]),
        *(Separation(name, "surfaces", rates[k], gains.actuator_bandwidth) for k, name in enumerate("PQR")),
    )
