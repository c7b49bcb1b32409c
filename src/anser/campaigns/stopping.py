"""When a campaign has flown enough: the interval of a named statistic is as narrow as asked for."""

import numpy as np

from anser.campaigns.study import Study
from anser.results import order_statistic_interval, wilson_interval


def enough(study: Study, done: np.ndarray, chunk: int, values: np.ndarray, since: int = 0) -> int | None:
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
    values
        Of the rule's statistic, one for each flight; infinite where it is infinitely bad.
    since
        Chunks of which it is known that they are not enough.
    """
    until = study.until
    if until is None:
        return None
    for count in range(since + 1, complete_from_first(done) + 1):
        flights = min(count * chunk, values.size)
        if flights < until.at_least:
            continue
        low, high = _interval(study, values[:flights])
        if high - low <= until.width:
            return count
    return None


def complete_from_first(done: np.ndarray) -> int:
    """How many chunks are complete without one missing before them."""
    return done.size if done.all() else int(np.argmin(done))


def _interval(study: Study, values: np.ndarray) -> tuple[float, float]:
    assert study.until is not None
    if study.until.statistic == "met":
        return wilson_interval(int(np.sum(values)), values.size, study.answers.confidence)
    low, high = order_statistic_interval(values, study.until.share, study.answers.confidence)
    # both infinite: all that is known is that it is the worst
    return (low, high) if np.isfinite(low) else (-np.inf, np.inf)
