"""Variables of a campaign's flights over time, as quantile bands: what the page draws of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from anser.report.campaign_numbers import plain


@dataclass(frozen=True)
class SeriesBands:
    """One variable over time: of each aircraft the quantiles over the flights.

    Attributes
    ----------
    name, words, unit
        Of the variable.
    times_s
        Shape (times,).
    aircraft
        Names of those that are drawn.
    quantiles
        At 5, 50 and 95 % of the flights; shape (3, aircraft, times); NaN where no flight has a number.
    """

    name: str
    words: str
    unit: str
    times_s: np.ndarray
    aircraft: tuple[str, ...]
    quantiles: np.ndarray


def series_data(bands: "tuple[SeriesBands, ...]") -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {
            "name": one.name,
            "words": one.words,
            "unit": one.unit,
            "time": plain(one.times_s),
            "aircraft": [
                {
                    "name": name,
                    **{end: plain(one.quantiles[q, k]) for q, end in enumerate(("low", "middle", "high"))},
                }
                for k, name in enumerate(one.aircraft)
            ],
        }
        for one in bands
    ]
