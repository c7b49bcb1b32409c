"""Time coordination of a fleet: clocks by which the aircraft fly along their paths, coordinated by messages.

Each aircraft flies its path by its own clock gamma (s), at rate 1 without disturbances. The coordination law is

    gamma_dot_dot_i = -b (gamma_dot_i - 1) - (b c / n) sum_j (gamma_i - gamma_j) - k lag_i,

with the sum over the aircraft j heard by aircraft i, the number n of aircraft, and the delay lag_i behind the path, s.
In a complete network, the clocks agree at the rate c. Sources: E. Xargay, I. Kaminer, A. Pascoal, N. Hovakimyan et al.,
*Time-Critical Cooperative Path Following of Multiple Unmanned Aerial Vehicles over Time-Varying Networks*, J. Guidance
36 (2013) 499-516, doi 10.2514/1.56538; H. Kang, I. Kaminer, V. Cichella, N. Hovakimyan, *Coordinated Path Following of
UAVs over Time-Varying Digraphs Connected in an Integral Sense*, arXiv 2307.06553.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.shapes import Scalar, ScalarLike

SETTLED_LAG_S = 0.03
"""Lag behind the path, s, up to which the clock does not wait: the autopilot corrects it."""


class CoordinationGains(eqx.Module):
    """Gains and limits of the coordination law of the clocks, in the module's docstring."""

    coupling: Scalar  # c, 1/s: gain of the differences from the clocks of the neighbours
    damping: Scalar  # b, 1/s: gain of the deviation of the rate from 1
    waiting: Scalar  # k, 1/s^2: gain of the lag behind the path, for which the clock slows down
    rate_range: Scalar  # greatest deviation of a clock's rate from 1
    skew_max: Scalar  # greatest difference between two clocks, s


def clock_acceleration(
    # clock (s) and rate (1) of the aircraft
    clock: ScalarLike,
    rate: ScalarLike,
    # present estimates of the other clocks, s, and mask of the recently heard aircraft
    other_clocks: Float[Array, " others"],
    hears: Bool[Array, " others"],
    lag: ScalarLike,  # delay behind the path, s; negative: ahead
    count: ScalarLike,  # number of coordinated aircraft
    gains: CoordinationGains,
) -> Scalar:
    """Return the acceleration of one aircraft's clock, 1/s, by the coordination law.

    The magnitude of `lag` is reduced by `SETTLED_LAG_S`; a smaller lag counts as 0.
    """
    clock_difference = jnp.sum(jnp.where(hears, clock - other_clocks, 0.0))
    effective_lag = jnp.sign(lag) * jnp.maximum(jnp.abs(lag) - SETTLED_LAG_S, 0.0)
    coupling = gains.damping * gains.coupling / count
    return -gains.damping * (rate - 1.0) - coupling * clock_difference - gains.waiting * effective_lag


def bounded_rate(
    # rate by the law, and the clock, s
    rate: ScalarLike,
    clock: ScalarLike,
    # other clocks extrapolated at rate 1, s, and bound of the extrapolation error, s
    other_clocks: Float[Array, " others"],
    uncertainty: Float[Array, " others"],
    is_coordinated: Bool[Array, " others"],  # mask of the coordinated aircraft
    gains: CoordinationGains,  # only `rate_range` and `skew_max` are used
) -> Scalar:
    """Return the rate of a clock, limited to its range and such that no two clocks differ by more than `skew_max`.

    If the lead over another clock plus `uncertainty` reaches `skew_max`, the rate is at most 1. If the lag behind
    another clock plus `uncertainty` reaches `skew_max`, the rate is at least 1.
    """
    limited = jnp.clip(rate, 1.0 - gains.rate_range, 1.0 + gains.rate_range)
    lead_max = jnp.max(jnp.where(is_coordinated, clock - other_clocks + uncertainty, -jnp.inf))
    lag_max = jnp.max(jnp.where(is_coordinated, other_clocks - clock + uncertainty, -jnp.inf))
    limited = jnp.where((lead_max >= gains.skew_max) & (limited > 1.0), 1.0, limited)
    return jnp.where((lag_max >= gains.skew_max) & (limited < 1.0), 1.0, limited)


def quality_of_service(
    links: np.ndarray,  # links that are up, symmetric; shape (samples, n, n)
    period_s: float,  # time between two samples, s
    window_s: float,  # T, s
) -> np.ndarray:
    """Return the quality of service mu of a network in a window of duration T from each sample on, shape (windows,).

    mu is the greatest number with (1 / (n T)) integral of Q L Q^T dt >= mu I over the window, for n aircraft. L is the
    Laplacian of the links; the rows of Q are orthonormal, and orthogonal to (1, ..., 1). mu is 1 if the network is
    always complete, and 0 if the links in the window do not connect the fleet. Source: Xargay et al. (2013).

    Only complete windows count. T is limited to the duration of the record. The result for one aircraft is [1].
    """
    samples, count, _ = links.shape
    if count < 2:
        return np.ones(1)
    adjacency = links.astype(float) * (1.0 - np.eye(count))
    laplacians = adjacency.sum(axis=2)[:, :, None] * np.eye(count) - adjacency
    length = min(max(round(window_s / period_s), 1), samples)
    sums = np.concatenate([np.zeros((1, count, count)), np.cumsum(laplacians, axis=0)])
    means = (sums[length:] - sums[:-length]) / length
    # least eigenvalue apart from the 0 of (1, ..., 1)
    return np.maximum(np.linalg.eigvalsh(means)[:, 1], 0.0) / count


def guaranteed_rate(mu: float, coupling: float, window_s: float) -> float:
    """Return the guaranteed rate of convergence of clocks without range and skew limits, 1/s: c mu / (1 + c T)^2.

    The rate holds for gamma_dot = -(c / n) L gamma, with the coupling c (1/s), windows T (s), and mu, L and Q as in
    `quality_of_service`: |Q gamma| falls at least as exp(-rate t), over complete windows. Source: Xargay et al., after
    A. Loria, E. Panteley, *Uniform exponential stability of linear time-varying systems: revisited*, Systems & Control
    Letters 47 (2002) 13-24.
    """
    return coupling * mu / (1.0 + coupling * window_s) ** 2


def coordination_error(clocks: np.ndarray) -> np.ndarray:
    """Return the norm of the deviations of the clocks (..., n), s, from the mean of the n clocks; shape (...), s."""
    return np.linalg.norm(clocks - clocks.mean(axis=-1, keepdims=True), axis=-1)
