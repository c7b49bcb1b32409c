"""Statistics of sampled flights: confidence intervals, McNemar's exact test, rank correlations and Sobol indices."""

import math
from typing import NamedTuple

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


def mcnemar_exact(first_only: int, second_only: int) -> float:
    """Probability that pairs fall apart so unevenly, or more so, where neither way is better (two-sided).

    Of the pairs in which exactly one succeeded it is then a coin's toss which. Source: Q. McNemar, *Note on the
    sampling error of the difference between correlated proportions or percentages*, Psychometrika 12(2), 1947;
    exact, as a sign test: A. Agresti, *Categorical Data Analysis*, 3rd ed., section 11.1.2.

    Parameters
    ----------
    first_only, second_only
        Pairs in which the first alone succeeded, and the second alone.
    """
    if first_only + second_only == 0:
        return 1.0
    return float(stats.binomtest(first_only, first_only + second_only, 0.5).pvalue)


_LEAST = 4
"""Pairs without which there is no interval."""


def rank_correlation(inputs: np.ndarray, outputs: np.ndarray, confidence: float = 0.95) -> tuple[float, float, float]:
    """Spearman's rank correlation and an interval for it.

    Ranks alone count, so that an infinite output is simply the greatest. The interval is Fisher's, with the variance of
    D. G. Bonett, T. A. Wright, *Sample size requirements for estimating Pearson, Kendall and Spearman correlations*,
    Psychometrika 65(1), 2000: (1 + r²/2) / (n - 3).

    Parameters
    ----------
    inputs, outputs
        Pairs of numbers.
    confidence
        Nominal coverage, 0..1.

    Returns
    -------
    The correlation, lower and upper end, -1..1.

    Raises
    ------
    ValueError
        There are fewer than four pairs, or inputs or outputs are all alike.
    """
    if inputs.size < _LEAST:
        raise ValueError(f"arrived {inputs.size} pairs; expected {_LEAST} at least")
    ranks = [stats.rankdata(one) for one in (inputs, outputs)]
    if any(np.ptp(one) == 0.0 for one in ranks):
        raise ValueError("arrived numbers that are all alike; expected some that differ")
    found = float(np.clip(np.corrcoef(*ranks)[0, 1], -1.0, 1.0))
    half = float(stats.norm.ppf(0.5 + 0.5 * confidence)) * math.sqrt((1.0 + 0.5 * found**2) / (inputs.size - 3))
    middle = math.atanh(min(max(found, -1.0 + 1e-15), 1.0 - 1e-15))
    return found, math.tanh(middle - half), math.tanh(middle + half)


_RESAMPLES = 400
_RESAMPLING_SEED = 1


class SobolIndices(NamedTuple):
    """Parts of the variance, one for each input.

    Attributes
    ----------
    first, first_half
        Part due to the input alone, and half the width of its interval.
    total, total_half
        Part due to it in whatever combination, and half the width of its interval.
    """

    first: np.ndarray
    first_half_width: np.ndarray
    total: np.ndarray
    total_half_width: np.ndarray


def saltelli_points(inputs: int, count: int, seed: int) -> np.ndarray:
    """Points of the unit cube at which Sobol indices can be estimated: blocks of inputs + 2, one after the other.

    A block is a point A, for each input A with this input of B, and B; A and B together are a point of a scrambled
    Sobol sequence. Source: A. Saltelli et al., *Variance based sensitivity analysis of model output*, Computer Physics
    Communications 181(2), 2010, table 2, without what only second-order indices need; SALib draws them.

    Parameters
    ----------
    inputs, count
        How many inputs and blocks; of blocks a power of 2.
    seed
        Of the scrambling.

    Returns
    -------
    Shape (count * (inputs + 2), inputs).
    """
    from SALib.sample import sobol

    problem = _problem(inputs)
    return sobol.sample(problem, count, calc_second_order=False, seed=np.random.default_rng(seed))


def sobol_indices(outputs: np.ndarray, inputs: int, confidence: float = 0.95) -> SobolIndices:
    """Estimate first and total Sobol indices from outputs at `saltelli_points`, or at whole blocks of them.

    First ones by the estimator of Saltelli et al. (2010), total ones by Jansen's (table 2 there, b and f); what total
    means: T. Homma, A. Saltelli, *Importance measures in global sensitivity analysis of nonlinear models*, Reliability
    Engineering & System Safety 52(1), 1996. Intervals by resampling the blocks. SALib computes all of them.

    Parameters
    ----------
    outputs
        One for each point, in their order.
    inputs
        How many.
    confidence
        Of the intervals, 0..1.

    Raises
    ------
    ValueError
        There are fewer than two whole blocks or parts of one, an output is not finite, or all are alike.
    """
    from SALib.analyze import sobol

    outputs = np.asarray(outputs, dtype=float)
    block = inputs + 2
    if outputs.size < 2 * block or outputs.size % block:
        raise ValueError(f"arrived {outputs.size} outputs; expected blocks of {block}, two at least")
    if not np.isfinite(outputs).all():
        count = int(np.sum(~np.isfinite(outputs)))
        raise ValueError(f"arrived {count} outputs of {outputs.size} that are not finite; expected numbers")
    if np.ptp(outputs) <= 1e-12 * max(1.0, float(np.abs(outputs).max())):
        raise ValueError("arrived outputs that are all alike; expected some variance to share out")
    found = sobol.analyze(
        _problem(inputs),
        outputs,
        calc_second_order=False,
        num_resamples=_RESAMPLES,
        conf_level=confidence,
        seed=_RESAMPLING_SEED,
    )
    return SobolIndices(*(np.asarray(found[key]) for key in ("S1", "S1_conf", "ST", "ST_conf")))


def _problem(inputs: int) -> dict[str, object]:
    return {"num_vars": inputs, "names": [f"x{k}" for k in range(inputs)], "bounds": [[0.0, 1.0]] * inputs}
