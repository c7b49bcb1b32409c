"""Shaping filters of turbulence: filters that turn white noise into gusts with a prescribed spectrum.

Time is in units of L/V (scale length over airspeed), and gusts are in units of their intensity (root mean square).
"""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.shapes import Scalar

_SERIES_BELOW = 0.05
_SERIES = [(-2.0) ** k / (np.prod(np.arange(1, k + 1), dtype=float) * (k + 3)) for k in range(8)]


class AbstractShapingFilter(eqx.Module):
    """Interface of a shaping filter, driven by white noise of unit intensity."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of filter states, and of standard normal random numbers per step."""

    @abc.abstractmethod
    def stationary_state(self, normals: Float[Array, " size"]) -> Float[Array, " size"]:
        """Return a random state with the stationary distribution, from standard normal random numbers."""

    @abc.abstractmethod
    def transition(self, span: Scalar) -> tuple[Float[Array, "size size"], Float[Array, "size size"]]:
        """Return the state transition matrix over a time span (in units of L/V), and a root of the noise covariance.

        The noise covariance over the span is the root times the transposed root.
        """

    @abc.abstractmethod
    def output(self, state: Float[Array, " size"]) -> Scalar:
        """Return the gust of a filter state, in units of the intensity."""

    def advance(
        self, state: Float[Array, " size"], normals: Float[Array, " size"], span: Scalar
    ) -> Float[Array, " size"]:
        """Return the filter state after a time span (in units of L/V) of any length, without discretization error.

        `normals` must be independent standard normal random numbers.
        """
        # float64 at any precision: the covariance added in a short span suffers from cancellation
        transition, noise_root = (matrix.astype(state.dtype) for matrix in self.transition(span.astype(float)))
        return jnp.sum(transition * state[None, :], axis=1) + jnp.sum(noise_root * normals[None, :], axis=1)


class FirstOrderFilter(AbstractShapingFilter):
    """First-order filter H(s) = sqrt(2) / (1 + s), with the one-sided spectrum (2/pi) / (1 + w^2).

    Used for Dryden's longitudinal gust, and for the roll rate of the gusts in both spectra.
    """

    @property
    def size(self) -> int:
        """Number of states: 1."""
        return 1

    def stationary_state(self, normals: Float[Array, "1"]) -> Float[Array, "1"]:
        """Return a random state with the stationary distribution, from a standard normal random number."""
        return normals

    def transition(self, span: Scalar) -> tuple[Float[Array, "1 1"], Float[Array, "1 1"]]:
        """Return the transition matrix over a span (in units of L/V) and the root of the noise covariance."""
        fade = jnp.expm1(-span)
        return (1.0 + fade)[None, None], jnp.sqrt(-fade * (2.0 + fade))[None, None]

    def output(self, state: Float[Array, "1"]) -> Scalar:
        """Return the gust of a filter state, in units of the intensity."""
        return state[0]


class DrydenTransverse(AbstractShapingFilter):
    """Filter of Dryden's transverse gusts, H(s) = (1 + sqrt(3) s) / (1 + s)^2.

    The one-sided spectrum is (1/pi) (1 + 3 w^2) / (1 + w^2)^2.
    """

    @property
    def size(self) -> int:
        """Number of states: 2."""
        return 2

    def stationary_state(self, normals: Float[Array, "2"]) -> Float[Array, "2"]:
        """Return a random state with the stationary distribution: two independent elements of variance 1/4."""
        return 0.5 * normals

    def transition(self, span: Scalar) -> tuple[Float[Array, "2 2"], Float[Array, "2 2"]]:
        """Return transition matrix and root of the noise covariance over a span (in units of L/V).

        The filter is x1' = x2, x2' = -x1 - 2 x2 + n, with white noise n.
        """
        t, faded = span, jnp.exp(-span)
        faded_square = faded**2
        transition = faded * jnp.stack([jnp.stack([1.0 + t, t]), jnp.stack([-t, 1.0 - t])])
        small = jnp.minimum(t, _SERIES_BELOW)
        series = small**3 * sum(c * small**k for k, c in enumerate(_SERIES))
        closed_form = 0.25 - faded_square * (0.5 * t * t + 0.5 * t + 0.25)
        variance_1 = jnp.where(t < _SERIES_BELOW, series, closed_form)
        covariance = 0.5 * t * t * faded_square
        variance_2 = jnp.maximum(0.25 + faded_square * (0.5 * t - 0.5 * t * t - 0.25), 1e-30)
        root = jnp.sqrt(variance_2)
        remainder_root = jnp.sqrt(jnp.maximum(variance_1 - covariance**2 / variance_2, 1e-60))
        zero = jnp.zeros_like(t)
        return transition, jnp.stack([jnp.stack([covariance / root, remainder_root]), jnp.stack([root, zero])])

    def output(self, state: Float[Array, "2"]) -> Scalar:
        """Return the gust of a filter state, in units of the intensity."""
        return state[0] + math.sqrt(3.0) * state[1]


class ModalFilter(AbstractShapingFilter):
    """Filter H(s) = sum of r_i / (s + p_i) with distinct real poles -p_i."""

    poles: tuple[float, ...] = eqx.field(static=True)  #: p_i.
    residues: tuple[float, ...] = eqx.field(static=True)  #: r_i.

    @property
    def size(self) -> int:
        """Number of poles."""
        return len(self.poles)

    def stationary_state(self, normals: Float[Array, " size"]) -> Float[Array, " size"]:
        """Return a random state with the stationary distribution, from standard normal random numbers."""
        sums = np.add.outer(self.poles, self.poles)
        return jnp.sum(np.linalg.cholesky(1.0 / sums) * normals[None, :], axis=1)

    def transition(self, span: Scalar) -> tuple[Float[Array, "size size"], Float[Array, "size size"]]:
        """Return transition matrix and root of the noise covariance over a span (in units of L/V)."""
        poles = np.asarray(self.poles)
        sums = np.add.outer(poles, poles)
        added = -jnp.expm1(-sums * span) / sums
        return jnp.exp(-poles * span)[:, None] * np.eye(poles.size), _root(added, poles.size)

    def output(self, state: Float[Array, " size"]) -> Scalar:
        """Return the gust of a filter state, in units of the intensity."""
        return jnp.sum(np.asarray(self.residues, state.dtype) * state)


def _root(matrix: Float[Array, "n n"], count: int) -> Float[Array, "n n"]:
    """Return the Cholesky factor of a matrix of `count` rows; a pivot not above 0, by rounding, is made positive."""
    lower: list[list[Array]] = []
    for i in range(count):
        lower_row: list[Array] = []
        for j in range(i + 1):
            remainder = matrix[i, j] - sum(
                (a * b for a, b in zip(lower_row[:j], lower[j] if j < i else lower_row, strict=False)), 0.0
            )
            if i == j:
                lower_row.append(jnp.sqrt(jnp.maximum(remainder, 1e-60)))
            else:
                lower_row.append(remainder / lower[j][j])
        lower.append(lower_row)
    zero = jnp.zeros_like(matrix[0, 0])
    return jnp.stack([jnp.stack([*lower_row, *[zero] * (count - len(lower_row))]) for lower_row in lower])


_REPEATED = 1e-3
"""Greatest relative distance of poles that count as repeated: rounding separates a fourfold pole by 2e-4."""


def modal_filter(gain: float, numerator: tuple[float, ...], denominator: tuple[float, ...]) -> ModalFilter:
    """Build the filter with the transfer function `gain` * numerator(s) / denominator(s).

    The coefficients are in the order s^0, s^1, ... Raises ValueError if a pole is complex, not stable or repeated.
    """
    bottom = np.polynomial.Polynomial(denominator)
    roots = bottom.roots()
    distances = np.abs(np.subtract.outer(roots, roots)) + np.diag(np.full(len(roots), np.inf))
    if np.any(distances < _REPEATED * np.abs(roots)):
        raise ValueError(f"poles {roots}: a pole is repeated; expected distinct ones, each the pole of one mode")
    if np.any(np.abs(roots.imag) > 0.0) or np.any(roots.real >= 0.0):
        raise ValueError(f"poles {roots}: expected real ones, all negative")
    roots = np.sort(roots.real)[::-1]
    residues = np.polynomial.Polynomial(numerator)(roots) / bottom.deriv()(roots)
    poles = -roots
    return ModalFilter(tuple(map(float, poles)), tuple(map(float, gain * residues)))


VON_KARMAN_LONGITUDINAL = modal_filter(np.sqrt(2.0), (1.0, 0.25), (1.0, 1.357, 0.1987))
"""Shaping filter of von Karman's longitudinal gust.

Rational approximations: J. Yeager, *Implementation and Testing of Turbulence Models for the F18-HARV Simulation*,
NASA/CR-1998-206937, equations 16 and 17.
"""
VON_KARMAN_TRANSVERSE = modal_filter(1.0, (1.0, 2.7478, 0.3398), (1.0, 2.9958, 1.9754, 0.1539))
"""Shaping filter of von Karman's gusts perpendicular to the flight direction; source: see `VON_KARMAN_LONGITUDINAL`."""
DRYDEN_LONGITUDINAL, DRYDEN_TRANSVERSE = FirstOrderFilter(), DrydenTransverse()


def sampled_spectrum(shaping: AbstractShapingFilter, span: float, frequencies: Float[np.ndarray, " n"]) -> np.ndarray:
    """Compute the one-sided spectrum of a filter's output that is sampled at intervals of `span` (in units of L/V).

    `frequencies` are angular frequencies in units of V/L, at most pi / `span`. The integral of the spectrum over the
    angular frequency is the variance of the samples.
    """
    transition, noise_root = (np.asarray(matrix) for matrix in shaping.transition(jnp.asarray(span)))
    output_row = np.stack(
        [np.asarray(shaping.output(jnp.asarray(unit_state))) for unit_state in np.eye(transition.shape[0])]
    )
    eye = np.eye(transition.shape[0])
    response = np.stack(
        [output_row @ np.linalg.solve(eye - transition * np.exp(-1j * w * span), noise_root) for w in frequencies]
    )
    return span / np.pi * np.sum(np.abs(response) ** 2, axis=1)
