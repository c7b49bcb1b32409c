"""Which candidates are looked at for each aircraft."""

from collections.abc import Sequence
from typing import NamedTuple

from anser.planning.certified.detours import DETOUR_KINDS

RACETRACK = DETOUR_KINDS
# How the airspeed is chosen. One change to a speed whose mean is: as preferred; such that the direct path takes the
# time. One change, to the least or the greatest; or such that the mean is halfway from there to the preferred one. Two
# changes: slow first, then fast; fast, then slow; as it is, then fast; as it is, then slow.
PREFERRED, MATCHED, SLOWEST, FASTEST, SLOWER, FASTER, SLOW_FAST, FAST_SLOW, LATE_FAST, LATE_SLOW = range(10)


class CandidateSet(NamedTuple):
    """The candidates to look at, as tables.

    Attributes
    ----------
    speeds, altitude_detours
        One row per profile: how the airspeed is chosen, and the detour in altitude, m.
    words, detour_kinds, sides
        One row per detour: rank of the direct path by its length, which kind (`RACETRACK` after the others), side.
    turn_leg_starts
        Turn-and-leg paths are looked for per profile from so many starts.
    kept
        Only so many of these candidates of an aircraft are kept, those with the least cost; None: all.
    widened
        Whether each detour is offered with wide turns too, see `anser.planning.certified.wide_turns`.
    rounds
        The fleet is placed so often at most: again as long as certificates turn candidates down, without these.
    spline_starts, splines_kept
        Splines of each aircraft beside these candidates: looked for from so many starts, so many of them kept.
    extra
        Candidates beside these for some aircraft only, those that find nothing among these; they take long.
    """

    speeds: tuple[int, ...]
    altitude_detours: tuple[float, ...]
    words: tuple[int, ...]
    detour_kinds: tuple[int, ...]
    sides: tuple[int, ...]
    turn_leg_starts: int = 0
    kept: int | None = None
    widened: bool = False
    rounds: int = 1
    spline_starts: int = 0
    splines_kept: int = 0
    extra: "CandidateSet | None" = None

    @property
    def size(self) -> int:
        """Number of detours and turn-and-leg paths."""
        return len(self.speeds) * (len(self.words) * (1 + self.widened) + self.turn_leg_starts)


def make_candidate_set(
    speeds: Sequence[int],
    altitude_detours: Sequence[float],
    words: Sequence[int],
    detour_kinds: Sequence[int],
    turn_leg_starts: int = 0,
    kept: int | None = None,
    widened: bool = False,
    rounds: int = 1,
    splines: tuple[int, int] = (0, 0),
) -> CandidateSet:
    """Every combination of profiles and detours, to both sides, with turn-and-leg paths and splines (starts, kept)."""
    profiles = [(speed, detour) for speed in speeds for detour in altitude_detours]
    ways = [(word, kind, side) for word in words for kind in detour_kinds for side in (1, -1)]
    speed_column, altitude_column = zip(*profiles, strict=True)
    word_column, kind_column, side_column = zip(*ways, strict=True)
    columns = (speed_column, altitude_column, word_column, kind_column, side_column)
    return CandidateSet(*columns, turn_leg_starts, kept, widened, rounds, *splines)


_EVERY_SPEED = tuple(range(10))
_TURN_LEG_PATHS = make_candidate_set(
    _EVERY_SPEED, (0.0, 300.0, -300.0, 600.0, -600.0), (0, 1), (0, 1, 2, 3, 4, RACETRACK), turn_leg_starts=40, kept=320
)
_SPLINES = make_candidate_set((PREFERRED,), (0.0,), (0,), (0,), splines=(48, 12))

MINIMAL = make_candidate_set((PREFERRED,), (0.0,), (0,), (0, 1, 2, 3, 4), widened=True)
STANDARD = make_candidate_set(
    (PREFERRED, MATCHED), (0.0, 300.0, -300.0), (0,), (0, 1, 2, 3, 4, RACETRACK), widened=True, rounds=4
)
WITH_TURN_LEG_PATHS = STANDARD._replace(rounds=8, extra=_TURN_LEG_PATHS)
"""And, for aircraft that need them, every speed, altitude and detour, and turn-and-leg paths."""
WITH_SPLINES = STANDARD._replace(rounds=8, extra=_SPLINES)
"""And, for aircraft that need them, splines."""
ALONE_STANDARD = make_candidate_set((PREFERRED, MATCHED, SLOWEST, FASTEST), (0.0,), (0, 1), (0, 1, 4, RACETRACK))
"""Candidates of an aircraft by itself: detours and speeds, no detour in altitude."""
ALONE_TURN_LEG_PATHS = make_candidate_set(_EVERY_SPEED, (0.0,), (0,), (0, 1), turn_leg_starts=24, kept=48)
ALONE_SPLINES = make_candidate_set((PREFERRED,), (0.0,), (0,), (0,), splines=(32, 4))
"""Before an aircraft is said to have no way at all."""
