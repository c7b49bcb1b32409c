"""Ratios of bandwidths between nested loops, to check gains; plain numbers, without JAX."""

import math
from collections.abc import Sequence
from typing import NamedTuple

PUBLISHED_ACTUATOR_BANDWIDTH = 40.0
"""Bandwidth of the actuators with inverted lag in the published gains, 1/s."""
PUBLISHED_ENGINE_BANDWIDTH = 5.0
"""Bandwidth of the engine with inverted lag in the published gains, 1/s."""
LOOP_SEPARATION_MIN = 2.0
"""Least acceptable ratio of an inner loop's bandwidth to its outer loop's: the least ratio among the published gains.

Two nested first-order loops form a pole pair with damping sqrt(ratio)/2, 0.71 at a ratio of 2; lower ratios oscillate.
"""


class LoopSeparation(NamedTuple):
    """Channel of an outer loop, commanded channel of an inner loop, and the bandwidths of both channels, 1/s."""

    outer: str
    inner: str
    outer_bandwidth: float
    inner_bandwidth: float

    @property
    def ratio(self) -> float:
        """Ratio of inner to outer bandwidth; infinite if the outer loop is open (bandwidth 0)."""
        return self.inner_bandwidth / self.outer_bandwidth if self.outer_bandwidth > 0.0 else math.inf


def loop_separations(
    rates: Sequence[float],  # bandwidths of (P, Q, R), 1/s
    attitude: Sequence[float],  # bandwidths of (mu, alpha, beta), 1/s
    velocity: Sequence[float],  # bandwidths of (V, gamma, chi), 1/s
    # bandwidths of the actuators and of the engine, 1/s
    actuators: float = PUBLISHED_ACTUATOR_BANDWIDTH,
    engine: float = PUBLISHED_ENGINE_BANDWIDTH,
) -> tuple[LoopSeparation, ...]:
    """Return the nine pairs of a channel and the inner channel that it commands, with their bandwidths."""
    return (
        LoopSeparation("V", "engine", velocity[0], engine),
        LoopSeparation("gamma", "alpha", velocity[1], attitude[1]),
        LoopSeparation("chi", "mu", velocity[2], attitude[0]),
        LoopSeparation("mu", "P", attitude[0], rates[0]),
        LoopSeparation("alpha", "Q", attitude[1], rates[1]),
        LoopSeparation("beta", "R", attitude[2], rates[2]),
        *(LoopSeparation(name, "surfaces", rates[axis], actuators) for axis, name in enumerate("PQR")),
    )
