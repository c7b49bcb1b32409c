"""What the modes of an aircraft are called, by the states that take part in them."""

from collections.abc import Sequence
from typing import NamedTuple

UNNAMED = "unnamed"
THIRD = "third oscillatory mode"

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


class Candidate(NamedTuple):
    """A mode to be named: whether it oscillates, the shares of the states, whether these can be relied on."""

    pair: bool
    shares: dict[str, float]
    sound: bool

    def share(self, family: str) -> float:
        """Share of the states of a family."""
        return sum(self.shares[state] for state in _FAMILIES[family])


def classical_names(modes: Sequence[Candidate]) -> list[str]:
    """Names of the modes of an aircraft by itself, fastest first; "unnamed" is what no name fits for certain.

    An oscillation whose states make up three quarters of it is the short period, phugoid, Dutch roll or lateral phugoid
    (roll and spiral merged). If short period and phugoid have merged, each of them half, it is the third oscillatory
    mode, and one real mode is left of each. A real mode of which one state makes up half is named
    for that: roll, spiral, engine, altitude, heading, or an actuator. Other real modes are what is left of an
    oscillation that has fallen apart, if its states make up half of them and the oscillation itself is not there; a
    speed mode, if it is.
    """
    names = [_pair_name(mode) if mode.pair else _lone_name(mode) for mode in modes]
    for family in _FALLING_APART:
        left = [k for k, mode in enumerate(modes) if names[k] == UNNAMED and _is_half(mode, family)]
        present = any(mode.pair and mode.share(family) > _OF_REAL and names[k] != THIRD for k, mode in enumerate(modes))
        if present:
            for k in left:
                names[k] = "speed" if modes[k].shares["V"] > _OF_REAL else UNNAMED
        elif len(left) == 1:
            names[left[0]] = f"{family} (real)"
        elif len(left) == 2 and (THIRD not in names or family == "Dutch roll"):
            names[left[0]], names[left[1]] = f"{family} (first real)", f"{family} (second real)"
    return [UNNAMED if name != UNNAMED and names.count(name) > 1 else name for name in names]


def state_names(modes: Sequence[Candidate]) -> list[str]:
    """Names of modes by the states that together make up more than half of each, three at most."""
    names = []
    for mode in modes:
        leading, total = [], 0.0
        for state, share in sorted(mode.shares.items(), key=lambda item: -item[1])[:3]:
            leading.append(state)
            total += share
            if total > _OF_REAL:
                break
        names.append(" and ".join(leading) if mode.sound else UNNAMED)
    return names


def _pair_name(mode: Candidate) -> str:
    if not mode.sound:
        return UNNAMED
    for family in _FAMILIES:
        if mode.share(family) > _OF_PAIR:
            return family
    for surface in _surfaces(mode):
        if mode.shares[surface] + mode.shares.get(f"{surface}{_OF_SPEED}", 0.0) > _OF_PAIR:
            return f"{surface} actuator"
    return THIRD if mode.share("short period") + mode.share("phugoid") > _OF_MERGED else UNNAMED


def _lone_name(mode: Candidate) -> str:
    for state, name in _LONE.items():
        if mode.sound and mode.shares.get(state, 0.0) > _OF_REAL:
            return name
    for surface in _surfaces(mode):
        if mode.sound and mode.shares[surface] > _OF_REAL:
            return f"{surface} actuator"
    return UNNAMED


def _surfaces(mode: Candidate) -> list[str]:
    return [state for state in mode.shares if state not in _OF_FLIGHT and not state.endswith(_OF_SPEED)]


def _is_half(mode: Candidate, family: str) -> bool:
    return mode.sound and not mode.pair and mode.share(family) > _OF_REAL
