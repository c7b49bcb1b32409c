"""Sampling of a study: input values of every flight."""

import itertools
from collections.abc import Mapping

import numpy as np
from scipy import stats
from scipy.stats import qmc

from anser.campaigns.study import Study
from anser.numerics.randomness import DISPERSIONS, draw_uniforms, flight_randomness
from anser.results.sampling_statistics import saltelli_points

_LEAST = 2.0**-53


def sample_study(study: Study, table_columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sample the distributions by path, one value per flight, before adding to or multiplying scenario values.

    In plain Monte Carlo the values of flight k do not depend on the number of flights. In a Latin hypercube they do.

    Parameters
    ----------
    table_columns
        Columns of the study's table of values, by path.
    """
    if study.sampled.method == "table":
        return dict(table_columns)
    if study.sampled.method == "grid":
        return _grid(study)
    return apply_distributions(study, _shares(study))


def apply_distributions(study: Study, shares: np.ndarray) -> dict[str, np.ndarray]:
    """Transform independent uniform numbers in (0, 1), shape (flights, varied), into values by path."""
    correlated = _correlate(study, np.clip(shares, _LEAST, 1.0 - _LEAST))
    return {vary.path: vary.quantile(correlated[:, k]) for k, vary in enumerate(study.vary)}


def flight_seeds(study: Study, count: int) -> np.ndarray:
    """Seeds of the flights: consecutive numbers from a start derived from the study's seed.

    In a Saltelli block every flight but the last shares a seed. Random effects then differ exactly where the input
    samples A and B differ, so they contribute to neither the first-order nor the total index of an input.
    """
    start = np.random.SeedSequence(study.seed).generate_state(1, np.uint32)[0]
    numbers = np.arange(count, dtype=np.uint64)
    if study.block > 1:
        block = np.uint64(study.block)
        numbers = np.uint64(2) * (numbers // block) + (numbers % block == block - np.uint64(1))
    return (np.uint64(start) + numbers) % np.uint64(2**32)


def is_independent(study: Study, numbers: np.ndarray) -> np.ndarray:
    """Select independent flights: every flight, except in Saltelli blocks only the first and last."""
    position = numbers % study.block
    return (position == 0) | (position == study.block - 1)


def _shares(study: Study) -> np.ndarray:
    """Uniform numbers in (0, 1), shape (flights, varied)."""
    flights, count = study.sampled.flights or 0, len(study.vary)
    if study.sampled.method == "monte-carlo":
        lanes = np.tile(np.arange(count), flights)
        numbers = np.repeat(np.arange(flights), count)
        key = np.asarray(flight_randomness(study.seed).key)
        return draw_uniforms(key, DISPERSIONS, numbers, lanes).reshape(flights, count)
    if study.sampled.method == "saltelli":
        return np.clip(saltelli_points(count, flights, study.seed), _LEAST, 1.0 - _LEAST)
    sampler = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[study.sampled.method]
    return np.clip(sampler(count, rng=np.random.default_rng(study.seed)).random(flights), _LEAST, 1.0 - _LEAST)


def _correlate(study: Study, shares: np.ndarray) -> np.ndarray:
    """Correlate the groups through the corresponding normal numbers (Gaussian copula)."""
    shares, paths = shares.copy(), [vary.path for vary in study.vary]
    for group in study.correlated:
        columns = [paths.index(path) for path in group.paths]
        normals = stats.norm.ppf(shares[:, columns]) @ np.linalg.cholesky(np.array(group.coefficients)).T
        shares[:, columns] = np.clip(stats.norm.cdf(normals), _LEAST, 1.0 - _LEAST)
    return shares


def _grid(study: Study) -> dict[str, np.ndarray]:
    """Every combination, the last path varying fastest: the values of a choice, otherwise midpoints of equal shares."""
    levels = study.sampled.levels or 1
    middles = (np.arange(levels) + 0.5) / levels
    axes = [np.array(vary.values) if vary.values is not None else vary.quantile(middles) for vary in study.vary]
    columns = zip(*itertools.product(*axes), strict=True)
    return {vary.path: np.array(column) for vary, column in zip(study.vary, columns, strict=True)}
