"""The earliest time at which something works, where trying takes long and what works may have gaps."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

_STEP_UP, _FIRST_STEP = 1.12, 1.06  # from one time to the next, and from the first that nothing rules out to the first
NEARLY = 1.02
"""Of a time: what is nearer is not looked for."""


def earliest_time(possible: Float[np.ndarray, " n"], known: float, works: Callable[[float], bool]) -> float:
    """The earliest of the possible times that is found to work.

    Upwards in steps of an eighth, since what is closed for a while may be open before; then by bisection between the
    last that does not work and the first that does, to a fiftieth.

    Parameters
    ----------
    possible
        Times that nothing rules out, rising, s.
    known
        A time that works, s.
    works
        Whether a time does.
    """
    if possible.size == 0 or known <= possible[0]:
        return known
    low, high, near = float(possible[0]), known, float(np.sqrt(NEARLY))
    count = int(np.ceil(np.log(high / low) / np.log(_STEP_UP)))
    steps = np.searchsorted(possible, low * _FIRST_STEP * _STEP_UP ** np.arange(count))
    ahead = np.unique(possible[np.minimum(steps, possible.size - 1)])
    for time in ahead[ahead < high / near]:
        if works(float(time)):
            high = float(time)
            break
        low = float(time)
    while high > NEARLY * low:
        between = possible[(possible > low * near) & (possible < high / near)]
        if between.size == 0:
            break
        middle = float(between[np.argmin(np.abs(np.log(between**2 / (low * high))))])
        if works(middle):
            high = middle
        else:
            low = middle
    return high
