"""Where the loops' poles lie, and where the theory of dynamic inversion puts them."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.control import AutopilotGains
from anser.simulation.linearize_sampled import CHANNELS, linearize_loop
from anser.simulation.modes import modes_of
from anser.simulation.response import Loop, LoopCase

LIMIT_STEP_S = 0.0005
_LIMIT_BANDWIDTHS = {
    "actuator_bandwidth": 400.0,
    "surfaces_command_bandwidth": 1000.0,
    "rates_command_bandwidth": 200.0,
    "attitude_command_bandwidth": 100.0,
    "engine_bandwidth": 100.0,
}
_LAGS: dict[Loop, tuple[str, ...]] = {
    "rates": ("actuator_bandwidth", "surfaces_command_bandwidth"),
    "attitude": ("actuator_bandwidth", "surfaces_command_bandwidth", "rates_command_bandwidth"),
    "velocity": tuple(_LIMIT_BANDWIDTHS),
}
"""Bandwidths that theory takes as infinite, by the loop in which they act."""


@dataclasses.dataclass(frozen=True)
class InversionPole:
    """One pole of one loop, 1/s.

    Attributes
    ----------
    ideal
        Root of (1 + K_D) s^2 + K_P s + K_I: the error dynamics that inversion leaves if it is perfect (theory section
        5); of (1 + K_D) s + K_P where K_I is 0.
    in_the_limit
        Pole of the loop with a sampling period of 0.5 ms and with command filters, actuator and engine inversion 10 to
        70 times as fast as the published ones.
    tolerance
        Of `in_the_limit`: the lags that are left, T in sum (sampling period and 1/bandwidths), move a pole s by about
        s^2 T.
    as_flown
        Pole of the loop with its own sampling period and bandwidths.
    """

    ideal: complex
    in_the_limit: complex
    tolerance: float
    as_flown: complex


def inversion_poles(case: LoopCase, loop: Loop) -> tuple[InversionPole, ...]:
    """Poles of a loop's three channels: in theory, in the limit in which theory holds, and as flown.

    Each ideal pole, channel by channel, is given the nearest pole of the linearized loop that no other has; which of
    equal channels it is, the poles do not tell. Arguments are those of `linearize_loop`; the flight must be straight:
    in a turn the velocity loop asks for a sideslip of 0 where trim has a little, and with the bandwidths of the limit
    that difference alone drives the engine to its own.
    """

    def poles(of: LoopCase) -> list[complex]:
        model = linearize_loop(of, loop)
        # The low-pass filters on the deflections, 2 1/s as published, lie among the attitude loop's poles by chance.
        found = [mode for mode in modes_of(model) if not mode.shares[0][0].endswith("_slow")]
        return [value for mode in found for value in mode.eigenvalues]

    gains = case.gains
    limit = dataclasses.replace(case, gains=_limit(gains, loop), step=LIMIT_STEP_S)
    flown, limiting = poles(case), poles(limit)
    lag = LIMIT_STEP_S + sum(1 / _LIMIT_BANDWIDTHS[name] for name in _LAGS[loop])
    found = []
    for ideal in [pole for k in range(len(CHANNELS[loop])) for pole in _ideal(gains, loop, k)]:
        reached = limiting.pop(int(np.argmin(np.abs(np.array(limiting) - ideal))))
        now = flown.pop(int(np.argmin(np.abs(np.array(flown) - ideal))))
        found.append(InversionPole(ideal, reached, abs(ideal) ** 2 * lag, now))
    return tuple(found)


def _ideal(gains: AutopilotGains, loop: Loop, channel: int) -> list[complex]:
    own = getattr(gains, loop)
    inertia, damping, stiffness = (
        1.0 + float(own.derivative[channel]),
        float(own.proportional[channel]),
        float(own.integral[channel]),
    )
    coefficients = [inertia, damping, stiffness] if stiffness else [inertia, damping]
    return [complex(root) for root in np.roots(coefficients)]


def _limit(gains: AutopilotGains, loop: Loop) -> AutopilotGains:
    names, values = zip(*_LIMIT_BANDWIDTHS.items(), strict=True)
    fast = eqx.tree_at(
        lambda g: [getattr(g, name) for name in names], gains, [jnp.asarray(v, dtype=float) for v in values]
    )
    if loop == "attitude":
        # So fast that it does not lie among the poles looked for. The velocity loop would go unstable, see
        # `OnboardModel`.
        fast = eqx.tree_at(lambda g: g.surface_bandwidth, fast, jnp.asarray(50.0, dtype=float))
    return fast
