"""Points among the standard normals of flights: weighted sums of those of numbered flights, kept as a list of them.

The normals of a flight are hundreds of thousands; a walk mixes those that it stands at with those of another flight of
the seed. Where it has come to is which flights were mixed, and how much of each: some hundred bytes, from which every
number of the flight follows again.
"""

import functools
from collections.abc import Sequence

import numpy as np
from scipy import stats

from anser.numerics import Blended, as_array, few_sizes, seeded
from anser.numerics.randomness import DISPERSIONS, uniforms_of

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
        keys = np.zeros((self.terms, 2), np.uint32)
        for k, flight in enumerate(_flights(point)):
            keys[k] = self._key(flight)
        return Blended(as_array(keys, np.uint32), as_array(point["weights"]), as_array(point["count"], np.int32))

    def dispersions(self, points: np.ndarray, count: int) -> np.ndarray:
        """Normals behind what the study disperses, shape (points, count)."""
        found = np.zeros((points.size, count))
        for row, point in zip(found, points, strict=True):
            for flight, weight in zip(_flights(point), point["weights"], strict=False):
                row += weight * self._dispersed(flight, count)
        return found

    @functools.lru_cache(maxsize=1 << 16)  # noqa: B019 - lives as long as what it is for: one run
    def _key(self, flight: int) -> np.ndarray:
        return np.asarray(seeded(self.seed, flight).key)

    @functools.lru_cache(maxsize=1 << 16)  # noqa: B019
    def _dispersed(self, flight: int, count: int) -> np.ndarray:
        shares = uniforms_of(self._key(flight), DISPERSIONS, np.zeros(count, np.uint32), np.arange(count))
        return stats.norm.ppf(shares)


def _flights(point: np.ndarray) -> list[int]:
    return point["flights"][: int(point["count"])].tolist()
