"""The earliest time at which something works, where trying takes long and what works may have gaps."""

from collections.abc import Generator

import numpy as np
from jaxtyping import Float

_STEP_UP, _FIRST_STEP = 1.12, 1.06  # from one time to the next, and from the first that nothing rules out to the first
RESOLUTION = 1.02
"""Ratio of two times between which no other is tried."""


def first_index(count: int, one_by_one: int = 1) -> Generator[int, bool | None, int | None]:
    """Search for the first of `count` rising times that works, each index answered by whether it does.

    Up to index `one_by_one` one after the other, then in doubled steps; then back by halving between the last that does
    not work and the first that does. What works may have gaps, so near the first time steps are small.

    Returns
    -------
    Index of the first time that was found to work; None if none does.
    """
    low, index, step = -1, 0, 1
    while low < count - 1:
        index = min(low + step, count - 1)
        if (yield index):
            break
        low, step = index, 1 if index < one_by_one else 2 * step
    else:
        return None
    high = index
    while high - low > 1:
        middle = (low + high) // 2
        if (yield middle):
            high = middle
        else:
            low = middle
    return high


def earlier_times(admissible: Float[np.ndarray, " n"], known: float) -> Generator[float, bool | None, float]:
    """Times to try one after the other for an earlier one than is known; each is answered by whether it works.

    Upwards in steps of an eighth, since what is closed for a while may be open before; then by bisection between the
    last that does not work and the first that does, to a fiftieth.

    Parameters
    ----------
    admissible
        Times that nothing rules out, rising, s.
    known
        A time that works, s.

    Returns
    -------
    The earliest that was found to work, s.
    """
    if admissible.size == 0 or known <= admissible[0]:
        return known
    low, high, near = float(admissible[0]), known, float(np.sqrt(RESOLUTION))
    count = int(np.ceil(np.log(high / low) / np.log(_STEP_UP)))
    steps = np.searchsorted(admissible, low * _FIRST_STEP * _STEP_UP ** np.arange(count))
    ahead = np.unique(admissible[np.minimum(steps, admissible.size - 1)])
    for time in ahead[ahead < high / near]:
        if (yield float(time)):
            high = float(time)
            break
        low = float(time)
    while high > RESOLUTION * low:
        between = admissible[(admissible > low * near) & (admissible < high / near)]
        if between.size == 0:
            break
        middle = float(between[np.argmin(np.abs(np.log(between**2 / (low * high))))])
        if (yield middle):
            high = middle
        else:
            low = middle
    return high
