"""Sobol indices: which part of an output's variance is due to each input, alone and with all others."""

from typing import NamedTuple

import numpy as np

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
    first_half: np.ndarray
    total: np.ndarray
    total_half: np.ndarray


def saltelli_shares(inputs: int, count: int, seed: int) -> np.ndarray:
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
    """Estimate first and total Sobol indices from outputs at `saltelli_shares`, or at whole blocks of them.

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
