"""Subset simulation: probability of a rare event from a sequence of less rare events (levels).

A level is a set of points whose values reach a bound; the probability of the event is the product of the fractions of a
level's points that reach the next bound. The module knows nothing of flights: `SampleSpace` and `LimitState` are
supplied by the caller.

Sources: S.-K. Au, J. L. Beck, *Estimation of small failure probabilities in high dimensions by subset simulation*,
Probabilistic Engineering Mechanics 16(4), 2001. Moves by conditional sampling with adaptive step size: I. Papaioannou,
W. Betz, K. Zwirglmaier, D. Straub, *MCMC algorithms for subset simulation*, Probabilistic Engineering Mechanics 41,
2015. Unlike in the latter paper, the chains of a level move simultaneously, and the step size adapts after each move.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anser.results.sampling_statistics import log_interval, wilson_interval

ACCEPTANCE = 0.44
"""Target fraction of accepted moves of the Markov chains; Papaioannou et al. 2015."""
_FIRST_SIZE = 0.6

LimitState = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function from points and their numbers to values, shape (points,): greater is worse, infinite is the worst."""


class SampleSpace(Protocol):
    """Interface of the space in which the Markov chains of a subset simulation move.

    A point stands for a set of independent standard normal numbers; an array of points has one entry per point.
    """

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """Return an independent random point for each of `numbers`, the running numbers of the draws."""
        ...

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return the points ``keep * point + sqrt(1 - keep**2) * new``, which are again standard normal.

        `new` is the random point that `sample` returns for the running number in `numbers`; `keep` (0 to 1) and
        `numbers` have one entry per point.
        """
        ...


@dataclass(frozen=True)
class SubsetPlan:
    """Size of a subset simulation."""

    points: int  # number of points per level and repetition, a multiple of 1 / `share`
    share: float  # fraction of a level's points that start the chains of the next level; 1 / `share` is a whole number
    levels_max: int  # greatest number of levels
    repetitions: int  # number of independent repetitions; their scatter gives the confidence interval

    @property
    def length(self) -> int:
        """Number of points per Markov chain, including the starting point."""
        return round(1.0 / self.share)

    @property
    def chains(self) -> int:
        """Number of Markov chains per level and repetition."""
        return self.points // self.length


@dataclass(frozen=True)
class SubsetLevel:
    """One level of one repetition of a subset simulation: points whose values are at least `bound`."""

    bound: float  # -inf on the first level
    values: np.ndarray  # value of each point, chain by chain
    points: np.ndarray  # points of the sample space, in the order of `values`
    numbers: np.ndarray  # running number with which each point was drawn or proposed
    share: float  # fraction of the points that reach the next bound or, on the last level, exceed the threshold
    acceptance: float  # acceptance rate of the chains' moves; NaN on the first level


Repetition = tuple[SubsetLevel, ...]
"""Levels of one repetition; the last level reaches the threshold unless the plan or equal values end the levels."""


def exceedance(repetition: Repetition, value: float) -> float:
    """Estimate from one repetition the probability of exceeding a value.

    Let k be the first level with value < bound[k+1], or the last level. The probability is share[0] * ... * share[k-1],
    times the fraction of the points of level k above the value.
    """
    probability = 1.0
    for level, next_level in zip(repetition, (*repetition[1:], None), strict=True):
        if next_level is None or value < next_level.bound:
            return probability * float(np.mean(level.values > value))
        probability *= level.share
    return probability


@dataclass(frozen=True)
class SubsetEstimate:
    """Estimate of the probability of exceeding a value, with its confidence interval."""

    #: Estimated probability; None if a repetition has no point that exceeds the value or, where `estimate` uses only
    #: the first levels of all repetitions, if none of their points exceeds the value.
    probability: float | None
    low: float  #: Lower bound of the confidence interval; 0 if the probability is None.
    #: Upper bound of the confidence interval; 1 if the probability is None, except where only first levels are used.
    high: float


def estimate(repetitions: Sequence[Repetition], value: float, confidence: float) -> SubsetEstimate:
    """Estimate the probability of exceeding a value, with an interval of the given confidence level.

    If the value lies below the second level's bound in every repetition, the result is the Wilson interval of the first
    levels' independent points. If not, the estimate is the geometric mean of the repetitions' estimates, with Student's
    interval of their logarithms.
    """
    if all(len(repetition) == 1 or value < repetition[1].bound for repetition in repetitions):
        values = np.concatenate([repetition[0].values for repetition in repetitions])
        count = int(np.sum(values > value))
        return SubsetEstimate(count / values.size or None, *wilson_interval(count, values.size, confidence))
    probabilities = np.array([exceedance(repetition, value) for repetition in repetitions])
    if not probabilities.all():
        return SubsetEstimate(None, 0.0, 1.0)
    return SubsetEstimate(*log_interval(probabilities, confidence))


def subset_simulation(
    space: SampleSpace,
    limit_state: LimitState,
    threshold: float,
    plan: SubsetPlan,
    seed: int,
) -> tuple[Repetition, ...]:
    """Carry out all repetitions of a subset simulation at the same time, move by move.

    Parameters
    ----------
    space
        Space of the points.
    limit_state
        Function that returns a value for each point; the arguments are points and their running numbers, from 0. It is
        called once for each move, with the points of all chains in all repetitions.
    threshold
        Value that a point must exceed to count as the event.
    plan
        Numbers of points, levels and repetitions.
    seed
        Seed for the random choice of the chains' starting points.

    Returns
    -------
    For each repetition its levels, from the first (plain Monte Carlo) to the last.

    Raises
    ------
    ValueError
        A value of `limit_state` is NaN.
    """
    walks = {k: _walk(threshold, plan, np.random.default_rng([seed, k])) for k in range(plan.repetitions)}
    proposals = {k: next(walk) for k, walk in walks.items()}
    repetitions: dict[int, Repetition] = {}
    number = 0
    while proposals:
        sizes = [keep.size for _, keep in proposals.values()]
        numbers = number + np.arange(sum(sizes))
        number += numbers.size
        origins = [array for array, _ in proposals.values() if array is not None]
        keep = np.concatenate([array for _, array in proposals.values()])
        points = space.propose(np.concatenate(origins), keep, numbers) if origins else space.sample(numbers)
        values = np.asarray(limit_state(points, numbers), dtype=float)
        if np.isnan(values).any():
            raise ValueError("arrived NaN from the limit state; expected a number, or infinity for the worst")
        splits = np.cumsum(sizes)[:-1]
        parts = zip(*(np.split(array, splits) for array in (points, values, numbers)), strict=True)
        for k, part in zip(list(proposals), parts, strict=True):
            try:
                proposals[k] = walks[k].send(part)
            except StopIteration as stop:
                repetitions[k] = stop.value
                del proposals[k]
    return tuple(repetitions[k] for k in range(plan.repetitions))


_Proposal = tuple[np.ndarray | None, np.ndarray]
"""Points to move from and the weight `keep` of each (see `SampleSpace.propose`); None and zeros request new points."""
_Evaluated = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Points, their values and their numbers."""


def _walk(
    threshold: float, plan: SubsetPlan, generator: np.random.Generator
) -> Generator[_Proposal, _Evaluated, Repetition]:
    """Simulate one repetition, level by level, as a generator.

    The generator yields the points to move from and their weights `keep` (see `SampleSpace.propose`), receives the new
    points, values and numbers, and returns the levels.
    """
    points, values, numbers = yield None, np.zeros(plan.points)
    levels: list[SubsetLevel] = []
    bound, acceptance, size = -np.inf, np.nan, _FIRST_SIZE
    while True:
        next_bound = float(np.sort(values)[-plan.chains])
        is_last = np.sum(values > threshold) >= plan.chains or len(levels) + 1 == plan.levels_max
        # with too many equal values the bound cannot increase, and the last level is reached
        is_last = is_last or next_bound <= bound
        is_reached = values > threshold if is_last else values >= next_bound
        levels.append(SubsetLevel(bound, values, points, numbers, float(np.mean(is_reached)), acceptance))
        if is_last:
            return tuple(levels)
        bound = next_bound
        chain_starts = generator.permutation(np.flatnonzero(is_reached))[: plan.chains]
        chain = [(points[chain_starts], values[chain_starts], numbers[chain_starts])]
        acceptances = []
        for move in range(1, plan.length):
            former_points, former_values, former_numbers = chain[-1]
            keep = np.full(plan.chains, np.sqrt(1.0 - min(size, 1.0) ** 2))
            new_points, new_values, new_numbers = yield former_points, keep
            is_accepted = new_values >= bound
            mask = is_accepted.reshape(-1, *[1] * (former_points.ndim - 1))
            chain.append(
                (
                    np.where(mask, new_points, former_points),
                    np.where(is_accepted, new_values, former_values),
                    np.where(is_accepted, new_numbers, former_numbers),
                )
            )
            acceptances.append(float(np.mean(is_accepted)))
            size = min(size, 1.0) * float(np.exp((acceptances[-1] - ACCEPTANCE) / np.sqrt(move)))
        acceptance = float(np.mean(acceptances))
        columns = zip(*chain, strict=True)
        points, values, numbers = (np.stack(column, axis=1).reshape(-1, *column[0].shape[1:]) for column in columns)
