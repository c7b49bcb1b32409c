"""Gusts: what is added to the mean wind at one aircraft."""

import abc
import itertools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Flag, Matrix33, Scalar, ScalarLike, Vector3


class Gust(eqx.Module):
    """Gust at one aircraft.

    Attributes
    ----------
    velocity_b
        Of the air beyond the mean wind, body axes, m/s.
    rates_b
        Equivalent rotation of the air, body axes, rad/s.
    """

    velocity_b: Vector3
    rates_b: Vector3


class AirFlow(eqx.Module):
    """What the gusts at one aircraft depend on, at one instant.

    Attributes
    ----------
    airspeed
        True airspeed without gusts, m/s.
    height
        Above the ground, m.
    R_bn
        Rotation NED to body.
    wind_n
        Mean wind, m/s.
    time
        s.
    """

    airspeed: Scalar
    height: Scalar
    R_bn: Matrix33
    wind_n: Vector3
    time: Scalar


class AbstractGusts(eqx.Module):
    """Gusts that one aircraft meets; concrete ones are final."""

    @property
    @abc.abstractmethod
    def normals(self) -> int:
        """How many standard normal numbers are drawn at each sample, and once before the first."""

    @abc.abstractmethod
    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> Any:
        """State before the first sample, of gusts that have been blowing for long."""

    @abc.abstractmethod
    def at(self, state: Any, flow: AirFlow) -> Gust:
        """The gust of a sample, which acts until the next."""

    @abc.abstractmethod
    def advance(self, state: Any, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> Any:
        """State a sampling period (s) later."""


class NoGusts(AbstractGusts):
    """Smooth air."""

    @property
    def normals(self) -> int:
        """None are drawn."""
        return 0

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> None:
        """Nothing is kept."""

    def at(self, state: None, flow: AirFlow) -> Gust:
        """No gust."""
        none = jnp.zeros_like(flow.wind_n)
        return Gust(none, none)

    def advance(self, state: None, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> None:
        """Nothing is kept."""


class DiscreteGust(AbstractGusts):
    """A gust of the form 1 - cos by MIL-F-8785C: V(x) = V_m/2 (1 - cos(pi x / d_m)) on the way x from its edge on.

    Attributes
    ----------
    amplitudes
        V_m along the body axes, m/s.
    length
        d_m, m.
    start
        When its edge is met, s.
    returns
        Whether it dies down again as it grew, over d_m to 2 d_m, as in gusts for certification; else it stays.
    """

    amplitudes: Vector3
    length: Scalar
    start: Scalar
    returns: Flag

    @property
    def normals(self) -> int:
        """None are drawn."""
        return 0

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> Scalar:
        """The way flown in it, m: none."""
        return jnp.zeros_like(self.length)

    def at(self, state: Scalar, flow: AirFlow) -> Gust:
        """See `AbstractGusts`; without rotation."""
        part = state / self.length
        part = jnp.clip(part, 0.0, jnp.where(self.returns, 2.0, 1.0))
        return Gust(0.5 * self.amplitudes * (1.0 - jnp.cos(jnp.pi * part)), jnp.zeros_like(self.amplitudes))

    def advance(self, state: Scalar, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> Scalar:
        """The way flown in it, m."""
        return state + jnp.where(flow.time >= self.start, step * flow.airspeed, 0.0)


class SummedGusts(AbstractGusts):
    """Several kinds of gusts at once."""

    parts: tuple[AbstractGusts, ...]

    @property
    def normals(self) -> int:
        """Of all parts."""
        return sum(part.normals for part in self.parts)

    def _shared(self, normals: Float[Array, " count"]) -> list[Array]:
        ends = list(itertools.accumulate(part.normals for part in self.parts))
        return [normals[end - part.normals : end] for part, end in zip(self.parts, ends, strict=True)]

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> tuple[Any, ...]:
        """Of each part."""
        return tuple(part.init(own, flow) for part, own in zip(self.parts, self._shared(normals), strict=True))

    def at(self, state: tuple[Any, ...], flow: AirFlow) -> Gust:
        """The sum."""
        gusts = [part.at(own, flow) for part, own in zip(self.parts, state, strict=True)]
        velocities, rates = (
            jnp.stack(rows) for rows in zip(*((one.velocity_b, one.rates_b) for one in gusts), strict=True)
        )
        return Gust(jnp.sum(velocities, axis=0), jnp.sum(rates, axis=0))

    def advance(
        self, state: tuple[Any, ...], normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike
    ) -> tuple[Any, ...]:
        """Of each part."""
        rows = zip(self.parts, state, self._shared(normals), strict=True)
        return tuple(part.advance(own, drawn, flow, step) for part, own, drawn in rows)
