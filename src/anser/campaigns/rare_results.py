"""What came of a rare event: its document, the curve of probability against threshold, and its worst flights."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from anser.campaigns.rare_flights import RareFlights
from anser.campaigns.rare_store import RareStore, provenance
from anser.campaigns.subset import Repetition, SubsetEstimate, estimate
from anser.results import finite_or_none
from anser.results.flight_columns import OF_AIRCRAFT, OF_FLEET

_WORST = 10
_THRESHOLDS = 121
"""Points of the curve."""


class WorstPoint(NamedTuple):
    """A flight of the last level: its value, more is worse, its number, and its point."""

    value: float
    number: int
    point: np.ndarray


def worst_points(repetitions: Sequence[Repetition]) -> list[WorstPoint]:
    """The worst flights of the last levels, each once, ten at most."""
    found: dict[int, WorstPoint] = {}
    for one in repetitions:
        for value, number, point in zip(one[-1].values, one[-1].numbers, one[-1].points, strict=True):
            found[int(number)] = WorstPoint(float(value), int(number), point)
    return sorted(found.values(), key=lambda worst: (-worst.value, worst.number))[:_WORST]


def rare_document(
    store: RareStore, flights: RareFlights, repetitions: Sequence[Repetition], found: SubsetEstimate
) -> dict[str, Any]:
    """All that is told of a rare event, for JSON; None in the place of what is not finite."""
    rare, plan = flights.asked, flights.plan

    def quantity(value: float) -> float | None:
        return finite_or_none(flights.signed(value))

    levels = []
    for k in range(max(map(len, repetitions))):
        some = [one[k] for one in repetitions if len(one) > k]
        levels.append(
            {
                "flights": len(some) * (plan.points if k == 0 else plan.points - plan.chains),
                "bounds": [quantity(one.bound) for one in some],
                "shares": [one.share for one in some],
                "acceptances": [finite_or_none(one.acceptance) for one in some],
            }
        )
    last = np.concatenate([one[-1].values for one in repetitions])
    return {
        **provenance(store.study, store.scenario),
        "study": store.study.name,
        "scenario": store.scenario.name,
        "statistic": rare.statistic,
        "threshold": rare.threshold,
        "breached": "below" if rare.breached_below else "above",
        "probability": found.probability,
        "low": found.low,
        "high": found.high,
        "confidence": store.study.answers.confidence,
        "repetitions": plan.repetitions,
        "flights": sum(level["flights"] for level in levels),
        "failed_share_of_last_level": float(np.mean(np.isinf(last))),
        "levels": levels,
        "worst": [
            {
                "flight": one.number,
                rare.statistic: quantity(one.value),
                "flights": one.point["flights"][: one.point["count"]].tolist(),
                "weights": one.point["weights"][: one.point["count"]].tolist(),
            }
            for one in worst_points(repetitions)
        ],
    }


def exceedance_dataset(flights: RareFlights, repetitions: Sequence[Repetition]) -> xr.Dataset:
    """Probability that a threshold is breached against the threshold, with its interval, from a half down."""
    rare, confidence = flights.asked, flights.study.answers.confidence
    first = np.concatenate([one[0].values for one in repetitions])
    last = min(flights.threshold, *(one[-1].bound for one in repetitions if len(one) > 1), np.inf)
    reached = estimate(repetitions, flights.threshold, confidence).probability is not None
    end = flights.threshold if reached else float(np.nextafter(last, -np.inf))
    # a threshold that half of the flights breach, or a median that is none, is a curve of one point
    middle = float(np.median(first))
    values = np.linspace(middle if middle < end else end, end, _THRESHOLDS)
    found = [estimate(repetitions, value, confidence) for value in values]
    unit, words = (OF_AIRCRAFT | OF_FLEET)[rare.statistic]
    side = "below" if rare.breached_below else "above"
    return xr.Dataset(
        {
            key: ("threshold", [np.nan if getattr(one, key) is None else getattr(one, key) for one in found])
            for key in ("probability", "low", "high")
        },
        {"threshold": ("threshold", flights.signed(1.0) * values, {"units": unit, "long_name": words})},
        {
            "title": flights.study.name,
            "statistic": rare.statistic,
            "asked": rare.threshold,
            "breached": side,
            "confidence": confidence,
            "reached": int(reached),
            "bounds": [flights.signed(level.bound) for one in repetitions for level in one[1:]],
        },
    )
