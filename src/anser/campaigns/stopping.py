"""When a campaign has flown enough: the interval of a named statistic is as narrow as asked for."""

from collections.abc import Mapping

import numpy as np

from anser.campaigns.study import Study
from anser.results import order_statistic_interval, wilson_interval

STATISTICS = ("met", "miss_m", "arrival_spread_s")


def enough(study: Study, done: np.ndarray, chunk: int, columns: Mapping[str, np.ndarray]) -> int | None:
    """How many of the first chunks are enough; None where the study does not say, or they are not yet.

    Looked at after each chunk in their order, whichever was complete first: so it does not depend on how many fly at a
    time. An interval that is looked at again and again covers somewhat less often than its confidence says.

    Parameters
    ----------
    study
        With its rule.
    done
        Whether each chunk is complete.
    chunk
        Flights of a chunk.
    columns
        Of each statistic, all flights in their order.
    """
    until = study.until
    if until is None:
        return None
    complete = done.size if done.all() else int(np.argmin(done))
    values = np.asarray(columns[until.statistic], dtype=float)
    if values.ndim > 1:
        values = np.max(values, axis=1)
    # one without a value is the worst
    values = np.where(np.isnan(values), np.inf, values)
    for count in range(1, complete + 1):
        flights = min(count * chunk, values.size)
        if flights < until.at_least:
            continue
        low, high = _interval(study, values[:flights])
        if high - low <= until.width:
            return count
    return None


def _interval(study: Study, values: np.ndarray) -> tuple[float, float]:
    assert study.until is not None
    if study.until.statistic == "met":
        return wilson_interval(int(np.sum(values)), values.size, study.answers.confidence)
    low, high = order_statistic_interval(values, study.until.share, study.answers.confidence)
    # both infinite: all that is known is that it is the worst
    return (low, high) if np.isfinite(low) else (-np.inf, np.inf)
