"""Continuous turbulence by MIL-F-8785C and MIL-HDBK-1797, with Dryden and von Karman spectra."""

from collections.abc import Callable
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
from anser.shapes import Scalar, ScalarLike, Vector3
from anser.spatial.rotations import rotate, rotate_back, safe_hypot
from anser.units import FOOT_M

SpectrumFamily = Literal["dryden", "von-karman"]

_LOWEST_FT, _LOW_FT, _HIGH_FT = 10.0, 1000.0, 2000.0
_SCALE_FT = {"dryden": 1750.0, "von-karman": 2500.0}  # above 2,000 ft


class ExceedanceTable(eqx.Module):
    """Table of the root-mean-square gust velocity (m/s) over height (m) and log10 of the exceedance probability."""

    heights: Float[Array, " heights"]  #: Rising heights above the ground, m.
    log_probabilities: Float[Array, " probabilities"]  #: Falling log10 of the probability of exceedance.
    sigmas: Float[Array, "heights probabilities"]  #: Root-mean-square gust velocity, m/s.

    def at(self, height: ScalarLike, log_probability: ScalarLike) -> Scalar:
        """Return the root-mean-square gust velocity, m/s, at a height (m) and a log10 of the exceedance probability.

        The result is linear in both arguments, and constant beyond the table.
        """
        shares = linear_weights(jnp.asarray(height), self.heights)
        # column by column: the full product would be too large for one kernel
        across = jnp.stack([jnp.sum(shares * self.sigmas[:, k]) for k in range(self.sigmas.shape[1])])
        return jnp.sum(linear_weights(-jnp.asarray(log_probability), -self.log_probabilities) * across)


class TurbulenceLevels(eqx.Module):
    """Scale lengths and intensities of turbulence at one height above the ground."""

    lengths: Vector3  #: Scale lengths of u, v, w as in MIL-F-8785C, m; MIL-HDBK-1797 halves the lengths of v and w.
    sigmas: Vector3  #: Intensities (root mean square) of u, v, w, m/s.
    altitude_blend: Scalar  #: Weight of the high-altitude model: 0 up to 1,000 ft, 1 above 2,000 ft, linear in between.


def turbulence_levels(
    height: ScalarLike,
    wind_20ft: ScalarLike,
    log_probability: ScalarLike,
    table: ExceedanceTable,
    family: SpectrumFamily,
) -> TurbulenceLevels:
    """Compute the scale lengths and intensities of turbulence at a height above the ground (m).

    - Up to 1,000 ft, the intensities follow from the wind at 20 ft, `wind_20ft` (m/s).
    - Above 2,000 ft, the intensities follow from the table at the exceedance probability 10^`log_probability`.
    - In between, lengths and intensities are linear in height.
    - Below 10 ft, the values at 10 ft apply.

    The spectra of MIL-F-8785C and MIL-HDBK-1797 are equal: the handbook halves the lengths of v and w, but its spectra
    contain twice these lengths.
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


_AIRSPEED_MIN = 10.0  # m/s: below, turbulence is as at this airspeed
_ROLL = FirstOrderFilter()


class TurbulenceState(eqx.Module):
    """State of the turbulence at one aircraft between two samples, in units of the gusts' intensities."""

    #: States of the shaping filters of the gust components u, v, w and of the gust roll rate p.
    u: Array
    v: Array
    w: Array
    p: Array
    low_passed_w: Scalar  #: Gust w after the low-pass filter of the pitch gust rate.
    low_passed_v: Scalar  #: Gust v after the low-pass filter of the yaw gust rate.


class Turbulence(AbstractGusts):
    """Turbulence of MIL-F-8785C and MIL-HDBK-1797 (identical spectra), independent for each aircraft.

    Up to 1,000 ft, u is horizontal in the direction of the nose, v horizontal to the right, w down. (The standards take
    the direction of the mean flow past the aircraft.) Above 2,000 ft the axes are the body axes. In between, the gust
    is the mean of the gusts in both axes, with a weight linear in height. Gusts are constant between samples.

    The rates are rates of the air: q is minus the gradient of w along the flight, and r is the gradient of v, both
    after a low-pass filter; p is independent noise. The standards print the opposite signs, for rates of the aircraft
    relative to the air.
    """

    wind_20ft: Scalar  #: Wind at 20 ft above the ground, m/s, which sets the intensity up to 1,000 ft.
    log_probability: Scalar  #: Log10 of the exceedance probability, for the intensity above 2,000 ft from `table`.
    table: ExceedanceTable
    span: Scalar  #: Wing span, m.
    family: SpectrumFamily = eqx.field(static=True, default="dryden")  #: Family of the spectra.

    @property
    def filters(self) -> tuple[AbstractShapingFilter, AbstractShapingFilter]:
        """Two shaping filters: one for the longitudinal gust u, one for each of the transverse gusts v and w."""
        if self.family == "dryden":
            return DRYDEN_LONGITUDINAL, DRYDEN_TRANSVERSE
        return VON_KARMAN_LONGITUDINAL, VON_KARMAN_TRANSVERSE

    @property
    def normals(self) -> int:
        """Number of standard normals of all four filters together."""
        along, across = self.filters
        return along.size + 2 * across.size + 1

    def levels(self, flow: AirFlow) -> TurbulenceLevels:
        """Return the scale lengths (m) and intensities (m/s) at the aircraft's height above the ground."""
        return turbulence_levels(flow.height, self.wind_20ft, self.log_probability, self.table, self.family)

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> TurbulenceState:
        """Return a random state with the stationary distribution, from standard normals.

        The pitch and yaw gust rates of this state are 0.
        """
        along, across = self.filters
        u, v, w, p = self._shared(normals)
        v, w = across.stationary_state(v), across.stationary_state(w)
        return TurbulenceState(
            along.stationary_state(u), v, w, _ROLL.stationary_state(p), across.output(w), across.output(v)
        )

    def at(self, state: TurbulenceState, flow: AirFlow) -> Gust:
        """Return gust velocity (m/s) and gust rates (rad/s) at a sample, body axes."""
        along, across = self.filters
        level, airspeed = self.levels(flow), jnp.maximum(flow.airspeed, _AIRSPEED_MIN)
        u, v, w = along.output(state.u), across.output(state.v), across.output(state.w)
        lag_q, lag_r = self._lags(airspeed)
        rates = jnp.stack(
            [
                roll_sigma(level.lengths[2], level.sigmas[2], self.span) * _ROLL.output(state.p),
                -level.sigmas[2] * (w - state.low_passed_w) / (airspeed * lag_q),
                level.sigmas[1] * (v - state.low_passed_v) / (airspeed * lag_r),
            ]
        )
        axes = _axes(flow, level.altitude_blend)
        return Gust(axes(level.sigmas * jnp.stack([u, v, w])), axes(rates))

    def advance(
        self, state: TurbulenceState, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike
    ) -> TurbulenceState:
        """Return the state after one sampling period `step` (s); `normals` are new standard normal random numbers."""
        along, across = self.filters
        lengths, airspeed = self.levels(flow).lengths, jnp.maximum(flow.airspeed, _AIRSPEED_MIN)
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
        """Return the time constants (s) of the gust rates' low-pass filters: for pitch and roll, and for yaw."""
        return 4.0 * self.span / (np.pi * airspeed), 3.0 * self.span / (np.pi * airspeed)

    def _shared(self, normals: Float[Array, " count"]) -> tuple[Array, Array, Array, Array]:
        along, across = self.filters
        stops = np.cumsum([along.size, across.size, across.size, 1])
        u, v, w, p = (normals[a:b] for a, b in zip([0, *stops[:-1]], stops, strict=True))
        return u, v, w, p


def roll_sigma(length: ScalarLike, sigma: ScalarLike, span: ScalarLike) -> Scalar:
    """Return the standard deviation of the gust roll rate, rad/s, from scale length and intensity of the gust w.

    `length` L and wing span `span` b are in m, `sigma` in m/s. The variance is the integral of (sigma^2 / (V L)) 0.8
    (pi L / 4 b)^(1/3) / (1 + (4 b omega / pi V)^2), the spectrum of the standards, over the angular frequency omega.
    """
    ratio = 0.8 * (np.pi * jnp.asarray(length) / (4.0 * span)) ** (1.0 / 3.0)
    return sigma * jnp.sqrt(ratio * np.pi**2 / (8.0 * span * length))


def lag_response(state: Scalar, former_input: Scalar, new_input: Scalar, span: ScalarLike) -> Scalar:
    """Return the exact state of a first-order lag after a time span in which the input changes linearly.

    `span` is the time span over the lag's time constant. `former_input` and `new_input` are the inputs at the start and
    at the end of the span.
    """
    decay_less_1 = jnp.expm1(-jnp.asarray(span))
    decay, mean = 1.0 + decay_less_1, -decay_less_1 / span
    return decay * state + (mean - decay) * former_input + (1.0 - mean) * new_input


def _axes(flow: AirFlow, altitude_blend: Scalar) -> Callable[[Vector3], Vector3]:
    """Return the function that transforms a vector from turbulence axes (see `Turbulence`) to body axes."""
    ahead_n = rotate_back(flow.R_bn, jnp.zeros_like(flow.wind_n).at[0].set(1.0))
    north, east = ahead_n[:2] / jnp.maximum(safe_hypot(ahead_n[0], ahead_n[1]), 1e-6)

    def to_body(gust: Vector3) -> Vector3:
        level_n = jnp.stack([north * gust[0] - east * gust[1], east * gust[0] + north * gust[1], gust[2]])
        return (1.0 - altitude_blend) * rotate(flow.R_bn, level_n) + altitude_blend * gust

    return to_body
