"""Guidance for control laws that come in files: commands by name, one change of them, and where the aircraft is."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from anser.control.interface import AbstractGuidance
from anser.environment import RotatingEarth
from anser.numerics import as_array
from anser.planning import AircraftPlan
from anser.sensing import Belief, Instant, velocity_over_ground_n
from anser.shapes import Scalar, ScalarLike, Vector3

LATERAL_DEVIATION, BASE_COURSE = "lateralDeviationError", "trueBaseCourseCommand"
_ROUNDING_S = 1e-9


def _arrays(values: Mapping[str, ScalarLike]) -> dict[str, Scalar]:
    return {name: as_array(value) for name, value in values.items()}


class NamedCommands(AbstractGuidance):
    """Commands by the names of a law's inputs, some of which change once.

    Attributes
    ----------
    held
        Commands from the start, SI units and radians.
    change
        What is added to some of them, from `change_time` on.
    change_time
        s.
    follows_line
        1: from `change_time` on, the lateral deviation is that from the ground track along `trueBaseCourseCommand`
        through the position at that time, the integral of V sin(course - base course) over ground; 0: it is what is
        commanded alone.
    place
        Whether latitude and longitude are given too.
    """

    held: Mapping[str, Scalar] = eqx.field(converter=_arrays)
    change: Mapping[str, Scalar] = eqx.field(default_factory=dict, converter=_arrays)
    change_time: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    follows_line: Scalar = eqx.field(default_factory=lambda: as_array(0.0), converter=as_array)
    place: bool = eqx.field(static=True, default=False)

    def init(self, belief: Belief, instant: Instant) -> Scalar:
        """Lateral deviation at the start, m."""
        return jnp.zeros(())

    def command(
        self, memory: Scalar, belief: Belief, plan: AircraftPlan | None, instant: Instant
    ) -> tuple[dict[str, Scalar], Vector3, Scalar]:
        """The commands now; no place is asked for."""
        changed = instant.time >= self.change_time - _ROUNDING_S
        given = dict(self.held)
        for name, value in self.change.items():
            given[name] = given[name] + jnp.where(changed, value, 0.0)
        if LATERAL_DEVIATION in given and BASE_COURSE in given:
            velocity_n = velocity_over_ground_n(belief.now, belief.state)
            course = given[BASE_COURSE]
            across = velocity_n[1] * jnp.cos(course) - velocity_n[0] * jnp.sin(course)
            given[LATERAL_DEVIATION] = given[LATERAL_DEVIATION] + memory
            memory = memory + instant.step * self.follows_line * jnp.where(changed, across, 0.0)
        if self.place:
            earth = instant.environment.earth
            if not isinstance(earth, RotatingEarth):
                raise TypeError(f"latitude and longitude need a RotatingEarth, not a {type(earth).__name__}")
            lat, lon, _ = earth.geodetic(belief.state.position_n)
            given |= {"geLatitude": lat, "geLongitude": jnp.arctan2(jnp.sin(lon), jnp.cos(lon))}
        return given, belief.state.position_n, memory
