"""Gusts: what is added to the mean wind at one aircraft."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.shapes import Matrix33, Scalar, ScalarLike, Vector3


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
    def at(self, memory: Any, flow: AirFlow) -> Gust:
        """The gust of a sample, which acts until the next."""

    @abc.abstractmethod
    def advance(self, memory: Any, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> Any:
        """State a sampling period (s) later."""


class NoGusts(AbstractGusts):
    """Smooth air."""

    @property
    def normals(self) -> int:
        """None are drawn."""
        return 0

    def init(self, normals: Float[Array, " count"], flow: AirFlow) -> None:
        """Nothing is kept."""

    def at(self, memory: None, flow: AirFlow) -> Gust:
        """No gust."""
        return Gust(jnp.zeros(3), jnp.zeros(3))

    def advance(self, memory: None, normals: Float[Array, " count"], flow: AirFlow, step: ScalarLike) -> None:
        """Nothing is kept."""
