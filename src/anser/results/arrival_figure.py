"""The one number that says how well the arrivals of a flight fit, by what its scenario asks of them."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from anser.scenario import Scenario

_Row = Mapping[str, Any]
_MILLISECONDS_BELOW_S = 0.0995


@dataclass(frozen=True)
class ArrivalFigure:
    """How well arrivals fit.

    Attributes
    ----------
    kind
        "spread": of those that arrive at one time, from the first to the last; "spacing": of a sequence, the greatest
        difference of the time between two arrivals from that asked for; "error": of one aircraft alone, or of times
        and windows of their own, the greatest difference of an arrival from its planned time.
    value_s
        The number, s; None where an arrival is lacking.
    asked_s
        Time between two arrivals of a sequence, s; else None.
    """

    kind: Literal["spread", "spacing", "error"]
    value_s: float | None
    asked_s: float | None = None

    def words(self, aircraft: int) -> str:
        """Say it in a few words for so many aircraft; empty where there is no number."""
        if self.value_s is None:
            return ""
        value = duration_words(self.value_s)
        if self.kind == "spread":
            return f"arrival spread {value}"
        if self.kind == "spacing":
            return f"arrivals {self.asked_s:g} s apart, spacing error {value}"
        return f"arrival {value} off its planned time" if aircraft == 1 else f"arrivals {value} off their times at most"


def duration_words(seconds: float) -> str:
    """Say a short time: in milliseconds where that reads better."""
    return f"{1000 * seconds:.2g} ms" if seconds < _MILLISECONDS_BELOW_S else f"{seconds:.2f} s"


def planned_arrivals(aircraft: int, first_s: float, last_s: float) -> str:
    """Say when so many aircraft are planned to arrive, in the words of a heading."""
    first, last = f"{first_s:.2f}", f"{last_s:.2f}"
    if first != last:
        return f"arrivals from {first} to {last} s"
    return f"arrives at {last} s" if aircraft == 1 else f"all arrive at {last} s"


def arrivals_of(scenario: Scenario, aircraft: Sequence[_Row]) -> dict[str, Any]:
    """What a summary says of the arrivals as a whole, from its rows of the aircraft; who left the fleet counts not."""
    staying = [row for row in aircraft if "left_s" not in row]
    arrivals = [row["arrival_s"] for row in staying]
    rule, spacing_s = scenario.arrival.rule, scenario.arrival.spacing_s
    known = bool(staying) and None not in (*arrivals, *(row["planned_arrival_s"] for row in staying))
    found: dict[str, Any] = {
        "rule": rule,
        "common": scenario.arrival.is_common,
        "error_max_s": max(abs(row["arrival_s"] - row["planned_arrival_s"]) for row in staying) if known else None,
    }
    if rule == "sequence" and spacing_s is not None:
        ordered = sorted(arrivals) if known else []
        gaps = [later - earlier for earlier, later in itertools.pairwise(ordered)]
        worst = max((abs(gap - spacing_s) for gap in gaps), default=None)
        found |= {"spacing_s": spacing_s, "spacing_error_max_s": worst}
    return found


def arrival_figure(summary: Mapping[str, Any]) -> ArrivalFigure:
    """Find the number in a summary; in one that does not say what was asked, all arrive at one time."""
    asked = summary.get("arrival") or {"common": True, "error_max_s": None}
    if len(summary["aircraft"]) > 1 and asked["common"]:
        return ArrivalFigure("spread", summary["fleet"]["arrival_spread_s"])
    if len(summary["aircraft"]) > 1 and "spacing_s" in asked:
        return ArrivalFigure("spacing", asked["spacing_error_max_s"], asked["spacing_s"])
    return ArrivalFigure("error", asked["error_max_s"])
