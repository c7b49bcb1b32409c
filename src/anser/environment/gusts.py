"""Gusts: velocity and rotation of the air relative to the mean wind at one aircraft."""

import abc
import itertools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Flag, Matrix33, Scalar, ScalarLike, Vector3


class Gust(eqx.Module):
    """Velocity and rotation of the air around one aircraft relative to the mean wind, body axes."""

    velocity_b: Vector3  #: Velocity of the air at the centre of gravity, m/s.
    rates_b: Vector3  #: Rotation of the air, rad/s: best fit to the gradients of the velocity over the aircraft.


class AirFlow(eqx.Module):
    """Flow at one aircraft, the input of a gust model."""

    airspeed: Scalar  #: True airspeed without gusts, m/s.
    height: Scalar  #: Height above the ground, m.
    R_bn: Matrix33  #: Rotation matrix from NED to body axes.
    wind_n: Vector3  #: Mean wind, NED, m/s.
    time: Scalar  #: Time from the start of the flight, s.


class AbstractGusts(eqx.Module):
    """Interface of the gust model of one aircraft."""

    @property
    @abc.abstractmethod
    def normals(self) -> int:
        """Number of standard normal random numbers drawn for the initial state, and again for each sample."""

    @abc.abstractmethod
    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> Any:
        """Return the initial state of the gust model; random gusts start with their stationary distribution.

        `normals` must be independent standard normal random numbers.
        """

    @abc.abstractmethod
    def at(self, state: Any, flow: AirFlow) -> Gust:
        """Return the gust at a sample; the gust is constant until the next sample."""

    @abc.abstractmethod
    def advance(self, state: Any, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> Any:
        """Return the state of the gust model after one sampling period `step` (s), with new standard normals."""


class NoGusts(AbstractGusts):
    """Gust model of smooth air: no gusts, no state and no random numbers."""

    @property
    def normals(self) -> int:
        """Number of standard normals: 0."""
        return 0

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> None:
        """Return None: smooth air has no state."""

    def at(self, state: None, flow: AirFlow) -> Gust:
        """Return a zero gust."""
        zero = jnp.zeros_like(flow.wind_n)
        return Gust(zero, zero)

    def advance(self, state: None, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> None:
        """Return None: smooth air has no state."""


class DiscreteGust(AbstractGusts):
    """1 - cos gust of MIL-F-8785C: V(x) = V_m/2 (1 - cos(pi x / d_m)), with the distance x flown in the gust."""

    amplitudes: Vector3  #: V_m along each body axis, m/s.
    length: Scalar  #: d_m, distance from the edge of the gust to its greatest velocity, m.
    start: Scalar  #: Time at which the aircraft enters the gust, s.
    returns: Flag  #: True: the gust falls to 0 from d_m to 2 d_m, as in certification; False: the gust remains at V_m.

    @property
    def normals(self) -> int:
        """Number of standard normals: 0."""
        return 0

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> Scalar:
        """Return the distance flown in the gust at the start: 0 m."""
        return jnp.zeros_like(self.length)

    def at(self, state: Scalar, flow: AirFlow) -> Gust:
        """Return the gust at the distance `state` (m) flown in the gust; the gust has no rotation."""
        part = state / self.length
        part = jnp.clip(part, 0.0, jnp.where(self.returns, 2.0, 1.0))
        return Gust(0.5 * self.amplitudes * (1.0 - jnp.cos(jnp.pi * part)), jnp.zeros_like(self.amplitudes))

    def advance(self, state: Scalar, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> Scalar:
        """Return the distance flown in the gust after one step, m."""
        return state + jnp.where(flow.time >= self.start, step * flow.airspeed, 0.0)


class SummedGusts(AbstractGusts):
    """Sum of several gust models; the state is a tuple with the state of each model."""

    parts: tuple[AbstractGusts, ...]

    @property
    def normals(self) -> int:
        """Number of standard normals that all models together draw per sample."""
        return sum(part.normals for part in self.parts)

    def _shared(self, normals: Float[Array, " count"]) -> list[Array]:
        stops = list(itertools.accumulate(part.normals for part in self.parts))
        return [normals[stop - part.normals : stop] for part, stop in zip(self.parts, stops, strict=True)]

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> tuple[Any, ...]:
        """Return a tuple of the models' initial states."""
        return tuple(
            part.init(part_normals, flow) for part, part_normals in zip(self.parts, self._shared(normals), strict=True)
        )

    def at(self, state: tuple[Any, ...], flow: AirFlow) -> Gust:
        """Return the sum of the models' gusts."""
        gusts = [part.at(part_state, flow) for part, part_state in zip(self.parts, state, strict=True)]
        velocities, rates = (
            jnp.stack(vectors) for vectors in zip(*((gust.velocity_b, gust.rates_b) for gust in gusts), strict=True)
        )
        return Gust(jnp.sum(velocities, axis=0), jnp.sum(rates, axis=0))

    def advance(
        self, state: tuple[Any, ...], normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike
    ) -> tuple[Any, ...]:
        """Return a tuple of the models' states after one sampling period `step` (s)."""
        inputs = zip(self.parts, state, self._shared(normals), strict=True)
        return tuple(part.advance(part_state, part_normals, flow, step) for part, part_state, part_normals in inputs)
