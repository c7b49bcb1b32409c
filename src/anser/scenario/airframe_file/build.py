"""From the file of an aircraft to its airframe: here input units end and arrays begin."""

import functools
import math

import equinox as eqx
import numpy as np

from anser.aircraft import (
    NEVER,
    AbstractActuators,
    AbstractEngine,
    DerivativeAircraft,
    DerivativeDispersion,
    ElectricPropeller,
    FirstOrderActuators,
    JetEngine,
    MassProperties,
    NoEngine,
    PistonPropeller,
    SecondOrderActuators,
    Validity,
    dispersed_derivative_aircraft,
)
from anser.derivative_names import ARGUMENTS, COEFFICIENTS
from anser.numerics import Tables, as_array, make_axes, make_tables
from anser.scenario.airframe_file import schema_engine
from anser.scenario.airframe_file.schema import AirframeFile, place_of_table
from anser.scenario.schema_base import content_hash
from anser.scenario.schema_deviation import Deviation
from anser.shapes import Scalar, Vector3
from anser.units import DEG_RAD, RAD_DEG

_RPM_RAD_S = 2.0 * math.pi / 60.0
_ANYWHERE_M, _ANY_MACH = (-1e5, 1e5), (-1.0, 1e2)
"""Axes of thrust that depends on nothing: no flight leaves them."""


def build_airframe(file: AirframeFile) -> DerivativeAircraft:
    """Build the airframe of a file; files of the same content give the same object."""
    return _built(content_hash(file), _Held(file))


class _Held:
    """A file as an argument that a cache does not look at: its content's hash stands beside it."""

    def __init__(self, file: AirframeFile) -> None:
        self.file = file

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held)


@functools.lru_cache(maxsize=64)
def _built(_: str, held: _Held) -> DerivativeAircraft:
    file = held.file
    geometry, aero, valid = file.geometry, file.aerodynamics, file.validity
    aspect = geometry.span_m**2 / geometry.wing_area_m2
    tables, places = _tables(file)
    return DerivativeAircraft(
        mass_properties=_mass_properties(file),
        actuators=_actuators(file),
        engine=_engine(file),
        alpha_range=_ends(valid.alpha_deg, DEG_RAD),
        beta_range=_ends(valid.beta_deg, DEG_RAD),
        span=as_array(geometry.span_m),
        wing_area=as_array(geometry.wing_area_m2),
        mean_chord=as_array(geometry.mean_chord_m),
        cg_offset_b=as_array(geometry.cg_offset_m),
        derivatives=as_array(_derivatives(file)),
        induced_drag=as_array(0.0 if aero.oswald is None else 1.0 / (math.pi * aero.oswald * aspect)),
        stall_sharpness=as_array(aero.stall_sharpness),
        stall_alpha=as_array(NEVER if aero.stall_alpha_deg is None else aero.stall_alpha_deg * DEG_RAD),
        validity=Validity(_ends(valid.airspeed_m_s), _ends(valid.altitude_m), _ends(valid.mach)),
        tables=tables,
        table_factors=None if tables is None else as_array(np.ones(len(places))),
        table_places=places,
        table_arguments=_arguments(file),
    )


def _ends(ends: tuple[float, float] | None, factor: float = 1.0) -> tuple[Scalar, Scalar]:
    low, high = (-math.inf, math.inf) if ends is None else ends
    return as_array(low * factor), as_array(high * factor)


def _mass_properties(file: AirframeFile) -> MassProperties:
    inertia_b = np.asarray(file.mass.inertia)
    return MassProperties(
        mass=as_array(file.mass.mass_kg),
        inertia_b=as_array(inertia_b),
        inertia_inverse_b=as_array(np.linalg.inv(inertia_b)),
        spin_momentum_b=as_array([file.mass.spin_momentum_kg_m2_s, 0.0, 0.0]),
    )


def _actuators(file: AirframeFile) -> AbstractActuators:
    lower, upper = zip(*(one.stops_deg for one in file.surface), strict=True)
    lower, upper = (as_array(np.asarray(stops) * DEG_RAD) for stops in (lower, upper))
    rates = as_array(np.asarray([one.rate_limit_deg_s for one in file.surface]) * DEG_RAD)
    lags = [one.lag_s for one in file.surface if one.lag_s is not None]
    if lags:
        return FirstOrderActuators(as_array(lags), lower, upper, rates, file.surfaces)
    pairs = [(one.frequency_rad_s, one.damping) for one in file.surface]
    frequency, damping = np.asarray(pairs, dtype=float).T
    return SecondOrderActuators(  # pyright: ignore[reportCallIssue] - its time constant is a property
        as_array(frequency), as_array(damping), lower, upper, rates, file.surfaces
    )


def per_angle(file: AirframeFile) -> np.ndarray:
    """Factors, by column, from derivatives as the file gives them to those per rad."""
    turn = RAD_DEG if file.aerodynamics.per == "deg" else 1.0
    own = {"_alpha": turn, "_beta": turn, "_alpha2": turn**2, "_beta2": turn**2}
    return np.asarray([*(own.get(column, 1.0) for column in ARGUMENTS), *[turn] * len(file.surface)])


def _derivatives(file: AirframeFile) -> np.ndarray:
    rows = [
        [
            *(getattr(file.aerodynamics, row + column) for column in ARGUMENTS),
            *(getattr(surface, row) for surface in file.surface),
        ]
        for row in COEFFICIENTS
    ]
    return np.asarray(rows) * per_angle(file)


def _axes(file: AirframeFile) -> dict[tuple[str, tuple[float, ...], bool], int]:
    """The different axes of all tables: what along, breakpoints, whether the ends are held; each with its number."""
    found: dict[tuple[str, tuple[float, ...], bool], int] = {}
    for one in file.table:
        for name, points in zip(one.over, one.breakpoints_deg, strict=True):
            found.setdefault((name, points, one.beyond == "hold"), len(found))
    return found


def _arguments(file: AirframeFile) -> tuple[int, ...]:
    """Place of what each axis is along in alpha, beta, surfaces."""
    inputs = ("alpha", "beta", *file.surfaces)
    return tuple(inputs.index(name) for name, _, _ in _axes(file))


def _tables(file: AirframeFile) -> tuple[Tables | None, tuple[tuple[int, int], ...]]:
    if not file.table:
        return None, ()
    axes, scale = _axes(file), per_angle(file)
    groups: dict[tuple[int, ...], list[tuple[np.ndarray, tuple[int, int]]]] = {}
    for one in file.table:
        along = tuple(
            axes[name, points, one.beyond == "hold"] for name, points in zip(one.over, one.breakpoints_deg, strict=True)
        )
        place = place_of_table(one.replaces, file.surfaces)
        if place is None:
            raise ValueError(f"table of {one.replaces!r}: no such coefficient")  # the schema refuses it
        values = np.asarray(one.values, dtype=float) * (scale[place[1]] if one.replaces not in COEFFICIENTS else 1.0)
        groups.setdefault(along, []).append((values, place))
    tables = make_tables(
        make_axes([np.asarray(points) * DEG_RAD for _, points, _ in axes], clamp=[held for _, _, held in axes]),
        [(along, [values for values, _ in functions]) for along, functions in groups.items()],
    )
    return tables, tuple(place for functions in groups.values() for _, place in functions)


def _engine(file: AirframeFile) -> AbstractEngine:
    engine = file.engine
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


def with_derivatives(airframe: DerivativeAircraft, file: AirframeFile, instead: dict[str, float]) -> DerivativeAircraft:
    """Airframe with other values of some derivatives, in the file's units."""
    values, scale = np.array(airframe.derivatives), per_angle(file)
    for name, value in instead.items():
        column = ARGUMENTS.index(name[2:])
        values[COEFFICIENTS.index(name[:2]), column] = value * scale[column]
    return eqx.tree_at(lambda a: a.derivatives, airframe, as_array(values))


def dispersed_airframe(airframe: DerivativeAircraft, deviation: Deviation) -> DerivativeAircraft:
    """Airframe that differs as a scenario says; factors by name are those on `DerivativeAircraft.derivatives`."""
    surfaces = airframe.actuators.names
    names = [
        [row + column for column in (*ARGUMENTS, *(f"_{surface}" for surface in surfaces))] for row in COEFFICIENTS
    ]
    factors = np.asarray([[getattr(deviation.coefficients, name, 1.0) for name in row] for row in names])
    return dispersed_derivative_aircraft(
        airframe,
        DerivativeDispersion(
            derivatives=as_array(factors),
            tables=as_array([factors[place] for place in airframe.table_places]) if airframe.table_places else None,
            thrust=as_array(deviation.thrust),
            mass=as_array(deviation.mass),
            inertia=as_array([deviation.roll_inertia, deviation.pitch_inertia, deviation.yaw_inertia]),
            actuator_bandwidth=as_array(deviation.actuator_bandwidth),
            cg_shift=as_array(deviation.cg_shift),
        ),
    )
