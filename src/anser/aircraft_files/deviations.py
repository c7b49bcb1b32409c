"""Deviation of an aircraft from the nominal model that its autopilot and planner assume."""

from typing import TYPE_CHECKING

from pydantic import create_model, model_validator

from anser.airframe_data import BODY_COEFFICIENTS, COEFFICIENTS, DERIVATIVES
from anser.config.errors import Problem, ScenarioError, describe_value
from anser.config.tables import Table, number, table

PRIMARY_SURFACES = ("elevator", "aileron", "rudder")
"""Control surfaces whose derivatives and effectiveness a deviation can scale."""

_MOMENT_FACTORS = {
    "roll_inertia": ("Jxx", "second_moment_y and second_moment_z"),
    "pitch_inertia": ("Jyy", "second_moment_x and second_moment_z"),
    "yaw_inertia": ("Jzz", "second_moment_x and second_moment_y"),
}
"""Keys of earlier versions, with the moment of inertia of each key and the present keys that scale the moment."""


def _factor(description: str) -> float:
    return number(f"factor on {description}", -10, 10, "", 1.0)


def _positive(description: str) -> float:
    return number(f"factor on {description}", 0.1, 10, "", 1.0)


class _F16Factors(Table):
    """Factors on the F-16's aerodynamic coefficients, each for a whole table; names as in section 4 of the theory."""

    CZ0: float = _factor("CZ0, of the angle of attack")
    CXq: float = _factor("CXq")
    CYr: float = _factor("CYr")
    CYp: float = _factor("CYp")
    CZq: float = _factor("CZq")
    Clr: float = _factor("Clr")
    Clp: float = _factor("Clp")
    Cmq: float = _factor("Cmq")
    Cnr: float = _factor("Cnr")
    Cnp: float = _factor("Cnp")
    CX0: float = _factor("CX0, of angle of attack and elevator")
    Cm0: float = _factor("Cm0, of angle of attack and elevator")
    Clda: float = _factor("Cl per aileron")
    Cldr: float = _factor("Cl per rudder")
    Cnda: float = _factor("Cn per aileron")
    Cndr: float = _factor("Cn per rudder")
    Cl0: float = _factor("Cl0, of angle of attack and sideslip")
    Cn0: float = _factor("Cn0, of angle of attack and sideslip")
    CYb: float = _factor("CY per sideslip")
    CYda: float = _factor("CY per aileron")
    CYdr: float = _factor("CY per rudder")
    CZde: float = _factor("CZ per elevator")


F16_FACTORS = tuple(_F16Factors.model_fields)
_FILE_FACTORS = (*DERIVATIVES, *(f"{row}_{name}" for name in PRIMARY_SURFACES for row in COEFFICIENTS))
_FILE_ONLY_FACTORS = [name for name in _FILE_FACTORS if name not in F16_FACTORS]

if TYPE_CHECKING:
    CoefficientFactors = _F16Factors
else:
    CoefficientFactors = create_model(
        "CoefficientFactors",
        __base__=_F16Factors,
        __module__=__name__,
        __doc__="Factors on aerodynamic coefficients: of the F-16, of an aircraft file's derivatives or DAVE-ML.",
        **{name: (float, _factor(f"{name} of an aircraft file")) for name in _FILE_ONLY_FACTORS},
        **{name: (float, _factor(f"all of {name} of an aircraft by DAVE-ML")) for name in BODY_COEFFICIENTS},
    )


def _newer_factor(description: str, low: float) -> float:
    return number(f"factor on {description}", low, 10, "", 1.0, omit_default=True)


class SurfaceEffectiveness(Table):
    """Factors on the deflections of the control surfaces as the air meets them; commands and stops are unchanged."""

    elevator: float = _newer_factor("the effective deflection of the elevator", 0)
    aileron: float = _newer_factor("the effective deflection of the aileron", 0)
    rudder: float = _newer_factor("the effective deflection of the rudder", 0)


class Deviation(Table):
    """Difference of the flying aircraft from its nominal model; default: none (factors of 1, no shift)."""

    mass: float = _positive("the mass")
    second_moment_x: float = _positive("the integral of x^2 over the mass, a part of Jyy and Jzz")
    second_moment_y: float = _positive("the integral of y^2 over the mass, a part of Jxx and Jzz")
    second_moment_z: float = _positive("the integral of z^2 over the mass, a part of Jxx and Jyy")
    thrust: float = _positive("the thrust")
    actuator_bandwidth: float = _positive("the bandwidth of all actuators")
    cg_shift: float = number("shift of the centre of mass, aft", -0.2, 0.2, "of the chord", 0.0)
    drag: float = _newer_factor("the drag", 0.1)
    lift_slope: float = _newer_factor("the lift, so on its slope by the angle of attack", 0.1)
    surface_effectiveness: SurfaceEffectiveness = table(
        "effectiveness of control surfaces",
        "a table such as { elevator = 0.5 }",
        SurfaceEffectiveness(),
        omit_default=True,
    )
    coefficients: CoefficientFactors = table(
        "factors on aerodynamic coefficients", "a table [aircraft.deviation.coefficients]", CoefficientFactors()
    )

    @property
    def second_moments(self) -> tuple[float, float, float]:
        """Factors on the integrals of x^2, y^2 and z^2 over the mass, in body axes."""
        return self.second_moment_x, self.second_moment_y, self.second_moment_z

    @property
    def changes_forces(self) -> bool:
        """Whether the effectiveness of a surface, the drag or the lift slope has a factor other than 1."""
        return self.surface_effectiveness != SurfaceEffectiveness() or (self.drag, self.lift_slope) != (1.0, 1.0)

    @model_validator(mode="before")
    @classmethod
    def _without_moment_factors(cls, values: object) -> object:
        """Remove factors of 1 on moments of inertia (keys of older files); raise ScenarioError for other factors."""
        if not isinstance(values, dict):
            return values
        problems = [
            Problem(
                key,
                describe_value(values[key]),
                f"nothing: factors on the second moments of mass, {second_moments}, make {moment}",
            )
            for key, (moment, second_moments) in _MOMENT_FACTORS.items()
            if key in values and values[key] != 1.0
        ]
        if problems:
            raise ScenarioError("", problems)
        return {key: value for key, value in values.items() if key not in _MOMENT_FACTORS}
