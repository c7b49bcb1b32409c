"""Which candidates are looked at for each aircraft."""

from collections.abc import Sequence
from typing import NamedTuple

from anser.planning.certified.detours import SHAPES

RACETRACK = SHAPES
# How the airspeed is chosen. One change to a speed whose mean is: as preferred; such that the direct path takes the
# time. One change, to the least or the greatest; or such that the mean is halfway from there to the preferred one. Two
# changes: slow first, then fast; fast, then slow; as it is, then fast; as it is, then slow.
PREFERRED, MATCHED, SLOWEST, FASTEST, SLOWER, FASTER, SLOW_FAST, FAST_SLOW, LATE_FAST, LATE_SLOW = range(10)


class Choices(NamedTuple):
    """The candidates to look at, as tables.

    Attributes
    ----------
    speeds, heights
        One row per profile: how the airspeed is chosen, and the detour in altitude, m.
    words, shapes, sides
        One row per shape: rank of the direct path by its length, which detour (`RACETRACK` after the others), side.
    starts
        Free shapes looked for per profile: from so many starts each.
    most
        Only so many candidates of an aircraft are kept, those with the least cost; None: all.
    rounds
        The fleet is placed so often at most: again as long as certificates turn candidates down, without these.
    motions, motions_kept
        Free motions of each aircraft beside the candidates: looked for from so many starts, so many of them kept.
    beyond
        Candidates beside these for some aircraft only, those that find nothing among these; they take long.
    """

    speeds: tuple[int, ...]
    heights: tuple[float, ...]
    words: tuple[int, ...]
    shapes: tuple[int, ...]
    sides: tuple[int, ...]
    starts: int = 0
    most: int | None = None
    rounds: int = 1
    motions: int = 0
    motions_kept: int = 0
    beyond: "Choices | None" = None

    @property
    def size(self) -> int:
        """Number of candidates."""
        return len(self.speeds) * (len(self.words) + self.starts)


def make_choices(
    speeds: Sequence[int],
    heights: Sequence[float],
    words: Sequence[int],
    shapes: Sequence[int],
    starts: int = 0,
    most: int | None = None,
    rounds: int = 1,
    motions: tuple[int, int] = (0, 0),
) -> Choices:
    """Every combination of them, to both sides, and free shapes."""
    profiles = [(speed, height) for speed in speeds for height in heights]
    ways = [(word, shape, side) for word in words for shape in shapes for side in (1, -1)]
    return Choices(
        tuple(p[0] for p in profiles),
        tuple(p[1] for p in profiles),
        tuple(w[0] for w in ways),
        tuple(w[1] for w in ways),
        tuple(w[2] for w in ways),
        starts,
        most,
        rounds,
        *motions,
    )


FEW = make_choices((PREFERRED,), (0.0,), (0,), (0, 1, 2, 3, 4))
MANY = make_choices((PREFERRED, MATCHED), (0.0, 300.0, -300.0), (0,), (0, 1, 2, 3, 4, RACETRACK), rounds=4)
_EVERY_SPEED = tuple(range(10))
_SHAPES = make_choices(
    _EVERY_SPEED, (0.0, 300.0, -300.0, 600.0, -600.0), (0, 1), (0, 1, 2, 3, 4, RACETRACK), starts=40, most=320
)
_MOTIONS = make_choices((PREFERRED,), (0.0,), (0,), (0,), motions=(48, 12))
ALL = MANY._replace(rounds=8, beyond=_SHAPES)
"""And, for aircraft that need them, every speed, altitude and shape, free shapes among them."""
EVERY = MANY._replace(rounds=8, beyond=_MOTIONS)
"""And, for aircraft that need them, motions in which nothing is prescribed."""
PLAIN = make_choices((PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0,), (0, 1), (0, 1, 4, RACETRACK))
"""Candidates of an aircraft by itself: ways round and speeds, no detour in altitude."""
ALONE = make_choices(_EVERY_SPEED, (0.0,), (0,), (0, 1), starts=24, most=48)
DEEP = make_choices((PREFERRED,), (0.0,), (0,), (0,), motions=(32, 4))
"""Before an aircraft is said to have no way at all."""
