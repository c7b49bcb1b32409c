"""Parts that aircraft files of every kind have: mass, actuators, engine, ranges; input units end and arrays begin."""

import math
from collections.abc import Sequence

import numpy as np

from anser.aircraft import (
    AbstractActuators,
    AbstractEngine,
    ElectricPropeller,
    FirstOrderActuators,
    JetEngine,
    MassProperties,
    NoEngine,
    PistonPropeller,
    SecondOrderActuators,
    Validity,
)
from anser.numerics import as_array, make_axes, make_tables
from anser.scenario.airframe_file import schema_body, schema_engine
from anser.shapes import Scalar, Vector3
from anser.units import DEG_RAD

_RPM_RAD_S = 2.0 * math.pi / 60.0
_ANYWHERE_M, _ANY_MACH = (-1e5, 1e5), (-1.0, 1e2)
"""Axes of thrust that depends on nothing: no flight leaves them."""


def build_ends(ends: tuple[float, float] | None, factor: float = 1.0) -> tuple[Scalar, Scalar]:
    """Least and greatest value; infinite where there are none."""
    low, high = (-math.inf, math.inf) if ends is None else ends
    return as_array(low * factor), as_array(high * factor)


def build_validity(valid: schema_body.Validity) -> Validity:
    """Where the data hold."""
    return Validity(build_ends(valid.airspeed_m_s), build_ends(valid.altitude_m), build_ends(valid.mach))


def build_mass(mass: schema_body.Mass) -> MassProperties:
    """Mass and inertia."""
    inertia_b = np.asarray(mass.inertia)
    return MassProperties(
        mass=as_array(mass.mass_kg),
        inertia_b=as_array(inertia_b),
        inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
        spin_momentum_b=as_array([mass.spin_momentum_kg_m2_s, 0.0, 0.0]),
    )


def build_actuators(surface: Sequence[schema_body.Actuated]) -> AbstractActuators:
    """Actuators of surfaces, all of one order."""
    names = tuple(one.name for one in surface)
    lower, upper = zip(*(one.stops_deg for one in surface), strict=True)
    lower, upper = (as_array(np.asarray(stops) * DEG_RAD) for stops in (lower, upper))
    rates = as_array(np.asarray([one.rate_limit_deg_s for one in surface]) * DEG_RAD)
    lags = [one.lag_s for one in surface if one.lag_s is not None]
    if lags:
        return FirstOrderActuators(as_array(lags), lower, upper, rates, names)
    pairs = [(one.frequency_rad_s, one.damping) for one in surface]
    frequency, damping = np.asarray(pairs, dtype=float).T
    return SecondOrderActuators(  # pyright: ignore[reportCallIssue] - its time constant is a property
        as_array(frequency), as_array(damping), lower, upper, rates, names
    )


def build_engine(engine: schema_engine.Engine | None) -> AbstractEngine:
    """Engine of one of the kinds, or none."""
    if engine is None:
        return NoEngine()
    if engine.jet is not None:
        return _jet(engine.jet)
    if engine.electric_propeller is not None:
        return _electric(engine.electric_propeller)
    if engine.piston_propeller is not None:
        return _piston(engine.piston_propeller)
    raise ValueError("an engine of no kind")  # the schema refuses it


def _common(lag_s: float, point_m: tuple[float, float, float]) -> tuple[Scalar, Vector3, Scalar]:
    return as_array(lag_s), as_array(point_m), as_array(1.0)


def _jet(jet: schema_engine.Jet) -> JetEngine:
    altitudes, machs = (jet.altitude_m, jet.mach) if jet.mach else (_ANYWHERE_M, _ANY_MACH)
    shape = len(altitudes), len(machs)
    thrusts = [np.broadcast_to(np.asarray(one, dtype=float), shape) for one in (jet.idle_N, jet.full_N)]
    tables = make_tables(make_axes([altitudes, machs], clamp=True), [((0, 1), thrusts)])
    return JetEngine(tables, *_common(jet.lag_s, jet.point_m))


def _electric(propeller: schema_engine.ElectricPropeller) -> ElectricPropeller:
    return ElectricPropeller(
        diameter=as_array(propeller.diameter_m),
        thrust_polynomial=as_array(propeller.thrust_coefficients),
        torque_polynomial=as_array(propeller.torque_coefficients),
        motor_constant=as_array(1.0 / (propeller.speed_constant_rpm_V * _RPM_RAD_S)),
        resistance=as_array(propeller.resistance_ohm),
        no_load_current=as_array(propeller.no_load_current_A),
        voltage_max=as_array(propeller.voltage_V),
        direction=as_array(1.0 if propeller.direction == "right" else -1.0),
        lag=as_array(propeller.lag_s),
        point_b=as_array(propeller.point_m),
        thrust_factor=as_array(1.0),
    )


def _piston(piston: schema_engine.PistonPropeller) -> PistonPropeller:
    reaction = 0.0 if piston.speed_rpm is None else 1.0 / (piston.speed_rpm * _RPM_RAD_S)
    lag, point_b, factor = _common(piston.lag_s, piston.point_m)
    return PistonPropeller(
        shaft_power=as_array(piston.shaft_power_W),
        efficiency=as_array(piston.efficiency),
        static_thrust=as_array(piston.static_thrust_N),
        torque_per_power=as_array(-reaction if piston.direction == "right" else reaction),
        lag=lag,
        point_b=point_b,
        thrust_factor=factor,
    )
