"""Continuous turbulence by MIL-F-8785C and MIL-HDBK-1797.

Scales and intensities by height, Dryden and von Karman spectra, and the equivalent body rates of gust gradients.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment.environment import linear_weights
from anser.environment.gust_filters import (
    DRYDEN_LONGITUDINAL,
    DRYDEN_TRANSVERSE,
    VON_KARMAN_LONGITUDINAL,
    VON_KARMAN_TRANSVERSE,
    AbstractShapingFilter,
    FirstOrderFilter,
)
from anser.environment.gusts import AbstractGusts, AirFlow, Gust
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial.rotations import rotate, rotate_back, safe_hypot

SpectrumFamily = Literal["dryden", "von-karman"]

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
        shares = linear_weights(jnp.asarray(height), self.heights)
        # column by column: together they would be too large for one kernel
        across = jnp.stack([jnp.sum(shares * self.sigmas[:, k]) for k in range(self.sigmas.shape[1])])
        return jnp.sum(linear_weights(-jnp.asarray(log_probability), -self.log_probabilities) * across)


class TurbulenceLevels(eqx.Module):
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
    altitude_blend: Scalar


def turbulence_levels(
    height: ScalarLike,
    wind_20ft: ScalarLike,
    log_probability: ScalarLike,
    table: ExceedanceTable,
    family: SpectrumFamily,
) -> TurbulenceLevels:
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
    return TurbulenceLevels(
        lengths=FOOT_M * (low_lengths + high * (scale - low_lengths)),
        sigmas=low_sigmas + high * (sigma - low_sigmas),
        altitude_blend=high,
    )


_SLOWEST = 10.0  # m/s: below, turbulence is met as at this airspeed
_ROLL = FirstOrderFilter()


class TurbulenceState(eqx.Module):
    """Turbulence at one aircraft between two samples.

    Attributes
    ----------
    u, v, w
        States of the shaping filters.
    p
        Of that of the roll rate.
    pitching, yawing
        Gusts w and v as the wing has low-passed them, over their intensities.
    """

    u: Array
    v: Array
    w: Array
    p: Array
    low_passed_w: Scalar
    low_passed_v: Scalar


class Turbulence(AbstractGusts):
    """Turbulence by MIL-F-8785C and MIL-HDBK-1797, which give the same spectra; each aircraft meets its own.

    The field is frozen and one aircraft flies through it: gusts of two aircraft are independent, as they are where
    these are several scales apart. Up to 1,000 ft u is horizontal along the flight through the air, v horizontal to its
    right, w down; from 2,000 ft on they are body axes; in between the gust is a mean of both, linear in the height.
    Rates: q is the gradient of w along the flight and r minus that of v, each low-passed by the span; p is noise of
    its own. Between samples the gust is held.

    Attributes
    ----------
    wind_20ft
        Wind at 20 ft, which sets the intensity below 1,000 ft, m/s.
    log_probability
        Logarithm to base 10 of the probability that the intensity above 2,000 ft is exceeded.
    table
        Of intensities.
    span
        Of the wing, m.
    family
        Of the spectra.
    """

    wind_20ft: Scalar
    log_probability: Scalar
    table: ExceedanceTable
    span: Scalar
    family: SpectrumFamily = eqx.field(static=True, default="dryden")

    @property
    def filters(self) -> tuple[AbstractShapingFilter, AbstractShapingFilter]:
        """Of the gust along the flight, and of those across it."""
        if self.family == "dryden":
            return DRYDEN_LONGITUDINAL, DRYDEN_TRANSVERSE
        return VON_KARMAN_LONGITUDINAL, VON_KARMAN_TRANSVERSE

    @property
    def normals(self) -> int:
        """Of all filters."""
        along, across = self.filters
        return along.size + 2 * across.size + 1

    def levels(self, flow: AirFlow) -> TurbulenceLevels:
        """Scales and intensities."""
        return turbulence_levels(flow.height, self.wind_20ft, self.log_probability, self.table, self.family)

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> TurbulenceState:
        """See `AbstractGusts`; the wing's low-passes begin with the gusts as they are."""
        along, across = self.filters
        u, v, w, p = self._shared(normals)
        v, w = across.stationary_state(v), across.stationary_state(w)
        return TurbulenceState(
            along.stationary_state(u), v, w, _ROLL.stationary_state(p), across.output(w), across.output(v)
        )

    def at(self, state: TurbulenceState, flow: AirFlow) -> Gust:
        """See `AbstractGusts`."""
        along, across = self.filters
        level, airspeed = self.levels(flow), jnp.maximum(flow.airspeed, _SLOWEST)
        u, v, w = along.output(state.u), across.output(state.v), across.output(state.w)
        lag_q, lag_r = self._lags(airspeed)
        rates = jnp.stack(
            [
                roll_sigma(level.lengths[2], level.sigmas[2], self.span) * _ROLL.output(state.p),
                level.sigmas[2] * (w - state.low_passed_w) / (airspeed * lag_q),
                -level.sigmas[1] * (v - state.low_passed_v) / (airspeed * lag_r),
            ]
        )
        axes = _axes(flow, level.altitude_blend)
        return Gust(axes(level.sigmas * jnp.stack([u, v, w])), axes(rates))

    def advance(
        self, state: TurbulenceState, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike
    ) -> TurbulenceState:
        """See `AbstractGusts`."""
        along, across = self.filters
        lengths, airspeed = self.levels(flow).lengths, jnp.maximum(flow.airspeed, _SLOWEST)
        spans = step * airspeed / lengths
        lag_q, lag_r = self._lags(airspeed)
        u, v, w, p = self._shared(normals)
        after_v, after_w = across.advance(state.v, v, spans[1]), across.advance(state.w, w, spans[2])
        return TurbulenceState(
            u=along.advance(state.u, u, spans[0]),
            v=after_v,
            w=after_w,
            p=_ROLL.advance(state.p, p, step / lag_q),
            low_passed_w=lag_response(state.low_passed_w, across.output(state.w), across.output(after_w), step / lag_q),
            low_passed_v=lag_response(state.low_passed_v, across.output(state.v), across.output(after_v), step / lag_r),
        )

    def _lags(self, airspeed: Scalar) -> tuple[Scalar, Scalar]:
        """Time constants of the wing's low-passes of pitch and yaw rate, s; that of the roll rate is that of pitch."""
        return 4.0 * self.span / (np.pi * airspeed), 3.0 * self.span / (np.pi * airspeed)

    def _shared(self, normals: Float[Array, " count"]) -> tuple[Array, Array, Array, Array]:
        along, across = self.filters
        ends = np.cumsum([along.size, across.size, across.size, 1])
        u, v, w, p = (normals[a:b] for a, b in zip([0, *ends[:-1]], ends, strict=True))
        return u, v, w, p


def roll_sigma(length: ScalarLike, sigma: ScalarLike, span: ScalarLike) -> Scalar:
    """Standard deviation of the roll rate of gusts, rad/s, from scale (m) and intensity (m/s) of w and the span (m).

    The integral of (sigma^2 / (V L)) 0.8 (pi L / 4 b)^(1/3) / (1 + (4 b w / pi V)^2) over w.
    """
    ratio = 0.8 * (np.pi * jnp.asarray(length) / (4.0 * span)) ** (1.0 / 3.0)
    return sigma * jnp.sqrt(ratio * np.pi**2 / (8.0 * span * length))


def lag_response(state: Scalar, before: Scalar, after: Scalar, span: ScalarLike) -> Scalar:
    """First-order lag of a signal that changes evenly over a span (in time constants): exact for such a signal."""
    fade = jnp.expm1(-jnp.asarray(span))
    kept, mean = 1.0 + fade, -fade / span
    return kept * state + (mean - kept) * before + (1.0 - mean) * after


class _Axes(eqx.Module):
    """From the axes of turbulence to body axes."""

    R_bn: Matrix33
    ahead: Float[Array, "2"]
    altitude_blend: Scalar

    def __call__(self, gust: Vector3) -> Vector3:
        north, east = self.ahead
        level_n = jnp.stack([north * gust[0] - east * gust[1], east * gust[0] + north * gust[1], gust[2]])
        return (1.0 - self.altitude_blend) * rotate(self.R_bn, level_n) + self.altitude_blend * gust


def _axes(flow: AirFlow, altitude_blend: Scalar) -> _Axes:
    ahead_n = rotate_back(flow.R_bn, jnp.zeros_like(flow.wind_n).at[0].set(1.0))
    level = jnp.maximum(safe_hypot(ahead_n[0], ahead_n[1]), 1e-6)
    return _Axes(flow.R_bn, ahead_n[:2] / level, altitude_blend)
