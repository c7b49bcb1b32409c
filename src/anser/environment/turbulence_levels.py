"""How strong turbulence is, and how large its eddies are, by height: MIL-F-8785C and MIL-HDBK-1797."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.environment.wind import linear_shares
from anser.shapes import Scalar, ScalarLike, Vector3

Family = Literal["dryden", "von-karman"]

FOOT_M = 0.3048
_LOWEST_FT, _LOW_FT, _HIGH_FT = 10.0, 1000.0, 2000.0
_SCALE_FT = {"dryden": 1750.0, "von-karman": 2500.0}  # above 2,000 ft


class ExceedanceTable(eqx.Module):
    """Root-mean-square gust velocity by height and by the probability of being exceeded.

    Attributes
    ----------
    heights
        m, rising.
    log_probabilities
        Logarithm to base 10, falling.
    sigmas
        (height, probability), m/s.
    """

    heights: Float[Array, " heights"]
    log_probabilities: Float[Array, " probabilities"]
    sigmas: Float[Array, "heights probabilities"]

    def at(self, height: ScalarLike, log_probability: ScalarLike) -> Scalar:
        """M/s: linear in the height and in the logarithm of the probability, at the ends as there."""
        shares = linear_shares(jnp.asarray(height), self.heights)
        # column by column: together they would be too large for one kernel
        across = jnp.stack([jnp.sum(shares * self.sigmas[:, k]) for k in range(self.sigmas.shape[1])])
        return jnp.sum(linear_shares(-jnp.asarray(log_probability), -self.log_probabilities) * across)


class Levels(eqx.Module):
    """Turbulence at one height.

    Attributes
    ----------
    lengths
        Scales of u, v, w, m: those with which the forms of MIL-F-8785C hold; twice L_v and L_w of MIL-HDBK-1797.
    sigmas
        Intensities of u, v, w, m/s.
    high
        0 up to 1,000 ft, 1 from 2,000 ft on, linear in between.
    """

    lengths: Vector3
    sigmas: Vector3
    high: Scalar


def levels(
    height: ScalarLike,
    wind_20ft: ScalarLike,
    log_probability: ScalarLike,
    table: ExceedanceTable,
    family: Family,
) -> Levels:
    """Scales and intensities at a height above the ground (m).

    Both documents give the same: MIL-HDBK-1797 halves the scales of v and w, and has twice them in its spectra.

    Up to 1,000 ft by the wind at 20 ft (m/s), from 2,000 ft on by the probability of being exceeded; in between scales
    and intensities are linear in the height, from their values at 1,000 ft to those at 2,000 ft. Below 10 ft they are
    those at 10 ft.
    """
    height_ft = jnp.asarray(height) / FOOT_M
    low_ft = jnp.clip(height_ft, _LOWEST_FT, _LOW_FT)
    shape = 0.177 + 0.000823 * low_ft
    smaller = shape**-0.4
    low_lengths = jnp.stack([low_ft * smaller**3, low_ft * smaller**3, low_ft])
    sigma_w = 0.1 * jnp.asarray(wind_20ft)
    low_sigmas = sigma_w * jnp.stack([smaller, smaller, jnp.ones_like(shape)])
    scale = jnp.full(3, _SCALE_FT[family], height_ft.dtype)
    sigma = table.at(jnp.maximum(height_ft, _HIGH_FT) * FOOT_M, log_probability)
    high = jnp.clip((height_ft - _LOW_FT) / (_HIGH_FT - _LOW_FT), 0.0, 1.0)
    return Levels(
        lengths=FOOT_M * (low_lengths + high * (scale - low_lengths)),
        sigmas=low_sigmas + high * (sigma - low_sigmas),
        high=high,
    )
