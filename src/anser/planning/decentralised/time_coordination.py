"""Time coordination: clocks along the paths of a fleet, kept together by what the aircraft tell each other.

Each aircraft flies its path by a clock of its own, gamma, whose rate is 1 as long as nothing keeps it up. The clocks
are coordinated by

    gamma_dot_dot_i = -b (gamma_dot_i - 1) - (b c / n) sum_j (gamma_i - gamma_j) - k lag_i,

the sum over those that aircraft i hears from; lag_i is by how much it is behind its path, s. Sources: E. Xargay,
I. Kaminer, A. Pascoal, N. Hovakimyan et al., *Time-Critical Cooperative Path Following of Multiple Unmanned Aerial
Vehicles over Time-Varying Networks*, J. Guidance 36 (2013) 499-516, doi 10.2514/1.56538; H. Kang, I. Kaminer,
V. Cichella, N. Hovakimyan, *Coordinated Path Following of UAVs over Time-Varying Digraphs Connected in an Integral
Sense*, arXiv 2307.06553. The gain is divided by the number of aircraft: c is how fast a complete network agrees.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from anser.shapes import Scalar, ScalarLike

SETTLED_LAG_S = 0.03
"""A lag behind the path up to this, s, is left to the autopilot: the clock does not wait for it."""


class CoordinationGains(eqx.Module):
    """Numbers of the law.

    Attributes
    ----------
    coupling
        c: how fast clocks agree in a complete network, 1/s.
    damping
        b: how fast a clock's rate returns to 1, 1/s.
    waiting
        k: of the lag behind the path, 1/s^2.
    rate_range
        By how much the rate of a clock may differ from 1.
    skew_max
        By how much the clocks of two aircraft may differ, s.
    """

    coupling: Scalar
    damping: Scalar
    waiting: Scalar
    rate_range: Scalar
    skew_max: Scalar


def clock_acceleration(
    clock: ScalarLike,
    rate: ScalarLike,
    heard: Float[Array, " others"],
    hears: Bool[Array, " others"],
    lag: ScalarLike,
    count: ScalarLike,
    gains: CoordinationGains,
) -> Scalar:
    """Second derivative of one aircraft's clock, 1/s.

    Parameters
    ----------
    clock, rate
        Its own, s and 1.
    heard, hears
        Clocks of the others as it takes them to be now, s, and of which it has heard lately.
    lag
        By how much it is behind its path, s; negative: ahead.
    count
        Number of aircraft that coordinate.
    gains
        Of the law.
    """
    apart = jnp.sum(jnp.where(hears, clock - heard, 0.0))
    settled = jnp.sign(lag) * jnp.maximum(jnp.abs(lag) - SETTLED_LAG_S, 0.0)
    coupling = gains.damping * gains.coupling / count
    return -gains.damping * (rate - 1.0) - coupling * apart - gains.waiting * settled


def bounded_rate(
    rate: ScalarLike,
    clock: ScalarLike,
    heard: Float[Array, " others"],
    doubt: Float[Array, " others"],
    counted: Bool[Array, " others"],
    gains: CoordinationGains,
) -> Scalar:
    """The rate of a clock within its range, and such that no two clocks ever differ by more than the greatest skew.

    A clock moves away from another one only as long as the other, wherever it may be by now, is nearer than that: the
    other may have moved by `doubt` since it was heard of, and keeps the same rule. Without word for long the doubt
    alone is as much as that, and the rate is 1.

    Parameters
    ----------
    rate, clock
        As the law has it, and the clock, s.
    heard, doubt
        Clocks of the others carried on at the rate 1, s, and by how much they may be off, s.
    counted
        Which of the others coordinate at all.
    gains
        `rate_range` and `skew_max` count.
    """
    limited = jnp.clip(rate, 1.0 - gains.rate_range, 1.0 + gains.rate_range)
    ahead = jnp.max(jnp.where(counted, clock - heard + doubt, -jnp.inf))
    behind = jnp.max(jnp.where(counted, heard - clock + doubt, -jnp.inf))
    limited = jnp.where((ahead >= gains.skew_max) & (limited > 1.0), 1.0, limited)
    return jnp.where((behind >= gains.skew_max) & (limited < 1.0), 1.0, limited)


def quality_of_service(links: np.ndarray, period_s: float, window_s: float) -> np.ndarray:
    """Quality of service of a network over time: mu of (1 / (n T)) integral of Q L Q^T dt >= mu I over a window T.

    L is the Laplacian of the links, and the rows of Q are orthonormal and orthogonal to (1, ..., 1): mu is 1 where all
    hear all at all times, and 0 where over the whole window the network falls into parts. Source: Xargay et al. (2013).

    Parameters
    ----------
    links
        Which links are up, symmetric; shape (samples, n, n).
    period_s
        Between two samples.
    window_s
        T.

    Returns
    -------
    mu of the window that begins at each sample, shape (windows,): only whole windows, at least one.
    """
    samples, count, _ = links.shape
    if count < 2:
        return np.ones(1)
    adjacency = links.astype(float) * (1.0 - np.eye(count))
    laplacians = adjacency.sum(axis=2)[:, :, None] * np.eye(count) - adjacency
    length = min(max(round(window_s / period_s), 1), samples)
    sums = np.concatenate([np.zeros((1, count, count)), np.cumsum(laplacians, axis=0)])
    means = (sums[length:] - sums[:-length]) / length
    # the least eigenvalue but that of (1, ..., 1), which is 0
    return np.maximum(np.linalg.eigvalsh(means)[:, 1], 0.0) / count


def guaranteed_rate(mu: float, coupling: float, window_s: float) -> float:
    """Rate of convergence that is promised for clocks without range and skew limits, 1/s: c mu / (1 + c T)^2.

    For gamma_dot = -(c / n) L gamma and the quality of service mu over windows T, |Q gamma| falls at least as
    exp(-rate t), over whole windows. Source: Xargay et al. (2013), after A. Loria, E. Panteley, *Uniform exponential
    stability of linear time-varying systems: revisited*, Systems & Control Letters 47 (2002) 13-24.
    """
    return coupling * mu / (1.0 + coupling * window_s) ** 2


def coordination_error(clocks: np.ndarray) -> np.ndarray:
    """Size of Q gamma, s: how far clocks (..., n) are from being the same."""
    return np.linalg.norm(clocks - clocks.mean(axis=-1, keepdims=True), axis=-1)
