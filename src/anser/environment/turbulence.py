"""Continuous turbulence: Dryden and von Karman spectra with the rates that the gusts' gradients make."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.environment.gust_filters import (
    DRYDEN_ACROSS,
    DRYDEN_ALONG,
    VON_KARMAN_ACROSS,
    VON_KARMAN_ALONG,
    AbstractShapingFilter,
    FirstOrder,
)
from anser.environment.gusts import AbstractGusts, AirFlow, Gust
from anser.environment.turbulence_levels import ExceedanceTable, Family, Levels, levels
from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3
from anser.spatial import rotate, rotate_back, safe_hypot

_SLOWEST = 10.0  # m/s: below, turbulence is met as at this airspeed
_ROLL = FirstOrder()


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
    pitching: Scalar
    yawing: Scalar


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
    family: Family = eqx.field(static=True, default="dryden")

    @property
    def filters(self) -> tuple[AbstractShapingFilter, AbstractShapingFilter]:
        """Of the gust along the flight, and of those across it."""
        if self.family == "dryden":
            return DRYDEN_ALONG, DRYDEN_ACROSS
        return VON_KARMAN_ALONG, VON_KARMAN_ACROSS

    @property
    def normals(self) -> int:
        """Of all filters."""
        along, across = self.filters
        return along.size + 2 * across.size + 1

    def levels(self, flow: AirFlow) -> Levels:
        """Scales and intensities."""
        return levels(flow.height, self.wind_20ft, self.log_probability, self.table, self.family)

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> TurbulenceState:
        """See `AbstractGusts`; the wing's low-passes begin with the gusts as they are."""
        along, across = self.filters
        u, v, w, p = self._shared(normals)
        v, w = across.stationary(v), across.stationary(w)
        return TurbulenceState(along.stationary(u), v, w, _ROLL.stationary(p), across.output(w), across.output(v))

    def at(self, memory: TurbulenceState, flow: AirFlow) -> Gust:
        """See `AbstractGusts`."""
        along, across = self.filters
        level, airspeed = self.levels(flow), jnp.maximum(flow.airspeed, _SLOWEST)
        u, v, w = along.output(memory.u), across.output(memory.v), across.output(memory.w)
        lag_q, lag_r = self._lags(airspeed)
        rates = jnp.stack(
            [
                roll_sigma(level.lengths[2], level.sigmas[2], self.span) * _ROLL.output(memory.p),
                level.sigmas[2] * (w - memory.pitching) / (airspeed * lag_q),
                -level.sigmas[1] * (v - memory.yawing) / (airspeed * lag_r),
            ]
        )
        axes = _axes(flow, level.high)
        return Gust(axes(level.sigmas * jnp.stack([u, v, w])), axes(rates))

    def advance(
        self, memory: TurbulenceState, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike
    ) -> TurbulenceState:
        """See `AbstractGusts`."""
        along, across = self.filters
        lengths, airspeed = self.levels(flow).lengths, jnp.maximum(flow.airspeed, _SLOWEST)
        spans = step * airspeed / lengths
        lag_q, lag_r = self._lags(airspeed)
        u, v, w, p = self._shared(normals)
        after_v, after_w = across.advanced(memory.v, v, spans[1]), across.advanced(memory.w, w, spans[2])
        return TurbulenceState(
            u=along.advanced(memory.u, u, spans[0]),
            v=after_v,
            w=after_w,
            p=_ROLL.advanced(memory.p, p, step / lag_q),
            pitching=lagged(memory.pitching, across.output(memory.w), across.output(after_w), step / lag_q),
            yawing=lagged(memory.yawing, across.output(memory.v), across.output(after_v), step / lag_r),
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


def lagged(state: Scalar, before: Scalar, after: Scalar, span: ScalarLike) -> Scalar:
    """First-order lag of a signal that changes evenly over a span (in time constants): exact for such a signal."""
    fade = jnp.expm1(-jnp.asarray(span))
    kept, mean = 1.0 + fade, -fade / span
    return kept * state + (mean - kept) * before + (1.0 - mean) * after


class _Axes(eqx.Module):
    """From the axes of turbulence to body axes."""

    R_bn: Matrix33
    ahead: Float[Array, "2"]
    high: Scalar

    def __call__(self, gust: Vector3) -> Vector3:
        north, east = self.ahead
        level_n = jnp.stack([north * gust[0] - east * gust[1], east * gust[0] + north * gust[1], gust[2]])
        return (1.0 - self.high) * rotate(self.R_bn, level_n) + self.high * gust


def _axes(flow: AirFlow, high: Scalar) -> _Axes:
    ahead_n = rotate_back(flow.R_bn, jnp.zeros_like(flow.wind_n).at[0].set(1.0))
    level = jnp.maximum(safe_hypot(ahead_n[0], ahead_n[1]), 1e-6)
    return _Axes(flow.R_bn, ahead_n[:2] / level, high)
