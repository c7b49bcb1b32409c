"""What a robustness study disperses, by how much, and the cases that it flies."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from anser.aircraft import F16_COEFFICIENTS, F16Dispersion

DELAY_MAX_S = 0.2
"""Longest delay of the sensors that is flown."""

_BOTH_WAYS = tuple(sign * part for part in (0.1, 0.2, 0.3, 0.4, 0.6, 0.9) for sign in (-1.0, 1.0))


@dataclasses.dataclass(frozen=True)
class Factor:
    """One number that is dispersed: `nominal` + `scale` * change.

    A change is relative: at a spread of 20 % it is uniform in -0.2 to 0.2, or in 0 to 0.2 where it goes one way only.

    Attributes
    ----------
    name, meaning, unit
        Of the number.
    nominal, scale
        Value without a change, and what a change of 1 adds.
    one_way
        Whether only positive changes have a meaning.
    alone
        Changes that are flown with every other number nominal.
    """

    name: str
    meaning: str
    unit: str = "1"
    nominal: float = 1.0
    scale: float = 1.0
    one_way: bool = False
    alone: tuple[float, ...] = _BOTH_WAYS


FACTORS = (
    *(Factor(name, f"factor on {name}") for name in F16_COEFFICIENTS),
    Factor("thrust", "factor on thrust"),
    Factor("mass", "factor on mass"),
    *(Factor(f"second_moment_{axis}", f"factor on the second moment of mass along body {axis}") for axis in "xyz"),
    Factor("actuator_bandwidth", "factor on the bandwidth of all actuators"),
    # a fifth of the chord for 100 %: at 20 % the c.g. moves by 4 % of the chord either way
    Factor("cg_shift", "shift of the centre of gravity aft, part of the mean chord", nominal=0.0, scale=0.2),
    # a tenth of a second for 100 %: at 20 % up to 20 ms, two periods of the autopilot
    Factor(
        "sensor_delay",
        "delay of all that is sensed",
        "s",
        nominal=0.0,
        scale=0.1,
        one_way=True,
        alone=(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0),
    ),
)
"""All numbers that are dispersed, each on its own."""

_INDEX = {factor.name: k for k, factor in enumerate(FACTORS)}

SPREADS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Spreads of the sweep."""

PARTS = ("dispersed", "spread", "alone")
"""Parts of a study: all numbers dispersed at one spread; the same at several; one number changed, the others not."""


@dataclasses.dataclass(frozen=True)
class FlightPoint:
    """Steady level flight that the commands leave: true airspeed (m/s) and geometric altitude (m)."""

    speed_m_s: float
    altitude_m: float


CONDITIONS = (
    FlightPoint(150.0, 1000.0),
    FlightPoint(120.0, 1000.0),
    FlightPoint(220.0, 3000.0),
    FlightPoint(200.0, 6000.0),
    FlightPoint(230.0, 9000.0),
)
"""Points spread over the speeds that the autopilot flies, each with a tenth of thrust and surfaces left: from
equivalent airspeeds of 114 m/s (alpha 10 deg) to 190 m/s (alpha 3 deg)."""


@dataclasses.dataclass(frozen=True)
class Cases:
    """Flights of a study, one row each.

    Attributes
    ----------
    part
        Index into `PARTS`, shape (n,).
    condition
        Index of the point that is left, shape (n,).
    spread
        Greatest change, shape (n,); for the part "alone", the change that is flown.
    alone
        Index into `FACTORS` of the only number that is changed, -1 where all are, shape (n,).
    changes
        Of each of `FACTORS`, shape (n, factors).
    """

    part: np.ndarray
    condition: np.ndarray
    spread: np.ndarray
    alone: np.ndarray
    changes: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """Values of all numbers, shape (n, factors)."""
        nominal, scale = (np.array([getattr(f, name) for f in FACTORS]) for name in ("nominal", "scale"))
        return nominal + scale * self.changes

    def __add__(self, other: "Cases") -> "Cases":
        fields = [f.name for f in dataclasses.fields(self)]
        return Cases(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in fields))


def dispersed_cases(flights: int, spread: float, seed: int, conditions: int = len(CONDITIONS)) -> Cases:
    """All numbers at random, uniform and independent, spread evenly over the conditions."""
    return _at_random(0, flights, spread, seed, conditions)


def spread_cases(flights: int, seed: int, conditions: int = len(CONDITIONS), spreads: tuple = SPREADS) -> Cases:
    """As many flights at each of several spreads: the same draws, scaled, so that only the spread makes a difference.

    The draws are others than those of `dispersed_cases` with that seed.
    """
    all_spreads = [_at_random(1, flights, spread, seed, conditions) for spread in spreads]
    return sum(all_spreads[1:], all_spreads[0])


def alone_cases(conditions: int = len(CONDITIONS), factors: tuple[str, ...] | None = None) -> Cases:
    """Each number changed with all others nominal, by each of its changes, at each condition."""
    chosen = [f.name for f in FACTORS] if factors is None else factors
    rows = [
        (_INDEX[name], change, condition)
        for name in chosen
        for change in FACTORS[_INDEX[name]].alone
        for condition in range(conditions)
    ]
    factor, change, condition = (np.array(column) for column in zip(*rows, strict=True))
    changes = np.zeros((len(rows), len(FACTORS)))
    changes[np.arange(len(rows)), factor] = change
    return Cases(np.full(len(rows), 2), condition, change, factor, changes)


def dispersion_of(values: np.ndarray) -> tuple[F16Dispersion, jnp.ndarray]:
    """Dispersions of the airframe, and delays of its sensors (s), from rows of values of `FACTORS`."""
    of = jnp.asarray(values, dtype=float)

    def one(name: str) -> jnp.ndarray:
        return of[:, _INDEX[name]]

    dispersion = F16Dispersion(
        coefficients=jnp.stack([one(name) for name in F16_COEFFICIENTS], axis=1),
        thrust=one("thrust"),
        mass=one("mass"),
        second_moments=jnp.stack([one(f"second_moment_{axis}") for axis in "xyz"], axis=1),
        actuator_bandwidth=one("actuator_bandwidth"),
        cg_shift=one("cg_shift"),
    )
    return dispersion, one("sensor_delay")


def _at_random(part: int, flights: int, spread: float, seed: int, conditions: int) -> Cases:
    draws = np.random.default_rng((seed, part)).uniform(-1.0, 1.0, (flights, len(FACTORS)))
    one_way = np.array([factor.one_way for factor in FACTORS])
    draws = np.where(one_way, np.abs(draws), draws)
    return Cases(
        part=np.full(flights, part),
        condition=np.arange(flights) % conditions,
        spread=np.full(flights, spread),
        alone=np.full(flights, -1),
        changes=spread * draws,
    )
