"""A force with a moment."""

import equinox as eqx

from anser.shapes import Vector3


class Wrench(eqx.Module):
    """A force (N) and a moment about the centre of gravity (N m), both in body axes."""

    force_b: Vector3
    moment_b: Vector3

    def __add__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force_b + other.force_b, self.moment_b + other.moment_b)
