"""McNemar's exact test: whether one of two ways succeeds more often, from pairs of which one succeeded."""

from scipy import stats


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
