"""Names of aerodynamic derivatives, and validity checks of an airframe's mass, lengths and inertia, without JAX."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
"""Coefficients of lift, drag and side force, then of the moments of roll, pitch and yaw.

Lift and drag are turned into body axes by alpha alone, not by beta."""
BODY_COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
"""Coefficients of DAVE-ML aircraft: forces along the body axes x, y, z, then moments of roll, pitch and yaw."""
DERIVATIVE_ARGUMENTS = ("0", "_alpha", "_beta", "_p", "_q", "_r", "_alpha2", "_beta2")
"""Endings of derivative names; a derivative multiplies 1, alpha, beta, p b/2V, q c/2V, r b/2V, alpha^2 or beta^2."""
STATIC_ARGUMENTS = ("0", "_alpha", "_alpha2")
"""Endings of the derivatives that act without sideslip and without body rates."""
DERIVATIVES = tuple(coefficient + argument for coefficient in COEFFICIENTS for argument in DERIVATIVE_ARGUMENTS)
"""Names of the derivatives by motion, not by control surfaces: `CL0`, `CL_alpha`, ... (by a surface: `Cm_elevator`)."""


def derivative_columns(surfaces: tuple[str, ...]) -> tuple[str, ...]:
    """Return the endings of derivative names: `DERIVATIVE_ARGUMENTS`, then one such as `_elevator` for each surface."""
    return (*DERIVATIVE_ARGUMENTS, *(f"_{name}" for name in surfaces))


def derivative_index(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Return the indices of a derivative (`Cm_alpha`) in `COEFFICIENTS` and `derivative_columns`; None if unknown."""
    coefficient, ending = name[:2], name[2:]
    columns = derivative_columns(surfaces)
    return (
        (COEFFICIENTS.index(coefficient), columns.index(ending))
        if coefficient in COEFFICIENTS and ending in columns
        else None
    )


PRODUCTS: Final = {"Jxy": (0, 1), "Jxz": (0, 2), "Jyz": (1, 2)}
"""Row and column of each product of inertia in the matrix J, whose element is -Jxy for Jxy = integral of x y dm."""
_MOMENTS: Final = ("Jxx", "Jyy", "Jzz")
_ROUNDING: Final = 1e-9
"""Tolerance of the inertia checks, relative to the greatest moment: a flat body meets the bound exactly."""


@dataclass(frozen=True)
class BodyFault:
    """A physically impossible quantity of a rigid body."""

    quantity: str  # name of the mass, area, length or element of the inertia matrix ("Jxx", "Jyy", "Jxy", ...)
    arrived: float  # rejected value
    expected: str  # description of an acceptable value


def body_faults(positive: Mapping[str, float], inertia: Sequence[Sequence[float]]) -> list[BodyFault]:
    """Return the reasons why a rigid body is physically impossible; an empty list for a valid body.

    The principal moments of inertia must be positive, and none may exceed the sum of the two others.

    Parameters
    ----------
    positive
        Mass (kg), area (m^2) and lengths (m) by name.
    inertia
        Matrix of inertia about the centre of mass, kg m^2; symmetric.
    """
    faults = [
        BodyFault(name, value, "a positive number")
        for name, value in positive.items()
        if not (value > 0.0 and math.isfinite(value))
    ]
    return faults + _inertia_faults(inertia)


def _inertia_faults(inertia: Sequence[Sequence[float]]) -> list[BodyFault]:
    moments = {name: inertia[k][k] for k, name in enumerate(_MOMENTS)}
    products = {name: -inertia[i][column] for name, (i, column) in PRODUCTS.items()}
    faults = [
        BodyFault(name, value, "a positive number")
        for name, value in moments.items()
        if not (value > 0.0 and math.isfinite(value))
    ]
    faults += [BodyFault(name, v, "a finite number") for name, v in products.items() if not math.isfinite(v)]
    if faults:
        return faults
    greatest = max(moments.values())
    for name, value in moments.items():
        sum_of_two = sum(moments.values()) - value
        if value - sum_of_two > _ROUNDING * greatest:
            condition = " + ".join(axis_name for axis_name in _MOMENTS if axis_name != name)
            faults.append(
                BodyFault(name, value, f"at most {condition}, {sum_of_two:.10g} kg m^2, which no body exceeds")
            )
    for name, value in products.items():
        i, column = PRODUCTS[name]
        bound = math.sqrt(inertia[i][i]) * math.sqrt(inertia[column][column])
        if abs(value) >= bound:
            condition = "less in size than the root of its two moments"
            expected = f"{condition}, {bound:.10g} kg m^2, so that the matrix of inertia is positive definite"
            faults.append(BodyFault(name, value, expected))
    if faults:
        return faults
    J = [[value / greatest for value in i] for i in inertia]
    half_trace = 0.5 * sum(J[k][k] for k in range(3))
    second_moments = [[(half_trace if i == column else 0.0) - J[i][column] for column in range(3)] for i in range(3)]
    worst = max(products, key=lambda name: abs(products[name]))
    if _determinant(J) <= _ROUNDING**2:
        condition = "products for which the matrix of inertia is positive definite"
        return [BodyFault(worst, products[worst], condition)]
    minors = [second_moments[j][j] * second_moments[k][k] - second_moments[j][k] ** 2 for j, k in PRODUCTS.values()]
    if min(*minors, _determinant(second_moments)) < -_ROUNDING:
        condition = "products for which no principal moment of inertia exceeds the sum of the other two"
        return [BodyFault(worst, products[worst], condition)]
    return []


def _determinant(m: Sequence[Sequence[float]]) -> float:
    return (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    )
