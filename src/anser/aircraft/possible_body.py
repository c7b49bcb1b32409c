"""The check of an airframe that comes as an object: mass, inertia, reference lengths and area of a possible body."""

import numpy as np

from anser.aircraft.interface import AbstractAirframe
from anser.body_checks import body_faults

_LENGTHS = ("span", "wing_area", "mean_chord")
"""Attributes that airframes have where their aerodynamics need them."""


def refuse_impossible_body(airframe: AbstractAirframe, name: str) -> None:
    """Raise ValueError if an airframe has a mass, inertia, area or length that no body has.

    Parameters
    ----------
    airframe
        Of a user's own code; its numbers are known, not traced.
    name
        What the message calls it.
    """
    properties = airframe.mass_properties
    J_b = np.asarray(properties.inertia_b, dtype=float)
    if J_b.shape != (3, 3) or not np.allclose(J_b, J_b.T, rtol=0.0, atol=1e-9 * np.abs(J_b).max()):
        what = f"of shape {J_b.shape}" if J_b.shape != (3, 3) else "that is not symmetric"
        raise ValueError(f"{name}: arrived mass_properties.inertia_b {what}; expected a symmetric matrix, 3 by 3")
    positive = {"mass_properties.mass": float(properties.mass)}
    positive |= {key: float(value) for key in _LENGTHS if (value := getattr(airframe, key, None)) is not None}
    for fault in body_faults(positive, J_b.tolist()):
        where = fault.quantity if fault.quantity in positive else f"{fault.quantity} in mass_properties.inertia_b"
        raise ValueError(f"{name}: arrived {fault.arrived:.10g} as {where}; expected {fault.expected}")
    if not np.allclose(J_b @ np.asarray(properties.inertia_inverse_b, dtype=float), np.eye(3), atol=1e-6):
        words = "the inverse of mass_properties.inertia_b"
        raise ValueError(f"{name}: arrived another matrix as mass_properties.inertia_inverse_b; expected {words}")
