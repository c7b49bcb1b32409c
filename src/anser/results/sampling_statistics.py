"""Statistics of sampled flights: confidence intervals, McNemar's exact test, rank correlations and Sobol indices."""

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy import stats


def wilson_interval(
    # numbers of successes and of flights; without flights the interval is 0 to 1
    successes: int,
    count: int,
    confidence: float = 0.95,  # nominal coverage, 0..1
) -> tuple[float, float]:
    """Return Wilson's confidence interval (low, high) of a probability of success, from independent flights.

    Raises ValueError if there are more successes than flights.

    Source: E. B. Wilson, *Probable inference, the law of succession, and statistical inference*, J. American
    Statistical Association 22(158), 1927; recommended by L. D. Brown, T. T. Cai, A. DasGupta, *Interval estimation for
    a binomial proportion*, Statistical Science 16(2), 2001.
    """
    if not 0 <= successes <= count:
        raise ValueError(f"arrived {successes} successes of {count} flights; expected 0 to {count}")
    if count == 0:
        return 0.0, 1.0
    z2 = float(stats.norm.ppf(0.5 + 0.5 * confidence)) ** 2
    share = successes / count
    middle = (share + z2 / (2 * count)) / (1.0 + z2 / count)
    half = math.sqrt(z2) / (1.0 + z2 / count) * math.sqrt(share * (1.0 - share) / count + z2 / (4.0 * count**2))
    # exact bounds for no and only successes, which rounding must not exclude
    low = 0.0 if successes == 0 else max(middle - half, 0.0)
    high = 1.0 if successes == count else min(middle + half, 1.0)
    return low, high


def log_interval(
    estimates: np.ndarray,  # two or more positive estimates of similar precision
    confidence: float = 0.95,  # nominal coverage, 0..1
) -> tuple[float, float, float]:
    """Return geometric mean, lower and upper confidence bound of independent positive estimates.

    The interval is Student's for the mean of the logarithms. Raises ValueError if there are fewer than two estimates,
    or an estimate is not positive.
    """
    if estimates.size < 2 or not np.all(estimates > 0.0):
        raise ValueError(f"arrived {estimates.tolist()}; expected two positive numbers at least")
    logs = np.log(estimates)
    half = stats.t.ppf(0.5 + 0.5 * confidence, logs.size - 1) * np.std(logs, ddof=1) / math.sqrt(logs.size)
    middle = float(np.mean(logs))
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def order_statistic_interval(
    # independent values; infinite for a missing value (a failed flight), which then counts as the worst
    values: np.ndarray,
    share: float,  # probability of the quantile, 0..1: 0.95 for the value that 95 % of the flights stay below
    confidence: float = 0.95,  # least coverage, 0..1
) -> tuple[float, float]:
    """Return a confidence interval (low, high) of a quantile, valid for any distribution: two of the sorted values.

    The quantile lies beyond a bound with a probability of at most (1 - confidence) / 2. A bound is infinite if the
    values are too few. Raises ValueError if a value is NaN. Source: H. A. David, H. N. Nagaraja, *Order Statistics*,
    3rd ed., section 7.1; the number of values below the quantile is binomial.
    """
    ordered = np.sort(np.asarray(values, dtype=float))
    if np.isnan(ordered).any():
        raise ValueError("arrived NaN among the values; expected infinity where a flight has none")
    low, high = _bounding_ranks(ordered.size, share, confidence)
    return (
        -math.inf if low < 1 else float(ordered[low - 1]),
        math.inf if high > ordered.size else float(ordered[high - 1]),
    )


@functools.lru_cache(maxsize=1024)
def _bounding_ranks(count: int, share: float, confidence: float) -> tuple[int, int]:
    """Return the ranks, from 1, of the two sorted values that bound the confidence interval of the quantile `share`.

    Rank 0 or `count` + 1 means that no value bounds the interval on this side.
    """
    count_below, tail = stats.binom(count, share), 0.5 * (1.0 - confidence)
    # the k-th smallest value is above the quantile if fewer than k values are below the quantile
    low = int(count_below.ppf(tail))  # the greatest k with P(fewer than k below) <= tail
    high = int(count_below.isf(tail)) + 1  # the least k with P(k or more below) <= tail
    return low, high


def quantile(values: np.ndarray, share: float) -> float:
    """Return the least value with a fraction `share` or more of the values at or below it; values may be infinite."""
    ordered = np.sort(np.asarray(values, dtype=float))
    rank = math.ceil(round(share * ordered.size, 6))  # 0.55 x 100 is 55.00000000000001
    return float(ordered[max(rank - 1, 0)])


def mcnemar_exact(first_only: int, second_only: int) -> float:
    """Return the two-sided p-value of McNemar's exact test, which compares the success of two variants of a flight.

    A pair is a flight of each variant. `first_only` and `second_only` are the numbers of pairs in which only the first
    or only the second variant succeeded. Null hypothesis: equal probabilities. If both numbers are 0, p is 1.

    Source: Q. McNemar, *Note on the sampling error of the difference between correlated proportions or percentages*,
    Psychometrika 12(2), 1947; exact, as a sign test: A. Agresti, *Categorical Data Analysis*, 3rd ed., section 11.1.2.
    """
    if first_only + second_only == 0:
        return 1.0
    return float(stats.binomtest(first_only, first_only + second_only, 0.5).pvalue)


_PAIRS_MIN = 4
"""Least number of pairs for which a confidence interval of the rank correlation is computed."""


def rank_correlation(inputs: np.ndarray, outputs: np.ndarray, confidence: float = 0.95) -> tuple[float, float, float]:
    """Return Spearman's rank correlation of inputs and outputs, -1..1, with lower and upper confidence bound.

    Values may be infinite. `confidence` is the coverage of the interval, 0..1. Raises ValueError if there are fewer
    than four pairs, a number is NaN, or the inputs or outputs are constant.

    The interval is Fisher's, with the variance (1 + r²/2)/(n-3) for the correlation r of n pairs. Source: D. G. Bonett,
    T. A. Wright, *Sample size requirements for estimating Pearson, Kendall and Spearman correlations*, Psychometrika
    65(1), 2000.
    """
    if inputs.size < _PAIRS_MIN:
        raise ValueError(f"arrived {inputs.size} pairs; expected {_PAIRS_MIN} at least")
    if np.isnan(inputs).any() or np.isnan(outputs).any():
        raise ValueError("arrived NaN; expected numbers")
    ranks = [stats.rankdata(rank_list) for rank_list in (inputs, outputs)]
    if any(np.ptp(rank_list) == 0.0 for rank_list in ranks):
        raise ValueError("arrived numbers that are all alike; expected some that differ")
    correlation = float(np.clip(np.corrcoef(*ranks)[0, 1], -1.0, 1.0))
    half = float(stats.norm.ppf(0.5 + 0.5 * confidence)) * math.sqrt((1.0 + 0.5 * correlation**2) / (inputs.size - 3))
    middle = math.atanh(min(max(correlation, -1.0 + 1e-15), 1.0 - 1e-15))
    return correlation, math.tanh(middle - half), math.tanh(middle + half)


_RESAMPLES = 400
_RESAMPLING_SEED = 1


class SobolIndices(NamedTuple):
    """Sobol indices of an output, with half widths of the confidence intervals; arrays with one entry per input."""

    first: np.ndarray  # fraction of the output's variance due to the input alone
    first_half_width: np.ndarray
    total: np.ndarray  # fraction of the output's variance due to the input and its interactions
    total_half_width: np.ndarray


def saltelli_points(inputs: int, count: int, seed: int) -> np.ndarray:
    """Return the input samples for the estimation of Sobol indices, shape (count * (inputs + 2), inputs), 0..1.

    The points form `count` blocks; `count` must be a power of 2. A block has a point A, then for each input a copy of A
    with this input's value from a point B, then B. (A, B) is a point of a scrambled Sobol sequence. Computed by SALib.
    Source: A. Saltelli et al., *Variance based sensitivity analysis of model output*, Computer Physics Communications
    181(2), 2010, table 2.
    """
    from SALib.sample import sobol

    problem = _salib_problem(inputs)
    return sobol.sample(problem, count, calc_second_order=False, seed=np.random.default_rng(seed))


def sobol_indices(
    outputs: np.ndarray,  # outputs at the points of `saltelli_points`, in the order of the points
    inputs: int,
    confidence: float = 0.95,  # coverage of the intervals, 0..1
) -> SobolIndices:
    """Estimate first-order and total Sobol indices from the outputs at the points of `saltelli_points`.

    Raises ValueError if there are fewer than two blocks or incomplete blocks, an output is not finite, or the outputs
    are constant.

    SALib computes the indices by the estimators (b) and (f, Jansen's) of Saltelli et al. (2010), table 2, and the
    intervals by resampling of the blocks. Definition of the total index: T. Homma, A. Saltelli, *Importance measures in
    global sensitivity analysis of nonlinear models*, Reliability Engineering & System Safety 52(1), 1996.
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
    indices = sobol.analyze(
        _salib_problem(inputs),
        outputs,
        calc_second_order=False,
        num_resamples=_RESAMPLES,
        conf_level=confidence,
        seed=_RESAMPLING_SEED,
    )
    return SobolIndices(*(np.asarray(indices[key]) for key in ("S1", "S1_conf", "ST", "ST_conf")))


def _salib_problem(inputs: int) -> dict[str, object]:
    return {"num_vars": inputs, "names": [f"x{k}" for k in range(inputs)], "bounds": [[0.0, 1.0]] * inputs}
