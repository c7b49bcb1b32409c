"""Intervals for what a campaign estimates: exact or with a coverage that is known."""

import math

import numpy as np
from scipy import stats


def wilson_interval(successes: int, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval for a probability, from how many of some independent flights succeeded.

    Source: E. B. Wilson, *Probable inference, the law of succession, and statistical inference*, J. American
    Statistical Association 22(158), 1927; recommended by L. D. Brown, T. T. Cai, A. DasGupta, *Interval estimation for
    a binomial proportion*, Statistical Science 16(2), 2001.

    Parameters
    ----------
    successes, count
        Of `count` flights; of none nothing is known: 0 to 1.
    confidence
        Nominal coverage, 0..1.

    Returns
    -------
    Lower and upper end, 0..1.

    Raises
    ------
    ValueError
        There are more successes than flights.
    """
    if not 0 <= successes <= count:
        raise ValueError(f"arrived {successes} successes of {count} flights; expected 0 to {count}")
    if count == 0:
        return 0.0, 1.0
    z2 = float(stats.norm.ppf(0.5 + 0.5 * confidence)) ** 2
    share = successes / count
    middle = (share + z2 / (2 * count)) / (1.0 + z2 / count)
    half = math.sqrt(z2) / (1.0 + z2 / count) * math.sqrt(share * (1.0 - share) / count + z2 / (4.0 * count**2))
    # none and all are certain to belong to it; rounding must not exclude them
    low = 0.0 if successes == 0 else max(middle - half, 0.0)
    high = 1.0 if successes == count else min(middle + half, 1.0)
    return low, high


def log_interval(estimates: np.ndarray, confidence: float = 0.95) -> tuple[float, float, float]:
    """Mean of independent estimates of one positive quantity, and its interval: Student's of their logarithms.

    Parameters
    ----------
    estimates
        Two at least, above 0, of about the same precision.
    confidence
        Nominal coverage, 0..1.

    Returns
    -------
    Geometric mean, lower and upper end.

    Raises
    ------
    ValueError
        There are fewer than two, or one is not above 0.
    """
    if estimates.size < 2 or not np.all(estimates > 0.0):
        raise ValueError(f"arrived {estimates.tolist()}; expected two positive numbers at least")
    logs = np.log(estimates)
    half = stats.t.ppf(0.5 + 0.5 * confidence, logs.size - 1) * np.std(logs, ddof=1) / math.sqrt(logs.size)
    middle = float(np.mean(logs))
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def order_statistic_interval(values: np.ndarray, share: float, confidence: float = 0.95) -> tuple[float, float]:
    """Interval for a quantile of whatever distribution: between two of the values.

    The number of values below the quantile is binomial; each end is left out with half of what the confidence leaves,
    at most. Source: H. A. David, H. N. Nagaraja, *Order Statistics*, 3rd ed., section 7.1.

    Parameters
    ----------
    values
        Independent ones; infinite where there is none (a flight that failed), so that it counts as the worst.
    share
        Which quantile, 0..1: 0.95 for the one that 95 % of the flights stay below.
    confidence
        Coverage at least, 0..1.

    Returns
    -------
    Lower and upper end; -inf or inf where so few values do not tell.

    Raises
    ------
    ValueError
        A value is NaN.
    """
    ordered = np.sort(np.asarray(values, dtype=float))
    if np.isnan(ordered).any():
        raise ValueError("arrived NaN among the values; expected infinity where a flight has none")
    count, beyond = ordered.size, 0.5 * (1.0 - confidence)
    below = stats.binom(count, share)
    # the k-th least is above the quantile where fewer than k are below it
    low = int(below.ppf(beyond))  # the greatest k with P(fewer than k below) <= beyond
    high = int(below.isf(beyond)) + 1  # the least k with P(k or more below) <= beyond
    return (
        -math.inf if low < 1 else float(ordered[low - 1]),
        math.inf if high > count else float(ordered[high - 1]),
    )


def quantile(values: np.ndarray, share: float) -> float:
    """The value that a share of all stay at or below: an order statistic, so that infinite ones are allowed."""
    ordered = np.sort(np.asarray(values, dtype=float))
    return float(ordered[max(math.ceil(share * ordered.size) - 1, 0)])
