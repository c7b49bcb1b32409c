"""Points among the standard normals of flights: weighted sums of those of numbered flights, kept as a list of them.

The normals of a flight are hundreds of thousands; a walk mixes those that it stands at with those of another flight of
the seed. Where it has come to is which flights were mixed, and how much of each: some hundred bytes, from which every
number of the flight follows again.
"""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from anser.numerics import Blended, as_array, few_sizes
from anser.numerics.randomness import DISPERSIONS, flight_keys, uniforms_of

_ROOM = 128
"""Terms for which there is room: programs are compiled for few sizes."""


class Blends:
    """The space of the normals of a seed's flights; see `anser.campaigns.subset.Space`.

    Its points have the fields `count`, `flights` and `weights`: how many flights were mixed, which, and how much of
    each.

    Attributes
    ----------
    seed
        Of the flights.
    terms
        How many flights a point may be mixed of.
    """

    def __init__(self, seed: int, terms: int) -> None:
        self.seed, self.terms = seed, few_sizes(terms, _ROOM)
        self.dtype = np.dtype(
            [("count", np.int32), ("flights", np.uint32, (self.terms,)), ("weights", float, (self.terms,))]
        )

    def fresh(self, numbers: np.ndarray) -> np.ndarray:
        """The normals of the flights of these numbers themselves."""
        points = np.zeros(numbers.size, self.dtype)
        points["count"], points["flights"][:, 0], points["weights"][:, 0] = 1, numbers, 1.0
        return points

    def mixed(self, points: np.ndarray, keep: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Points ``keep * point + sqrt(1 - keep**2) * fresh``; nothing is left of a point of which nothing is kept."""
        found = points.copy()
        found["weights"] *= keep[:, None]
        found["count"][keep == 0.0] = 0
        rows, last = np.arange(points.size), found["count"]
        found["flights"][rows, last], found["weights"][rows, last] = numbers, np.sqrt(1.0 - keep**2)
        found["count"] += 1
        return found

    def point(self, flights: Sequence[int], weights: Sequence[float]) -> np.ndarray:
        """One point, of its flights and how much of each."""
        found = np.zeros((), self.dtype)
        found["count"] = len(flights)
        found["flights"][: len(flights)], found["weights"][: len(flights)] = flights, weights
        return found

    def source(self, point: np.ndarray) -> Blended:
        """All that is random in the flight of a point."""
        keys = flight_keys(self.seed, point["flights"])
        return Blended(as_array(keys, np.uint32), as_array(point["weights"]), as_array(point["count"], np.int32))

    def dispersions(self, points: np.ndarray, count: int) -> np.ndarray:
        """Normals behind what the study disperses, shape (points, count)."""
        width = int(np.max(points["count"]))
        keys = flight_keys(self.seed, points["flights"][:, :width].ravel())
        lanes = np.tile(np.arange(count), len(keys))
        shares = uniforms_of(np.repeat(keys, count, axis=0).T, DISPERSIONS, np.zeros(lanes.size, np.uint32), lanes)
        normals = stats.norm.ppf(shares).reshape(points.size, width, count)
        return np.einsum("pt,ptc->pc", points["weights"][:, :width], normals)
