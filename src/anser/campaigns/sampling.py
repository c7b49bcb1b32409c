"""From a study to the values of every flight."""

import itertools
from collections.abc import Mapping

import numpy as np
from scipy import stats
from scipy.stats import qmc

from anser.campaigns.study import Study
from anser.numerics.randomness import DISPERSIONS, draw_uniforms, flight_randomness
from anser.results.sampling_statistics import saltelli_points

_LEAST = 2.0**-53


def sample_study(study: Study, given: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values of the distributions by path, one for each flight; nothing has been added or multiplied yet.

    Plain Monte Carlo gives flight k the same values however many there are. A Latin hypercube does not.

    Parameters
    ----------
    study
        Validated.
    given
        Columns of its table, by path.
    """
    if study.sampled.method == "table":
        return dict(given)
    if study.sampled.method == "grid":
        return _grid(study)
    return apply_distributions(study, _shares(study))


def apply_distributions(study: Study, shares: np.ndarray) -> dict[str, np.ndarray]:
    """Values by path, from numbers between 0 and 1 of shape (flights, varied) that are independent and even."""
    together = _correlate(study, np.clip(shares, _LEAST, 1.0 - _LEAST))
    return {vary.path: vary.quantile(together[:, k]) for k, vary in enumerate(study.vary)}


def flight_seeds(study: Study, count: int) -> np.ndarray:
    """Seeds of the flights, each as in a scenario: one after the other from a place that the study's seed scatters.

    Of a Saltelli block all flights share one but the last, which has its own: what is random then differs wherever the
    inputs A and B do, and nowhere else, so that it adds neither to the first index of an input nor to its total one.
    """
    first = np.random.SeedSequence(study.seed).generate_state(1, np.uint32)[0]
    numbers = np.arange(count, dtype=np.uint64)
    if study.block > 1:
        block = np.uint64(study.block)
        numbers = np.uint64(2) * (numbers // block) + (numbers % block == block - np.uint64(1))
    return (np.uint64(first) + numbers) % np.uint64(2**32)


def is_independent(study: Study, numbers: np.ndarray) -> np.ndarray:
    """Which of these flights are independent of each other: all, but of a Saltelli block its first and last alone."""
    place = numbers % study.block
    return (place == 0) | (place == study.block - 1)


def _shares(study: Study) -> np.ndarray:
    """Numbers between 0 and 1, shape (flights, varied)."""
    flights, count = study.sampled.flights or 0, len(study.vary)
    if study.sampled.method == "monte-carlo":
        lanes = np.tile(np.arange(count), flights)
        numbers = np.repeat(np.arange(flights), count)
        key = np.asarray(flight_randomness(study.seed).key)
        return draw_uniforms(key, DISPERSIONS, numbers, lanes).reshape(flights, count)
    if study.sampled.method == "saltelli":
        return np.clip(saltelli_points(count, flights, study.seed), _LEAST, 1.0 - _LEAST)
    kind = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[study.sampled.method]
    return np.clip(kind(count, rng=np.random.default_rng(study.seed)).random(flights), _LEAST, 1.0 - _LEAST)


def _correlate(study: Study, shares: np.ndarray) -> np.ndarray:
    """Correlate the groups: by the normal numbers behind the shares."""
    shares, paths = shares.copy(), [vary.path for vary in study.vary]
    for group in study.correlated:
        columns = [paths.index(path) for path in group.paths]
        normals = stats.norm.ppf(shares[:, columns]) @ np.linalg.cholesky(np.array(group.coefficients)).T
        shares[:, columns] = np.clip(stats.norm.cdf(normals), _LEAST, 1.0 - _LEAST)
    return shares


def _grid(study: Study) -> dict[str, np.ndarray]:
    """Every combination, the last path's values fastest: all values of a choice, the middles of equal parts else."""
    levels = study.sampled.levels or 1
    middles = (np.arange(levels) + 0.5) / levels
    axes = [np.array(vary.values) if vary.values is not None else vary.quantile(middles) for vary in study.vary]
    columns = zip(*itertools.product(*axes), strict=True)
    return {vary.path: np.array(column) for vary, column in zip(study.vary, columns, strict=True)}
