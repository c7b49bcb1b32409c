"""Random numbers without hidden state: each follows from (seed, flight, aircraft, part, sample) alone."""

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from anser.numerics.arrays import as_array, namespace
from anser.shapes import Count

AIR, VEHICLE_SENSORS, GOAL_SENSOR, BRIEFING, NETWORK, SATELLITES, DISPERSIONS = range(7)
"""Parts of the closed loop that draw random numbers; a user's own are numbered from 100 on."""
INITIAL_SAMPLE = -1
"""Sample number of what is drawn once, before the first sample."""

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = 0x1BD11BDA
_LANES = 1 << 16  # numbers that a part may draw at one sample


class AbstractRandomness(eqx.Module):
    """Source of the random numbers of a flight; concrete ones are final."""

    @abc.abstractmethod
    def for_aircraft(self, index: Count) -> "AbstractRandomness":
        """The source of one aircraft, from that of the flight."""

    @abc.abstractmethod
    def normals(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """Independent standard normal numbers that a part draws at a sample."""

    @abc.abstractmethod
    def uniforms(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """Independent numbers between 0 and 1, both excluded, that a part draws at a sample: Phi of the normals."""


class SeededRandomness(AbstractRandomness):
    """Counter-based generator: Threefry-2x32 of (part and place, sample) under a key of (seed, flight, aircraft).

    The bits, and with them the numbers, are the same for one aircraft alone and in any batch.

    Attributes
    ----------
    key
        Of the seed and the flight, or of one aircraft in it.
    """

    key: UInt32[Array, "2"]

    def for_aircraft(self, index: Count) -> "SeededRandomness":
        """The key with the aircraft's place in the fleet folded in."""
        return SeededRandomness(fold_key(self.key, index))

    def normals(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`: the inverse of the normal distribution at the uniform numbers."""
        return jax.scipy.special.ndtri(self.uniforms(part, number, count))

    def uniforms(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`: centres of 2^52 equal intervals."""
        if count > _LANES:
            raise ValueError(f"{count} random numbers at one sample; a part may draw {_LANES}")
        samples = jnp.broadcast_to(jnp.asarray(number, dtype=jnp.int32).astype(jnp.uint32), (count,))
        return draw_uniforms(self.key, part, samples, np.arange(count))


class PrescribedRandomness(AbstractRandomness):
    """Numbers that were designed or recorded, to be flown or replayed.

    Attributes
    ----------
    drawn
        By part: standard normals of (aircraft, samples, count), or of one aircraft; the first sample is the one before
        the start (`INITIAL_SAMPLE`).
    """

    standard_normals: Mapping[int, Float[Array, "..."]]

    def for_aircraft(self, index: Count) -> "PrescribedRandomness":
        """The rows of one aircraft."""
        return PrescribedRandomness({part: rows[index] for part, rows in self.standard_normals.items()})

    def normals(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`.

        Raises
        ------
        ValueError
            None, or too few, are given for the part.
        """
        rows = self.standard_normals.get(part)
        if rows is None or rows.shape[-1] < count:
            given = "none" if rows is None else f"{rows.shape[-1]} a sample"
            raise ValueError(f"part {part} draws {count} random numbers a sample; {given} given for it")
        return rows[jnp.asarray(number) + 1, :count]

    def uniforms(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`."""
        return jax.scipy.special.ndtr(self.normals(part, number, count))


class BlendedRandomness(AbstractRandomness):
    """Weighted sums of the normals of several seeded sources, standard normal again: what a walk has come to.

    A walk that mixes the standard normals of a flight with fresh ones, as Markov chains do, is the list of the sources
    and their weights: nothing of the length of the flight is kept, and nobody has to know how many numbers it draws.

    Attributes
    ----------
    keys
        Of the sources, of a flight or of one aircraft in it.
    weights
        Of each; the sum of their squares is 1.
    count
        How many count; those after them are there for the shape. The numbers of a sample cost so many times one draw.
    aircraft
        Place in the fleet; None: the source of the flight.
    """

    keys: UInt32[Array, "terms 2"]
    weights: Float[Array, " terms"]
    count: Count
    aircraft: Count | None = None

    def for_aircraft(self, index: Count) -> "BlendedRandomness":
        """The sources of one aircraft."""
        return BlendedRandomness(self.keys, self.weights, self.count, index)

    def normals(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`."""

        def more(k: Count, total: Array) -> Array:
            source = SeededRandomness(self.keys[k])
            if self.aircraft is not None:
                source = source.for_aircraft(self.aircraft)
            return total + self.weights[k] * source.normals(part, number, count)

        return jax.lax.fori_loop(0, self.count, more, jnp.zeros(count, self.weights.dtype))

    def uniforms(self, part: int, number: Count | int, count: int) -> Float[Array, " count"]:
        """See `AbstractRandomness`."""
        return jax.scipy.special.ndtr(self.normals(part, number, count))


def flight_randomness(seed: int, flight: int = 0) -> SeededRandomness:
    """Source of the random numbers of one flight of a seed (both up to 2^32 - 1); compiles nothing."""
    key = np.array([0, seed], dtype=np.uint32)
    return SeededRandomness(as_array(fold_key(key, np.asarray(flight)), np.uint32))


def flight_keys(seed: int, flights: np.ndarray) -> np.ndarray:
    """Keys of flights of a seed, shape (flights, 2); as `seeded` has them, of known numbers."""
    zeros = np.zeros(flights.size, np.uint32)
    return np.stack(threefry(np.array([0, seed], dtype=np.uint32), zeros, flights.astype(np.uint32)), axis=-1)


def draw_uniforms(key: Any, part: int, samples: Any, lanes: np.ndarray) -> Any:
    """Numbers between 0 and 1, both excluded, of a part, of samples and of places: centres of 2^52 equal intervals."""
    xp = namespace(key, samples)
    first = lanes.astype(np.uint32) + np.uint32(part * _LANES)
    high, low = threefry(key, first, xp.asarray(samples).astype(np.uint32))
    dtype = xp.result_type(float)
    return (high.astype(dtype) * 2.0**20 + xp.right_shift(low, np.uint32(12)).astype(dtype) + 0.5) * 2.0**-52


def fold_key(key: Any, value: Any) -> UInt32[Array, "2"]:
    """Another key, for a value that a key is to hold for; as `jax.random.fold_in` makes it."""
    xp = namespace(key, value)
    zero = xp.zeros((1,), dtype=np.uint32)
    return xp.concatenate(threefry(key, zero, xp.asarray(value).astype(np.uint32)[None]))


def threefry(key: Any, first: Any, second: Any) -> tuple[UInt32[Array, " n"], UInt32[Array, " n"]]:
    """Threefry-2x32 in 20 rounds: two words for each pair of counters.

    Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, *Parallel random numbers: as easy as 1, 2, 3*, SC 2011.
    Written out, because jax's own is a loop within the step, which costs more than the step's other random work.
    """
    xp = namespace(key, first, second)
    keys = (key[0], key[1], key[0] ^ key[1] ^ np.uint32(_PARITY))
    x, y = xp.asarray(first) + keys[0], xp.asarray(second) + keys[1]
    for group in range(5):
        for rotation in _ROTATIONS[group % 2]:
            x = x + y
            y = ((y << np.uint32(rotation)) | (y >> np.uint32(32 - rotation))) ^ x
        x = x + keys[(group + 1) % 3]
        y = y + keys[(group + 2) % 3] + np.uint32(group + 1)
    return x, y
