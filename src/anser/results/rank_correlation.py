"""Rank correlation with an interval: how monotonically an output goes with an input."""

import math

import numpy as np
from scipy import stats

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
