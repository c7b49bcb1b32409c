"""Programmed test inputs of an autopilot."""

import equinox as eqx

from anser.shapes import Vector3


class Excitation(eqx.Module):
    """Programmed test input: what is added to the commands that the outer loops pass inwards.

    Flight tests excite a loop in this way to measure its margins; so does the analysis of margins here.

    Attributes
    ----------
    attitude
        Added to the wanted (mu, alpha, beta), rad.
    rates_b
        Added to the wanted (P, Q, R), rad/s.
    """

    attitude: Vector3
    rates_b: Vector3
