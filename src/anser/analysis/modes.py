"""Modes of a linear model, with participation factors and classical names.

And the poles of the autopilot's loops beside those of ideal dynamic inversion.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.analysis.linearization import CHANNELS, LinearModel, linearize_loop
from anser.control.gains import AutopilotGains
from anser.control.inversion_autopilot import Loop
from anser.simulation.response import LoopCase

UNNAMED = "unnamed"
THIRD_OSCILLATION = "third oscillatory mode"

_FAMILIES = {
    "short period": ("alpha", "Q"),
    "phugoid": ("V", "gamma", "altitude"),
    "Dutch roll": ("beta", "R_w"),
    "lateral phugoid": ("mu", "P_w"),
}
"""Oscillations and the states, of wind axes, that make up each."""
_FALLING_APART = ("short period", "phugoid", "Dutch roll")
"""Those that may fall apart into two real modes."""
_LONE = {"P_w": "roll", "mu": "spiral", "power": "engine", "altitude": "altitude", "chi": "heading"}
"""Real modes that are named for one state; a state that is none of flight or engine is an actuator's."""
_OF_FLIGHT = {"V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power"}
_OF_SPEED = "_velocity"

_OF_PAIR = 0.75
_OF_REAL = 0.5
_OF_MERGED = 0.9
"""Least shares of its states for an oscillation, for a real mode, and for the merger of two oscillations.

In straight flight of the F-16 from 70 to 300 m/s and of a light aircraft the oscillations have 0.89 or more, roll and
spiral 0.57 (at 17 deg of angle of attack) or more; mergers have 0.99.
"""


class ModeCandidate(NamedTuple):
    """A mode to be named: whether it oscillates, the shares of the states, whether these can be relied on."""

    is_oscillatory: bool
    shares: dict[str, float]
    is_reliable: bool

    def share(self, family: str) -> float:
        """Share of the states of a family."""
        return sum(self.shares[state] for state in _FAMILIES[family])


def classical_names(modes: Sequence[ModeCandidate]) -> list[str]:
    """Names of the modes of an aircraft by itself, fastest first; "unnamed" is what no name fits for certain.

    An oscillation whose states make up three quarters of it is the short period, phugoid, Dutch roll or lateral phugoid
    (roll and spiral merged). If short period and phugoid have merged, each of them half, it is the third oscillatory
    mode, and one real mode is left of each. A real mode of which one state makes up half is named
    for that: roll, spiral, engine, altitude, heading, or an actuator. Other real modes are what is left of an
    oscillation that has fallen apart, if its states make up half of them and the oscillation itself is not there; a
    speed mode, if it is.
    """
    names = [_pair_name(mode) if mode.is_oscillatory else _lone_name(mode) for mode in modes]
    for family in _FALLING_APART:
        left = [k for k, mode in enumerate(modes) if names[k] == UNNAMED and _is_half(mode, family)]
        present = any(
            mode.is_oscillatory and mode.share(family) > _OF_REAL and names[k] != THIRD_OSCILLATION
            for k, mode in enumerate(modes)
        )
        if present:
            for k in left:
                names[k] = "speed" if modes[k].shares["V"] > _OF_REAL else UNNAMED
        elif len(left) == 1:
            names[left[0]] = f"{family} (real)"
        elif len(left) == 2 and (THIRD_OSCILLATION not in names or family == "Dutch roll"):
            names[left[0]], names[left[1]] = f"{family} (first real)", f"{family} (second real)"
    return [UNNAMED if name != UNNAMED and names.count(name) > 1 else name for name in names]


def state_names(modes: Sequence[ModeCandidate]) -> list[str]:
    """Names of modes by the states that together make up more than half of each, three at most."""
    names = []
    for mode in modes:
        leading, total = [], 0.0
        for state, share in sorted(mode.shares.items(), key=lambda item: -item[1])[:3]:
            leading.append(state)
            total += share
            if total > _OF_REAL:
                break
        names.append(" and ".join(leading) if mode.is_reliable else UNNAMED)
    return names


def _pair_name(mode: ModeCandidate) -> str:
    if not mode.is_reliable:
        return UNNAMED
    for family in _FAMILIES:
        if mode.share(family) > _OF_PAIR:
            return family
    for surface in _surfaces(mode):
        if mode.shares[surface] + mode.shares.get(f"{surface}{_OF_SPEED}", 0.0) > _OF_PAIR:
            return f"{surface} actuator"
    return THIRD_OSCILLATION if mode.share("short period") + mode.share("phugoid") > _OF_MERGED else UNNAMED


def _lone_name(mode: ModeCandidate) -> str:
    for state, name in _LONE.items():
        if mode.is_reliable and mode.shares.get(state, 0.0) > _OF_REAL:
            return name
    for surface in _surfaces(mode):
        if mode.is_reliable and mode.shares[surface] > _OF_REAL:
            return f"{surface} actuator"
    return UNNAMED


def _surfaces(mode: ModeCandidate) -> list[str]:
    return [state for state in mode.shares if state not in _OF_FLIGHT and not state.endswith(_OF_SPEED)]


def _is_half(mode: ModeCandidate, family: str) -> bool:
    return mode.is_reliable and not mode.is_oscillatory and mode.share(family) > _OF_REAL


_ILL_CONDITIONED = 1e4
"""Sum of the sizes of a mode's participation factors, 1 at best, beyond which equal eigenvalues mix their vectors."""
_ROUNDING = 1e-9
"""Size over that of the largest eigenvalue below which one, or its imaginary part, is 0: rounding splits equal ones."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """One mode: a real eigenvalue or a conjugate pair.

    Attributes
    ----------
    name
        Of an aircraft by itself the classical name, or "unnamed" where no one family of states makes up the mode. Under
        an autopilot the states that make up most of it.
    eigenvalue
        In continuous time, 1/s, imaginary part not negative; log(eigenvalue)/step of a sampled model.
    order
        1 or 2: real or a pair.
    shares
        What part each state has in it: size of its participation factor (left times right eigenvector) over the sum of
        all, largest first. States are those of wind axes: `wind_axis_states`.
    """

    name: str
    eigenvalue: complex
    order: int
    shares: tuple[tuple[str, float], ...]

    @property
    def eigenvalues(self) -> tuple[complex, ...]:
        """The eigenvalue, or both of the pair, 1/s."""
        return (self.eigenvalue,) if self.order == 1 else (self.eigenvalue, self.eigenvalue.conjugate())

    @property
    def natural_frequency(self) -> float:
        """Of the undamped oscillation, rad/s; of a real mode the size of the eigenvalue."""
        return abs(self.eigenvalue)

    @property
    def damping_ratio(self) -> float:
        """1 for a stable and -1 for an unstable real mode; 0 for an eigenvalue of 0."""
        if math.isinf(self.eigenvalue.real):
            return 1.0
        return -self.eigenvalue.real / abs(self.eigenvalue) if self.eigenvalue else 0.0

    @property
    def time_constant(self) -> float:
        """Time in which the envelope falls by the factor e, s; negative if it grows, infinite if it stays."""
        return -1 / self.eigenvalue.real if self.eigenvalue.real else math.inf

    @property
    def period(self) -> float:
        """Of the oscillation, s; infinite if there is none."""
        return 2 * math.pi / self.eigenvalue.imag if self.eigenvalue.imag else math.inf

    @property
    def time_to_half(self) -> float:
        """Time in which the envelope halves, s; negative: minus the time in which it doubles."""
        return math.log(2) * self.time_constant


def wind_axis_states(model: LinearModel) -> tuple[tuple[str, ...], np.ndarray]:
    """States in which modes show best, and the matrix that takes the model's own states to them.

    Bank, path angle and course stand in for roll, pitch and yaw, and P_w, R_w (rates about the velocity and about the
    normal to it, in the plane of symmetry) for P and R: at a high angle of attack the nose turns in a roll, and pitch
    holds both path angle and angle of attack.
    """
    names, C = list(model.states), np.asarray(model.C)
    matrix = np.eye(len(names))
    for old, new in (("phi", "mu"), ("theta", "gamma"), ("psi", "chi")):
        at = names.index(old)
        matrix[at] = C[model.outputs.index(new)]
        names[at] = new
    alpha = float(model.x[names.index("alpha")])
    P, R = names.index("P"), names.index("R")
    matrix[np.ix_([P, R], [P, R])] = [[math.cos(alpha), math.sin(alpha)], [-math.sin(alpha), math.cos(alpha)]]
    names[P], names[R] = "P_w", "R_w"
    return tuple(names), matrix


def modes_of(model: LinearModel) -> tuple[Mode, ...]:
    """Modes of a linear model, continuous or sampled, fastest first.

    An aircraft by itself gets the classical names (see `classical_names`), one under its autopilot the names of the
    states that make up most of each mode.

    Raises
    ------
    ValueError
        The coordinates are not regular at the model's condition.
    """
    if not bool(model.regular):
        raise ValueError(
            "modes: the condition lies within 1 deg of the vertical or of 90 deg of sideslip; expected one away from it"
        )
    names, to_wind = wind_axis_states(model)
    step = float(model.step)
    in_wind_axes = to_wind @ np.asarray(model.A) @ np.linalg.inv(to_wind)
    eigenvalues, right = (np.asarray(found, dtype=complex) for found in np.linalg.eig(in_wind_axes))
    factors = np.linalg.pinv(right).T * right
    total = np.abs(factors).sum(axis=0)
    # Of a defective matrix the factors do not sum to 1, of a nearly defective one they are large and cancel.
    sound = (np.abs(factors.sum(axis=0) - 1) < 1e-3) & (total < _ILL_CONDITIONED)
    largest = float(np.abs(eigenvalues).max())
    imaginary = np.where(np.abs(np.imag(eigenvalues)) > _ROUNDING * largest, np.imag(eigenvalues), 0.0)
    found = []
    for k in np.flatnonzero(imaginary >= 0):
        value = _continuous(complex(eigenvalues[k].real, imaginary[k]), step, largest)
        shares = dict(zip(names, (np.abs(factors[:, k]) / total[k]).tolist(), strict=True))
        found.append((value, ModeCandidate(bool(imaginary[k] > 0), shares, bool(sound[k]))))
    fastest = max(abs(value) for value, _ in found if math.isfinite(value.real))
    found = [(value if abs(value) > _ROUNDING * fastest else 0j, candidate) for value, candidate in found]
    found.sort(key=lambda mode: -abs(mode[0]))
    candidates = [candidate for _, candidate in found]
    called = state_names(candidates) if step else classical_names(candidates)
    return tuple(
        Mode(name, value, 2 if of.is_oscillatory else 1, tuple(sorted(of.shares.items(), key=lambda share: -share[1])))
        for name, (value, of) in zip(called, found, strict=True)
    )


def _continuous(value: complex, step: float, largest: float) -> complex:
    """Continuous-time eigenvalue, 1/s; minus infinity for a sampled one of 0, which is gone after one step."""
    if not step:
        return value
    if abs(value) < _ROUNDING * largest:
        return complex(-math.inf, 0.0)
    return complex(math.log(abs(value)), math.atan2(value.imag, value.real)) / step


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
        Of `limit_pole`: the lags that are left, T in sum (sampling period and 1/bandwidths), move a pole s by about
        s^2 T.
    as_flown
        Pole of the loop with its own sampling period and bandwidths.
    """

    ideal: complex
    limit_pole: complex
    tolerance: float
    sampled_pole: complex


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
