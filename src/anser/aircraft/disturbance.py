"""What an aircraft meets besides the mean wind, and what its engine has lost."""

import equinox as eqx

from anser.environment import Gust
from anser.numerics import as_array
from anser.shapes import Scalar


class Disturbance(eqx.Module):
    """Gust and thrust of one aircraft, held over a sampling period.

    Attributes
    ----------
    gust
        What is added to the mean wind.
    thrust
        Part of the engine's thrust that is left, 0..1.
    """

    gust: Gust
    thrust: Scalar


def no_disturbance() -> Disturbance:
    """Smooth air and a sound engine."""
    return Disturbance(Gust(as_array([0.0] * 3), as_array([0.0] * 3)), as_array(1.0))
