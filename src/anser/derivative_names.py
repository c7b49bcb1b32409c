"""Names of stability and control derivatives: a coefficient, then what it is differentiated by."""

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
"""Lift, drag, side force; moments of roll, pitch and yaw. Lift and drag are turned into body axes by alpha alone."""
BODY_COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
"""Forces along the body axes; moments of roll, pitch and yaw: as a DAVE-ML file has them, without derivatives."""
ARGUMENTS = ("0", "_alpha", "_beta", "_p", "_q", "_r", "_alpha2", "_beta2")
"""What a derivative's name ends with: factors of 1, alpha, beta, p b/2V, q c/2V, r b/2V, alpha^2, beta^2."""
STILL = ("0", "_alpha", "_alpha2")
"""Those without sideslip and rates."""
DERIVATIVES = tuple(row + column for row in COEFFICIENTS for column in ARGUMENTS)
"""Of the aircraft itself, such as `CL0` and `Cm_alpha`; those of a surface end with its name, as in `Cm_elevator`."""


def columns_of(surfaces: tuple[str, ...]) -> tuple[str, ...]:
    """What the names of an aircraft's derivatives end with: `ARGUMENTS`, then a surface each, such as `_elevator`."""
    return (*ARGUMENTS, *(f"_{name}" for name in surfaces))


def place_of(name: str, surfaces: tuple[str, ...]) -> tuple[int, int] | None:
    """Row and column of a derivative by its name, such as `Cm_alpha`; None where there is none."""
    row, ending = name[:2], name[2:]
    columns = columns_of(surfaces)
    return (COEFFICIENTS.index(row), columns.index(ending)) if row in COEFFICIENTS and ending in columns else None
