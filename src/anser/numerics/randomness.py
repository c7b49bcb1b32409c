"""Random numbers without hidden state: functions of (seed, flight, aircraft, part of the loop, sample)."""

import abc
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt32

from anser.numerics.arrays import as_array, namespace
from anser.shapes import Integer

AIR, VEHICLE_SENSORS, GOAL_SENSOR, BRIEFING, NETWORK, SATELLITES, DISPERSIONS = range(7)
"""Numbers of the parts of the closed loop that draw random numbers; user-defined parts have numbers from 100."""
INITIAL_SAMPLE = -1
"""Sample number of the draws for initial values; the samples of a flight have the numbers 0, 1, ..."""

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = 0x1BD11BDA
_LANES = 1 << 16  # greatest count of numbers that a part draws at one sample


class AbstractRandomness(eqx.Module):
    """Interface of the source of a flight's random numbers."""

    @abc.abstractmethod
    def for_aircraft(self, index: Integer) -> "AbstractRandomness":
        """Return the random source of one aircraft; `index` is the aircraft's index in the fleet."""

    @abc.abstractmethod
    def normals(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` independent standard normal numbers for a part of the loop at sample `number`.

        `part` is one of the part numbers of this module, or a user's number from 100.
        """

    @abc.abstractmethod
    def uniforms(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` independent numbers, uniform in (0, 1): the normal distribution function of `normals`."""


class SeededRandomness(AbstractRandomness):
    """Random source of a flight or an aircraft: Threefry-2x32 of the part, the sample and the index in the draw.

    The numbers are bit-identical for an aircraft alone and in any batch.
    """

    key: UInt32[Array, "2"]  # key of a flight, or of one aircraft in a flight

    def for_aircraft(self, index: Integer) -> "SeededRandomness":
        """Return the source of one aircraft, by the aircraft's index in the fleet."""
        return SeededRandomness(fold_key(self.key, index))

    def normals(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` standard normal numbers: the inverse normal distribution function of `uniforms`."""
        return jax.scipy.special.ndtri(self.uniforms(part, number, count))

    def uniforms(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` uniform numbers: centres of 2^52 intervals of (0, 1); raises ValueError if `count` > 65,536."""
        if count > _LANES:
            raise ValueError(f"{count} random numbers at one sample; a part may draw {_LANES}")
        samples = jnp.broadcast_to(jnp.asarray(number, dtype=jnp.int32).astype(jnp.uint32), (count,))
        return draw_uniforms(self.key, part, samples, np.arange(count))


class PrescribedRandomness(AbstractRandomness):
    """Random numbers from a table, designed or recorded, for tests and replays."""

    #: Standard normals by part, shape (aircraft, samples, count), or (samples, count) for one aircraft; the first
    #: sample is `INITIAL_SAMPLE`.
    standard_normals: Mapping[int, Float[Array, "..."]]

    def for_aircraft(self, index: Integer) -> "PrescribedRandomness":
        """Return the source of one aircraft, by the aircraft's index in the fleet."""
        return PrescribedRandomness({part: numbers[index] for part, numbers in self.standard_normals.items()})

    def normals(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Return the first `count` prescribed standard normals of a part at sample `number`.

        The result is NaN after the last sample of the table. Raises ValueError if the table has no such part, or fewer
        than `count` numbers per sample.
        """
        numbers = self.standard_normals.get(part)
        if numbers is None or numbers.shape[-1] < count:
            available = "none" if numbers is None else f"{numbers.shape[-1]} a sample"
            raise ValueError(f"part {part} draws {count} random numbers a sample; {available} given for it")
        return jnp.asarray(numbers).at[jnp.asarray(number) + 1, :count].get(mode="fill", fill_value=jnp.nan)

    def uniforms(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Return the standard normal distribution function of the prescribed `normals`, in (0, 1)."""
        return jax.scipy.special.ndtr(self.normals(part, number, count))


class BlendedRandomness(AbstractRandomness):
    """Random source whose standard normals are weighted sums of the normals of several seeded sources.

    The squares of `weights` must sum to 1. Only the first `count` sources are used; `keys` are their generator keys.
    `aircraft` is the index in the fleet; None: source of the flight. The source is the state of a Markov chain that
    blends the normals of a flight with new ones (preconditioned Crank-Nicolson).
    """

    keys: UInt32[Array, "terms 2"]
    weights: Float[Array, " terms"]
    count: Integer
    aircraft: Integer | None = None

    def for_aircraft(self, index: Integer) -> "BlendedRandomness":
        """Return the source of one aircraft, by the aircraft's index in the fleet."""
        return BlendedRandomness(self.keys, self.weights, self.count, index)

    def normals(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` standard normals: weighted sums of the sources' normals for the part and the sample."""

        def add_source(k: Integer, total: Array) -> Array:
            source = SeededRandomness(self.keys[k])
            if self.aircraft is not None:
                source = source.for_aircraft(self.aircraft)
            return total + self.weights[k] * source.normals(part, number, count)

        return jax.lax.fori_loop(0, self.count, add_source, jnp.zeros(count, self.weights.dtype))

    def uniforms(self, part: int, number: Integer | int, count: int) -> Float[Array, " count"]:
        """Draw `count` uniform numbers in (0, 1): the standard normal distribution function of `normals`."""
        return jax.scipy.special.ndtr(self.normals(part, number, count))


def flight_randomness(seed: int, flight: int = 0) -> SeededRandomness:
    """Return the random source of flight number `flight` under a seed, both from 0 to 2^32 - 1."""
    key = np.array([0, seed], dtype=np.uint32)
    return SeededRandomness(as_array(fold_key(key, np.asarray(flight)), np.uint32))


def flight_keys(seed: int, flights: np.ndarray) -> np.ndarray:
    """Return the generator keys of many flight numbers under a seed, shape (flights, 2), as in `flight_randomness`."""
    zeros = np.zeros(flights.size, np.uint32)
    return np.stack(threefry(np.array([0, seed], dtype=np.uint32), zeros, flights.astype(np.uint32)), axis=-1)


def draw_uniforms(key: Any, part: int, samples: Any, lanes: np.ndarray) -> Any:
    """Draw one uniform number in (0, 1) for each pair of sample number and lane: centres of 2^52 equal intervals.

    A lane is the index of a number within the draw of one sample; `part` is the number of the part of the loop.
    """
    xp = namespace(key, samples)
    counters = lanes.astype(np.uint32) + np.uint32(part * _LANES)
    high, low = threefry(key, counters, xp.asarray(samples).astype(np.uint32))
    dtype = xp.result_type(float)
    return (high.astype(dtype) * 2.0**20 + xp.right_shift(low, np.uint32(12)).astype(dtype) + 0.5) * 2.0**-52


def fold_key(key: Any, value: Any) -> UInt32[Array, "2"]:
    """Return the key, two words, that `jax.random.fold_in` derives from a key (two words) and an integer."""
    xp = namespace(key, value)
    zero = xp.zeros((1,), dtype=np.uint32)
    return xp.concatenate(threefry(key, zero, xp.asarray(value).astype(np.uint32)[None]))


def threefry(key: Any, counter_high: Any, counter_low: Any) -> tuple[UInt32[Array, " n"], UInt32[Array, " n"]]:
    """Return two random 32-bit words for each pair of counters, by the generator Threefry-2x32 in 20 rounds.

    `key` (two words) and counters are unsigned 32-bit words. Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E.
    Shaw, *Parallel random numbers: as easy as 1, 2, 3*, SC 2011.
    """
    xp = namespace(key, counter_high, counter_low)
    keys = (key[0], key[1], key[0] ^ key[1] ^ np.uint32(_PARITY))
    x, y = xp.asarray(counter_high) + keys[0], xp.asarray(counter_low) + keys[1]
    for group in range(5):  # unrolled: a loop as in JAX is slower here
        for rotation in _ROTATIONS[group % 2]:
            x = x + y
            y = ((y << np.uint32(rotation)) | (y >> np.uint32(32 - rotation))) ^ x
        x = x + keys[(group + 1) % 3]
        y = y + keys[(group + 2) % 3] + np.uint32(group + 1)
    return x, y
