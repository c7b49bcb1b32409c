"""Modes of a linear model: participation factors, classical names, and comparison with ideal dynamic inversion."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

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
"""Classical oscillations, each with its family: the wind-axis states that mainly participate."""
_FALLING_APART = ("short period", "phugoid", "Dutch roll")
"""Oscillations that can split into two real modes."""
_LONE = {"P_w": "roll", "mu": "spiral", "power": "engine", "altitude": "altitude", "chi": "heading"}
"""Name of a real mode by the state with more than half of the participation; actuators are named separately."""
_OF_FLIGHT = {"V", "alpha", "beta", "mu", "gamma", "chi", "P_w", "Q", "R_w", "altitude", "power"}
_OF_SPEED = "_velocity"

_OF_PAIR = 0.75
_OF_REAL = 0.5
_OF_MERGED = 0.9
"""Least share of the participation that names an oscillation, a real mode, and merged oscillations.

In straight flight of the F-16 from 70 to 300 m/s and of a light aircraft, oscillations have at least 0.89, roll and
spiral at least 0.57, merged oscillations 0.99."""


class ModeCandidate(NamedTuple):
    """Mode before naming; `shares` (participations of the states, 0 to 1) have a meaning only if `is_reliable`."""

    is_oscillatory: bool
    shares: dict[str, float]
    is_reliable: bool

    def share(self, family: str) -> float:
        """Return the participation, 0 to 1, of all states of a family (a key of `_FAMILIES`) together."""
        return sum(self.shares[state] for state in _FAMILIES[family])


def classical_names(modes: Sequence[ModeCandidate]) -> list[str]:
    """Return names of the modes of an airframe without autopilot, "unnamed" if no name is certain or a name repeats.

    - Oscillation with over 75 % of the participation in one family of states: short period, phugoid, Dutch roll,
      lateral phugoid (merged roll and spiral), or an actuator mode.
    - Oscillation with over 90 % in the states of short period and phugoid together: third oscillatory mode.
    - Real mode with over 50 % in one state: roll, spiral, engine, altitude, heading, or an actuator mode.
    - Real mode with over 50 % in one family that has no oscillation: "short period (real)" and so on.
    - Real mode with over 50 % in V, next to an oscillating phugoid: "speed".
    """
    names = [_pair_name(mode) if mode.is_oscillatory else _lone_name(mode) for mode in modes]
    for family in _FALLING_APART:
        real_remnants = [k for k, mode in enumerate(modes) if names[k] == UNNAMED and _is_half(mode, family)]
        present = any(
            mode.is_oscillatory and mode.share(family) > _OF_REAL and names[k] != THIRD_OSCILLATION
            for k, mode in enumerate(modes)
        )
        if present:
            for k in real_remnants:
                names[k] = "speed" if modes[k].shares["V"] > _OF_REAL else UNNAMED
        elif len(real_remnants) == 1:
            names[real_remnants[0]] = f"{family} (real)"
        elif len(real_remnants) == 2 and (THIRD_OSCILLATION not in names or family == "Dutch roll"):
            names[real_remnants[0]], names[real_remnants[1]] = f"{family} (first real)", f"{family} (second real)"
    return [UNNAMED if name != UNNAMED and names.count(name) > 1 else name for name in names]


def state_names(modes: Sequence[ModeCandidate]) -> list[str]:
    """Return names of modes by their dominant states, at most three; "unnamed" if the participation is not reliable."""
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
"""Sum of a mode's participation-factor magnitudes (1 at best) above which the factors are not reliable.

The eigenvectors of nearly equal eigenvalues are then mixed."""
_ROUNDING = 1e-9
"""Fraction of the largest eigenvalue below which eigenvalues and imaginary parts count as 0, because of rounding."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """Mode of a linear model: a real eigenvalue (`order` 1) or a pair of conjugate eigenvalues (`order` 2)."""

    # airframe alone: classical name, or "unnamed" if the mode fits no family of states; closed loop: dominant states
    name: str
    # in continuous time, 1/s, imaginary part not negative; log(eigenvalue)/step for a sampled model
    eigenvalue: complex
    order: int  # 1: real eigenvalue, 2: conjugate pair
    # participation of each wind-axis state (see `wind_axis_states`), largest first: magnitude of the participation
    # factor (left times right eigenvector) divided by the sum of the magnitudes
    shares: tuple[tuple[str, float], ...]

    @property
    def eigenvalues(self) -> tuple[complex, ...]:
        """The real eigenvalue, or the two eigenvalues of the conjugate pair, 1/s."""
        return (self.eigenvalue,) if self.order == 1 else (self.eigenvalue, self.eigenvalue.conjugate())

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency, rad/s: the magnitude of the eigenvalue, also for a real mode."""
        return abs(self.eigenvalue)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio, -1 to 1; a real mode has 1 (stable), -1 (unstable) or 0 (eigenvalue 0)."""
        if math.isinf(self.eigenvalue.real):
            return 1.0
        return -self.eigenvalue.real / abs(self.eigenvalue) if self.eigenvalue else 0.0

    @property
    def time_constant(self) -> float:
        """Time in which the amplitude falls by the factor e, s; negative for a growing mode; inf if constant."""
        return -1 / self.eigenvalue.real if self.eigenvalue.real else math.inf

    @property
    def period(self) -> float:
        """Period of the oscillation, s; infinite for a real mode."""
        return 2 * math.pi / self.eigenvalue.imag if self.eigenvalue.imag else math.inf

    @property
    def time_to_half(self) -> float:
        """Time to half amplitude, s; for a growing mode, minus the time to double amplitude; inf if constant."""
        return math.log(2) * self.time_constant


def wind_axis_states(model: LinearModel) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names of the wind-axis states, and the matrix that converts a model's states to wind-axis states.

    Bank mu, path angle gamma and course chi replace roll, pitch and yaw. P_w and R_w, the rates about the velocity and
    about its normal in the plane of symmetry, replace P and R.
    """
    names, C = list(model.states), np.asarray(model.C)
    matrix = np.eye(len(names))
    for body_state, wind_state in (("phi", "mu"), ("theta", "gamma"), ("psi", "chi")):
        index = names.index(body_state)
        matrix[index] = C[model.outputs.index(wind_state)]
        names[index] = wind_state
    alpha = float(model.x[names.index("alpha")])
    P, R = names.index("P"), names.index("R")
    matrix[np.ix_([P, R], [P, R])] = [[math.cos(alpha), math.sin(alpha)], [-math.sin(alpha), math.cos(alpha)]]
    names[P], names[R] = "P_w", "R_w"
    return tuple(names), matrix


def modes_of(model: LinearModel) -> tuple[Mode, ...]:
    """Return the modes of a linear model, continuous or sampled, fastest first.

    Modes of a continuous model (airframe alone) have `classical_names`; modes of a sampled model (autopilot) have
    `state_names`. Raises ValueError if the reference condition is not regular (`is_regular`).
    """
    if not bool(model.regular):
        raise ValueError(
            "modes: the condition lies within 1 deg of the vertical or of 90 deg of sideslip; expected one away from it"
        )
    names, to_wind = wind_axis_states(model)
    step = float(model.step)
    in_wind_axes = to_wind @ np.asarray(model.A) @ np.linalg.inv(to_wind)
    eigenvalues, right = (np.asarray(array, dtype=complex) for array in np.linalg.eig(in_wind_axes))
    factors = np.linalg.pinv(right).T * right
    total = np.abs(factors).sum(axis=0)
    # Defective matrices: the factors do not sum to 1. Nearly defective matrices: large factors cancel.
    is_reliable = (np.abs(factors.sum(axis=0) - 1) < 1e-3) & (total < _ILL_CONDITIONED)
    largest = float(np.abs(eigenvalues).max())
    imaginary = np.where(np.abs(np.imag(eigenvalues)) > _ROUNDING * largest, np.imag(eigenvalues), 0.0)
    values = {
        k: _continuous(complex(eigenvalues[k].real, imaginary[k]), step, largest)
        for k in np.flatnonzero(imaginary >= 0)
    }
    fastest = max(abs(value) for value in values.values() if math.isfinite(value.real))
    values = {k: value if abs(value) > _ROUNDING * fastest else 0j for k, value in values.items()}
    order = sorted(values, key=lambda k: -abs(values[k]))
    shares = (np.abs(factors) / total).T.tolist()
    candidates = [
        ModeCandidate(bool(imaginary[k] > 0), dict(zip(names, shares[k], strict=True)), bool(is_reliable[k]))
        for k in order
    ]
    mode_names = state_names(candidates) if step else classical_names(candidates)
    modes = []
    for name, k, candidate in zip(mode_names, order, candidates, strict=True):
        ranked_shares = sorted(candidate.shares.items(), key=lambda share: -share[1])
        modes.append(Mode(name, values[k], 2 if candidate.is_oscillatory else 1, tuple(ranked_shares)))
    return tuple(modes)


def _continuous(value: complex, step: float, largest: float) -> complex:
    """Return an eigenvalue in continuous time, 1/s; the real part is -inf if the sampled mode vanishes within a step.

    `step` (s) is 0 for a continuous model. A sampled mode vanishes if the modulus of its eigenvalue is less than
    `_ROUNDING` times `largest`, the greatest modulus of all eigenvalues.
    """
    if not step:
        return value
    if abs(value) < _ROUNDING * largest:
        return complex(-math.inf, 0.0)
    return complex(math.log(abs(value)), math.atan2(value.imag, value.real)) / step


LIMIT_STEP_S = 0.0005
"""Sampling period of the limit of fast sampling, s."""
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
"""For each loop, the bandwidths (fields of `AutopilotGains`) that the theory of dynamic inversion takes as infinite."""


@dataclasses.dataclass(frozen=True)
class InversionPole:
    """Pole of a loop under dynamic inversion in three versions, 1/s in continuous time."""

    # pole of the error dynamics of perfect inversion (theory section 5): root of (1 + K_D) s^2 + K_P s + K_I, or of
    # (1 + K_D) s + K_P if K_I is 0
    ideal: complex
    # pole of the loop with a sampling period of 0.5 ms and with the high bandwidths `_LIMIT_BANDWIDTHS`
    limit_pole: complex
    # accepted |limit_pole - ideal|: |ideal|^2 T, where T is the sum of the sampling period 0.5 ms and of the time
    # constants 1 / bandwidth of the loop's `_LAGS`
    tolerance: float
    sampled_pole: complex  # pole of the loop with the flown sampling period and bandwidths


def inversion_poles(case: LoopCase, loop: Loop) -> tuple[InversionPole, ...]:
    """Return the poles of a loop's three channels: ideal, in the limit of fast sampling and filters, and as flown.

    The trim point of `case` must be a straight flight; with fast sampling, the sideslip of a turn drives the engine to
    a limit. Each ideal pole is matched with the nearest pole of the loop that has no match yet; channels with equal
    poles cannot be told apart.
    """

    def poles(loop_case: LoopCase) -> list[complex]:
        model = linearize_loop(loop_case, loop)
        # The low-pass filters on the deflections, 2 1/s as published, happen to lie among the attitude loop's poles.
        modes = [mode for mode in modes_of(model) if not mode.shares[0][0].endswith("_slow")]
        return [value for mode in modes for value in mode.eigenvalues]

    gains = case.gains
    limit = dataclasses.replace(case, gains=_limit(gains, loop), step=LIMIT_STEP_S)
    flown, limiting = poles(case), poles(limit)
    lag = LIMIT_STEP_S + sum(1 / _LIMIT_BANDWIDTHS[name] for name in _LAGS[loop])
    matches = []
    for ideal in [pole for k in range(len(CHANNELS[loop])) for pole in _ideal(gains, loop, k)]:
        limit_pole = limiting.pop(int(np.argmin(np.abs(np.array(limiting) - ideal))))
        sampled_pole = flown.pop(int(np.argmin(np.abs(np.array(flown) - ideal))))
        matches.append(InversionPole(ideal, limit_pole, abs(ideal) ** 2 * lag, sampled_pole))
    return tuple(matches)


def _ideal(gains: AutopilotGains, loop: Loop, channel: int) -> list[complex]:
    loop_gains = getattr(gains, loop)
    K_D, K_P, K_I = (float(getattr(loop_gains, term)[channel]) for term in ("derivative", "proportional", "integral"))
    return [complex(root) for root in np.roots([1.0 + K_D, K_P, K_I] if K_I else [1.0 + K_D, K_P])]


def _limit(gains: AutopilotGains, loop: Loop) -> AutopilotGains:
    bandwidths = dict(_LIMIT_BANDWIDTHS)
    if loop == "attitude":
        # Fast enough to lie beyond the matched poles. In the velocity loop this bandwidth would be unstable, see
        # `OnboardModel`.
        bandwidths["surface_bandwidth"] = 50.0
    return dataclasses.replace(gains, **{name: jnp.asarray(v, dtype=float) for name, v in bandwidths.items()})
