"""How one aircraft differs from what its autopilot and planner know of it."""

from anser.scenario.schema_base import Table, number, table


def _factor(about: str) -> float:
    return number(f"factor on {about}", -10, 10, "", 1.0)


def _positive(about: str) -> float:
    return number(f"factor on {about}", 0.1, 10, "", 1.0)


class CoefficientFactors(Table):
    """Factors on the aerodynamic coefficients of the F-16, each on its whole table; names as in theory section 4."""

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


class Deviation(Table):
    """What flies differs so from what its autopilot and planner know; factors of 1 and a shift of 0: not at all."""

    mass: float = _positive("the mass")
    roll_inertia: float = _positive("Jxx")
    pitch_inertia: float = _positive("Jyy")
    yaw_inertia: float = _positive("Jzz")
    thrust: float = _positive("the thrust")
    actuator_bandwidth: float = _positive("the bandwidth of all actuators")
    cg_shift: float = number("shift of the centre of mass, aft", -0.2, 0.2, "of the chord", 0.0)
    coefficients: CoefficientFactors = table(
        "factors on aerodynamic coefficients", "a table [aircraft.deviation.coefficients]", CoefficientFactors()
    )
