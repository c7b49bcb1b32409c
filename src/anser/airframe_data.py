"""Rules for the data of an airframe, without JAX.

Names of stability and control derivatives, and the conditions on mass, lengths and inertia that every rigid body
satisfies.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
"""Lift, drag, side force; moments of roll, pitch and yaw. Lift and drag are turned into body axes by alpha alone."""
BODY_COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
"""Forces along the body axes; moments of roll, pitch and yaw: as a DAVE-ML file has them, without derivatives."""
DERIVATIVE_ARGUMENTS = ("0", "_alpha", "_beta", "_p", "_q", "_r", "_alpha2", "_beta2")
"""What a derivative's name ends with: factors of 1, alpha, beta, p b/2V, q c/2V, r b/2V, alpha^2, beta^2."""
STATIC_ARGUMENTS = ("0", "_alpha", "_alpha2")
"""Those without sideslip and rates."""
DERIVATIVES = tuple(row + column for row in COEFFICIENTS for column in DERIVATIVE_ARGUMENTS)
"""Of the aircraft itself, such as `CL0` and `Cm_alpha`; those of a surface end with its name, as in `Cm_elevator`."""


def derivative_columns(surfaces: tuple[str, ...]) -> tuple[str, ...]:
    """What the names of an aircraft's derivatives end with: `ARGUMENTS`, then a surface each, such as `_elevator`."""
    return (*DERIVATIVE_ARGUMENTS, *(f"_{name}" for name in surfaces))


def derivative_index(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Row and column of a derivative by its name, such as `Cm_alpha`; None where there is none."""
    row, ending = name[:2], name[2:]
    columns = derivative_columns(surfaces)
    return (COEFFICIENTS.index(row), columns.index(ending)) if row in COEFFICIENTS and ending in columns else None


PRODUCTS: Final = {"Jxy": (0, 1), "Jxz": (0, 2), "Jyz": (1, 2)}
"""Products of inertia, such as the integral of x y over the mass: the entries of the matrix are minus these."""
_MOMENTS: Final = ("Jxx", "Jyy", "Jzz")
_ROUNDING: Final = 1e-9
"""Of the greatest moment: what a flat body, at the very bound of the triangle inequality, may miss it by."""


@dataclass(frozen=True)
class BodyFault:
    """A quantity that no body has.

    Attributes
    ----------
    quantity
        Its name as given, or "Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz".
    arrived
        Its value.
    expected
        What would be right.
    """

    quantity: str
    arrived: float
    expected: str


def body_faults(positive: Mapping[str, float], inertia: Sequence[Sequence[float]]) -> list[BodyFault]:
    """Find what makes a body impossible; none where it is possible.

    The principal moments of inertia are positive, and none exceeds the sum of the other two: both the matrix J and that
    of the second moments of mass, half the trace of J times the identity less J, have no negative eigenvalue.

    Parameters
    ----------
    positive
        Mass (kg), area (m^2) and lengths (m) by their names.
    inertia
        Matrix of inertia about the centre of mass, kg m^2; symmetric.
    """
    found = [
        BodyFault(name, value, "a positive number")
        for name, value in positive.items()
        if not (value > 0.0 and math.isfinite(value))
    ]
    return found + _inertia_faults(inertia)


def _inertia_faults(inertia: Sequence[Sequence[float]]) -> list[BodyFault]:
    moments = {name: inertia[k][k] for k, name in enumerate(_MOMENTS)}
    products = {name: -inertia[row][column] for name, (row, column) in PRODUCTS.items()}
    found = [
        BodyFault(name, value, "a positive number")
        for name, value in moments.items()
        if not (value > 0.0 and math.isfinite(value))
    ]
    found += [BodyFault(name, v, "a finite number") for name, v in products.items() if not math.isfinite(v)]
    if found:
        return found
    greatest = max(moments.values())
    for name, value in moments.items():
        others = sum(moments.values()) - value
        if value - others > _ROUNDING * greatest:
            words = " + ".join(other for other in _MOMENTS if other != name)
            found.append(BodyFault(name, value, f"at most {words}, {others:.10g} kg m^2, which no body exceeds"))
    for name, value in products.items():
        row, column = PRODUCTS[name]
        bound = math.sqrt(inertia[row][row]) * math.sqrt(inertia[column][column])
        if abs(value) >= bound:
            words = "less in size than the root of its two moments"
            expected = f"{words}, {bound:.10g} kg m^2, so that the matrix of inertia is positive definite"
            found.append(BodyFault(name, value, expected))
    if found:
        return found
    J = [[value / greatest for value in row] for row in inertia]
    half_trace = 0.5 * sum(J[k][k] for k in range(3))
    second = [[(half_trace if row == column else 0.0) - J[row][column] for column in range(3)] for row in range(3)]
    worst = max(products, key=lambda name: abs(products[name]))
    if _determinant(J) <= _ROUNDING**2:
        words = "products for which the matrix of inertia is positive definite"
        return [BodyFault(worst, products[worst], words)]
    minors = [second[j][j] * second[k][k] - second[j][k] ** 2 for j, k in PRODUCTS.values()]
    if min(*minors, _determinant(second)) < -_ROUNDING:
        words = "products for which no principal moment of inertia exceeds the sum of the other two"
        return [BodyFault(worst, products[worst], words)]
    return []


def _determinant(m: Sequence[Sequence[float]]) -> float:
    return (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    )
