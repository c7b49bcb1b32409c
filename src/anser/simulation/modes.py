"""Modes of a linear model: how fast and how well damped each is, which states take part, and what it is called."""

import dataclasses
import math

import numpy as np

from anser.simulation.linearize_open import LinearModel
from anser.simulation.mode_names import Candidate, classical_names, state_names

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
        found.append((value, Candidate(bool(imaginary[k] > 0), shares, bool(sound[k]))))
    fastest = max(abs(value) for value, _ in found if math.isfinite(value.real))
    found = [(value if abs(value) > _ROUNDING * fastest else 0j, candidate) for value, candidate in found]
    found.sort(key=lambda mode: -abs(mode[0]))
    candidates = [candidate for _, candidate in found]
    called = state_names(candidates) if step else classical_names(candidates)
    return tuple(
        Mode(name, value, 2 if of.pair else 1, tuple(sorted(of.shares.items(), key=lambda share: -share[1])))
        for name, (value, of) in zip(called, found, strict=True)
    )


def _continuous(value: complex, step: float, largest: float) -> complex:
    """Continuous-time eigenvalue, 1/s; minus infinity for a sampled one of 0, which is gone after one step."""
    if not step:
        return value
    if abs(value) < _ROUNDING * largest:
        return complex(-math.inf, 0.0)
    return complex(math.log(abs(value)), math.atan2(value.imag, value.real)) / step
