"""The earliest time at which something works, where trying takes long and what works may have gaps."""

from collections.abc import Generator

import numpy as np
from jaxtyping import Float

_STEP_UP, _FIRST_STEP = 1.12, 1.06  # from one time to the next, and from the first that nothing rules out to the first
RESOLUTION = 1.02
"""Ratio of two times between which no other is tried."""


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
