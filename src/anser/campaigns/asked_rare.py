"""Table [rare] of a study: the event whose probability is looked for, and how much is flown for it."""

from typing import Literal

from pydantic import Field

from anser.scenario.errors import Problem, plain
from anser.scenario.schema_base import Table, choice, expects, number

FLIGHTS_MAX = 100_000
"""Of a level: what its walks have come to takes about 1.5 kB of memory for each."""
STATISTICS = ("separation_min_m", "clearance_min_m", "miss_m", "arrival_spread_s")
BREACHED_BELOW = ("separation_min_m", "clearance_min_m")
"""Of the others the event is above the threshold."""
_CHAINS = 10
"""Of each level of one repetition at least; the coverage of the interval was measured down to there."""
_WHOLE = 1e-9


class Rare(Table):
    """An event that happens in few flights."""

    statistic: Literal["separation_min_m", "clearance_min_m", "miss_m", "arrival_spread_s"] = choice(
        "whose breach is the event; of the aircraft of a fleet the worst counts", STATISTICS
    )
    threshold: float = number("beyond which it is one", 0, 1e9, "m or s")
    flights: int = Field(
        2000,
        ge=1,
        le=FLIGHTS_MAX,
        description="of each level, in all repetitions together",
        json_schema_extra=expects(f"a whole number from 1 to {FLIGHTS_MAX}"),
    )
    level_share: float = number("of the flights of a level, the worst, from which the next begins", 0.05, 0.5, "", 0.1)
    levels_max: int = Field(
        10,
        ge=2,
        le=20,
        description="levels at most; the share to the power of them is about the least probability that can be found",
        json_schema_extra=expects("a whole number from 2 to 20"),
    )
    repetitions: int = Field(
        5,
        ge=3,
        le=100,
        description="that are independent of each other; from how they differ comes the interval",
        json_schema_extra=expects("a whole number from 3 to 100"),
    )

    @property
    def breached_below(self) -> bool:
        """Whether the event is a value below the threshold."""
        return self.statistic in BREACHED_BELOW

    @property
    def moves(self) -> int:
        """One over the share of a level."""
        return round(1.0 / self.level_share)

    def own_problems(self) -> list[Problem]:
        """Find shares and numbers of flights that do not divide."""
        if abs(self.moves * self.level_share - 1.0) > _WHOLE:
            return [Problem("level_share", plain(self.level_share), "one over a whole number, such as 0.1 or 0.2")]
        part = self.repetitions * self.moves
        if self.flights % part or self.flights < _CHAINS * part:
            words = f"a multiple of {part} (repetitions over level_share), {_CHAINS * part} at least"
            return [Problem("flights", str(self.flights), words)]
        return []
