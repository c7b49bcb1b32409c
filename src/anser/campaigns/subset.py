"""Subset simulation: the probability of what is rare, by levels that are less so; it knows nothing of flights.

Sources: S.-K. Au, J. L. Beck, *Estimation of small failure probabilities in high dimensions by subset simulation*,
Probabilistic Engineering Mechanics 16(4), 2001; moves by conditional sampling whose size is adapted to the acceptance:
I. Papaioannou, W. Betz, K. Zwirglmaier, D. Straub, *MCMC algorithms for subset simulation*, Probabilistic Engineering
Mechanics 41, 2015. There chains of one level follow each other; here they move at once, so that what they ask for can
be computed at once, and the size is adapted after each move.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anser.results.sampling_statistics import log_interval, wilson_interval

ACCEPTANCE = 0.44
"""Share of the moves that are to be accepted; Papaioannou et al. 2015."""
_FIRST_SIZE = 0.6

LimitState = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From points and their numbers to values, more is worse; infinite where it is as bad as can be."""


class SampleSpace(Protocol):
    """Where the walks go: points that stand for independent standard normal numbers, as rows of an array."""

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """Independent points, each from its number."""
        ...

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Points ``keep * point + sqrt(1 - keep**2) * fresh``, standard normal again; `keep` is one for each."""
        ...


class Normals:
    """Points as they are: arrays of standard normal numbers; the generator of `numpy` draws them.

    Attributes
    ----------
    dimension
        How many numbers a point has.
    seed
        Of the generator.
    """

    def __init__(self, dimension: int, seed: int) -> None:
        self.dimension, self.seed = dimension, seed

    def sample(self, numbers: np.ndarray) -> np.ndarray:
        """See `Space`; of numbers that follow each other."""
        generator = np.random.default_rng([self.seed, int(numbers[0])])
        return generator.standard_normal((numbers.size, self.dimension))

    def propose(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """See `Space`."""
        part = keep[:, None]
        return part * points + np.sqrt(1.0 - part**2) * self.sample(numbers)


@dataclass(frozen=True)
class SubsetPlan:
    """How much is computed.

    Attributes
    ----------
    points
        Of each level of one repetition; a whole multiple of what one over the share is.
    share
        Of the points of a level that begin the next one; one over a whole number.
    levels_max
        Levels at most.
    repetitions
        Independent of each other; from how they differ comes the interval.
    """

    points: int
    share: float
    levels_max: int
    repetitions: int

    @property
    def length(self) -> int:
        """Points of a chain, the first included."""
        return round(1.0 / self.share)

    @property
    def chains(self) -> int:
        """Chains of a level of one repetition."""
        return self.points // self.length


@dataclass(frozen=True)
class SubsetLevel:
    """One level of one repetition.

    Attributes
    ----------
    bound
        What all its values reach at least; -inf on the first level.
    values
        Of its points, chain after chain.
    points, numbers
        Themselves, and by which number each was computed.
    share
        How many of them reach the next bound, or exceed the threshold on the last level.
    acceptance
        Share of the moves that were accepted; NaN on the first level, which has none.
    """

    bound: float
    values: np.ndarray
    points: np.ndarray
    numbers: np.ndarray
    share: float
    acceptance: float


Repetition = tuple[SubsetLevel, ...]
"""Levels of one repetition, the last one at the threshold, or where it ends short of it."""


def exceedance(repetition: Repetition, value: float) -> float:
    """Probability that a value is exceeded, as one repetition estimates it: product of conditional probabilities."""
    before = 1.0
    for level, further in zip(repetition, (*repetition[1:], None), strict=True):
        if further is None or value < further.bound:
            return before * float(np.mean(level.values > value))
        before *= level.share
    return before


@dataclass(frozen=True)
class SubsetEstimate:
    """A probability with its interval.

    Attributes
    ----------
    probability
        None where a repetition found no point that counts.
    low, high
        Ends of the interval; without a probability 0 and 1.
    """

    probability: float | None
    low: float
    high: float


def estimate(repetitions: Sequence[Repetition], value: float, confidence: float) -> SubsetEstimate:
    """How probable it is that a value is exceeded.

    Chains are correlated within and between levels, which formulas of one repetition take into account in part only;
    repetitions are independent. Where all of them need one level only, their points are, too: then it is Wilson's.
    """
    if all(len(one) == 1 or value < one[1].bound for one in repetitions):
        values = np.concatenate([one[0].values for one in repetitions])
        count = int(np.sum(values > value))
        return SubsetEstimate(count / values.size or None, *wilson_interval(count, values.size, confidence))
    found = np.array([exceedance(one, value) for one in repetitions])
    if not found.all():
        return SubsetEstimate(None, 0.0, 1.0)
    return SubsetEstimate(*log_interval(found, confidence))


def subset_simulation(
    space: SampleSpace,
    limit_state: LimitState,
    threshold: float,
    plan: SubsetPlan,
    seed: int,
) -> tuple[Repetition, ...]:
    """Walk into the rare: from level to level, all repetitions side by side.

    Parameters
    ----------
    space
        Of the points.
    limit_state
        Called for each level with points that follow from what was found before; their numbers count up from 0.
    threshold
        What is exceeded in the event.
    plan
        How much of it.
    seed
        Of which points begin a chain.

    Returns
    -------
    The repetitions.

    Raises
    ------
    ValueError
        A value is NaN.
    """
    walks = {k: _walk(threshold, plan, np.random.default_rng([seed, k])) for k in range(plan.repetitions)}
    asked = {k: next(walk) for k, walk in walks.items()}
    found: dict[int, Repetition] = {}
    number = 0
    while asked:
        sizes = [keep.size for _, keep in asked.values()]
        numbers = number + np.arange(sum(sizes))
        number += numbers.size
        held = [one for one, _ in asked.values() if one is not None]
        keep = np.concatenate([one for _, one in asked.values()])
        points = space.propose(np.concatenate(held), keep, numbers) if held else space.sample(numbers)
        values = np.asarray(limit_state(points, numbers), dtype=float)
        if np.isnan(values).any():
            raise ValueError("arrived NaN from the limit state; expected a number, or infinity for the worst")
        ends = np.cumsum(sizes)[:-1]
        parts = zip(*(np.split(one, ends) for one in (points, values, numbers)), strict=True)
        for k, part in zip(list(asked), parts, strict=True):
            try:
                asked[k] = walks[k].send(part)
            except StopIteration as ended:
                found[k] = ended.value
                del asked[k]
    return tuple(found[k] for k in range(plan.repetitions))


_Proposal = tuple[np.ndarray | None, np.ndarray]
"""Points to move from and the part of each that is kept; None and as many zeros: fresh ones."""
_Evaluated = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Points, values, numbers."""


def _walk(
    threshold: float, plan: SubsetPlan, generator: np.random.Generator
) -> Generator[_Proposal, _Evaluated, Repetition]:
    points, values, numbers = yield None, np.zeros(plan.points)
    levels: list[SubsetLevel] = []
    bound, acceptance, size = -np.inf, np.nan, _FIRST_SIZE
    while True:
        further = float(np.sort(values)[-plan.chains])
        ended = np.sum(values > threshold) >= plan.chains or len(levels) + 1 == plan.levels_max
        # where so many values are the same that no further one is left, no level leads on
        ended = ended or further <= bound
        reached = values > threshold if ended else values >= further
        levels.append(SubsetLevel(bound, values, points, numbers, float(np.mean(reached)), acceptance))
        if ended:
            return tuple(levels)
        bound = further
        first = generator.permutation(np.flatnonzero(reached))[: plan.chains]
        held = [(points[first], values[first], numbers[first])]
        accepted = []
        for move in range(1, plan.length):
            at, worth, known = held[-1]
            keep = np.full(plan.chains, np.sqrt(1.0 - min(size, 1.0) ** 2))
            new, came, drawn = yield at, keep
            good = came >= bound
            shaped = good.reshape(-1, *[1] * (at.ndim - 1))
            held.append((np.where(shaped, new, at), np.where(good, came, worth), np.where(good, drawn, known)))
            accepted.append(float(np.mean(good)))
            size = min(size, 1.0) * float(np.exp((accepted[-1] - ACCEPTANCE) / np.sqrt(move)))
        acceptance = float(np.mean(accepted))
        columns = zip(*held, strict=True)
        points, values, numbers = (np.stack(one, axis=1).reshape(-1, *one[0].shape[1:]) for one in columns)
