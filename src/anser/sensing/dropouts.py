"""Dropouts: independent ones, and bursts of them."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Flag, Scalar, ScalarLike

_SHORTEST_S = 1e-9


class Dropouts(eqx.Module):
    """When measurements fail: each by itself, and all of them during outages that come and go (Gilbert-Elliott).

    The chain of Gilbert (Bell System Technical Journal 39, 1960) and Elliott (42, 1963) in continuous time: outages
    last, and stay away, for exponentially distributed times.

    Attributes
    ----------
    probability
        With which a measurement is lost by itself, 0..1.
    outage_share
        Part of the time that is spent in outages, 0..1.
    outage_mean
        Mean duration of an outage, s.
    """

    probability: Scalar
    outage_share: Scalar
    outage_mean: Scalar

    def first(self, uniform: ScalarLike) -> Flag:
        """Whether an outage is on at the start, from a number between 0 and 1."""
        return jnp.asarray(uniform) < self.outage_share

    def after(self, outage: Flag, elapsed: ScalarLike, uniform: ScalarLike) -> Flag:
        """Whether one is on some time (s) later: the exact transition of the chain."""
        # share = mean_bad / (mean_bad + mean_good): the chain forgets with the sum of both rates
        mean = jnp.maximum(self.outage_mean, _SHORTEST_S)
        good_share = jnp.maximum(1.0 - self.outage_share, 1e-12)
        kept = jnp.exp(-jnp.asarray(elapsed) / (mean * good_share))
        probability = self.outage_share + jnp.where(outage, 1.0 - self.outage_share, -self.outage_share) * kept
        return jnp.asarray(uniform) < probability

    def lost(self, outage: Flag, uniform: ScalarLike) -> Flag:
        """Whether a measurement is lost."""
        return outage | (jnp.asarray(uniform) < self.probability)


def gauss_markov(
    error: Float[Array, "..."], sigma: ScalarLike, time_constant: ScalarLike, elapsed: ScalarLike, normals: Array
) -> Float[Array, "..."]:
    """A first-order Gauss-Markov error some time (s) later, from standard normals of its shape: exact, stationary.

    `sigma` is its standard deviation, `time_constant` (s) that of its exponential autocorrelation.
    """
    kept = jnp.exp(-jnp.asarray(elapsed) / time_constant)
    fresh = jnp.sqrt(-jnp.expm1(-2.0 * jnp.asarray(elapsed) / time_constant))
    return kept * error + sigma * fresh * normals
