"""Sampling of a study: values of the varied parameters and seed of every flight."""

from collections.abc import Mapping

import numpy as np
from scipy import stats
from scipy.stats import qmc

from anser.campaigns.study import Study
from anser.numerics.randomness import DISPERSIONS, draw_uniforms, flight_randomness
from anser.results.sampling_statistics import saltelli_points

_LEAST = 2.0**-53


def sample_study(
    study: Study,
    # columns of the study's table of values, by key path; used with the method "table" only
    table_columns: Mapping[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Sample the varied parameters of a study; return an array of values, shape (flights,), by key path.

    The values are not yet combined with the scenario's values (set, add or multiply). In plain Monte Carlo the values
    of flight k do not depend on the number of flights; in a Latin hypercube they do.
    """
    if study.sampled.method == "table":
        return dict(table_columns)
    if study.sampled.method == "grid":
        return _grid(study)
    return apply_distributions(study, _shares(study))


def apply_distributions(
    study: Study,
    shares: np.ndarray,  # independent uniform numbers, shape (flights, varied parameters)
) -> dict[str, np.ndarray]:
    """Convert uniform numbers to values of the varied parameters, shape (flights,), by key path.

    The study gives the distributions and the correlations (Gaussian copula).
    """
    correlated = _correlate(study, np.clip(shares, _LEAST, 1.0 - _LEAST))
    return {vary.path: vary.quantile(correlated[:, k]) for k, vary in enumerate(study.vary)}


def flight_seeds(study: Study, count: int) -> np.ndarray:
    """Return the seeds of `count` flights: consecutive numbers from a start derived from the study's seed.

    The flights of a Saltelli block have the same seed; only the last flight (input sample B) has a different seed. With
    these seeds, random effects contribute to no input's first-order or total index.
    """
    start = np.random.SeedSequence(study.seed).generate_state(1, np.uint32)[0]
    numbers = np.arange(count, dtype=np.uint64)
    if study.block > 1:
        block = np.uint64(study.block)
        numbers = np.uint64(2) * (numbers // block) + (numbers % block == block - np.uint64(1))
    return (np.uint64(start) + numbers) % np.uint64(2**32)


def is_independent(study: Study, numbers: np.ndarray) -> np.ndarray:
    """Return for each of the flights `numbers` whether its results are independent of the rest; shape of `numbers`.

    With Saltelli sampling, only the first and the last flight of a block count as independent.
    """
    position = numbers % study.block
    return (position == 0) | (position == study.block - 1)


def _shares(study: Study) -> np.ndarray:
    """Return uniform numbers from 0 to 1 by the study's sampling method; shape (flights, varied parameters)."""
    flights, count = study.sampled.flights or 0, len(study.vary)
    if study.sampled.method == "monte-carlo":
        lanes = np.tile(np.arange(count), flights)
        numbers = np.repeat(np.arange(flights), count)
        key = np.asarray(flight_randomness(study.seed).key)
        return draw_uniforms(key, DISPERSIONS, numbers, lanes).reshape(flights, count)
    if study.sampled.method == "saltelli":
        return saltelli_points(count, flights, study.seed)
    sampler = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[study.sampled.method]
    return sampler(count, rng=np.random.default_rng(study.seed)).random(flights)


def _correlate(study: Study, shares: np.ndarray) -> np.ndarray:
    """Return uniform numbers with the correlations of the study's groups (Gaussian copula); shape of `shares`."""
    shares, paths = shares.copy(), [vary.path for vary in study.vary]
    for group in study.correlated:
        columns = [paths.index(path) for path in group.paths]
        normals = stats.norm.ppf(shares[:, columns]) @ np.linalg.cholesky(np.array(group.coefficients)).T
        shares[:, columns] = np.clip(stats.norm.cdf(normals), _LEAST, 1.0 - _LEAST)
    return shares


def _grid(study: Study) -> dict[str, np.ndarray]:
    """Return every combination of the parameters' grid values, by key path; the last path varies fastest.

    Grid values are the listed values, or the midpoints of intervals of equal probability.
    """
    levels = study.sampled.levels or 1
    middles = (np.arange(levels) + 0.5) / levels
    axes = [np.array(vary.values) if vary.values is not None else vary.quantile(middles) for vary in study.vary]
    grids = np.meshgrid(*axes, indexing="ij")
    return {vary.path: grid.ravel() for vary, grid in zip(study.vary, grids, strict=True)}
