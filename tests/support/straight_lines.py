"""A planner from outside anser: straight lines."""

import jax
import jax.numpy as jnp

from anser.parts import AbstractPlanner, AbstractReference, AircraftPlan, PathPoint
from anser.shapes import Scalar, Vector3


class Line(AbstractReference):
    """A straight line at a steady velocity."""

    start_n: Vector3
    steady_n: Vector3
    since: Scalar

    def at(self, time):
        return PathPoint(self.start_n + (time - self.since) * self.steady_n, self.steady_n, jnp.zeros(3))


class StraightLines(AbstractPlanner):
    """Straight flight of each aircraft to its rendezvous, shifted by an error (NED, m), in a given duration."""

    duration: Scalar
    error_n: Vector3

    def first_plan(self, time, reports, performance):
        def one(report):
            end_n = report.goal_position_n + self.duration * report.goal_velocity_n + report.rendezvous.stand_off_n
            velocity_n = (end_n + self.error_n - report.position_n) / self.duration
            line = Line(report.position_n, velocity_n, jnp.asarray(time))
            return AircraftPlan(line, time + self.duration)

        return jax.vmap(one)(reports)
