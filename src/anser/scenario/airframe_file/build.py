"""From the file of an aircraft to its airframe: here input units end and arrays begin."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import overload

import numpy as np

from anser.aircraft import (
    NEVER,
    BodyDispersion,
    DaveMlAircraft,
    DerivativeAircraft,
    DerivativeDispersion,
    dispersed_dave_ml_aircraft,
    dispersed_derivative_aircraft,
)
from anser.derivative_names import ARGUMENTS, BODY_COEFFICIENTS, COEFFICIENTS, STILL, columns_of
from anser.numerics import Tables, as_array, make_axes, make_tables
from anser.scenario.airframe_file.build_dave_ml import build_dave_ml
from anser.scenario.airframe_file.build_parts import (
    build_actuators,
    build_ends,
    build_engine,
    build_mass,
    build_validity,
)
from anser.scenario.airframe_file.schema import AirframeFile, place_of_table
from anser.scenario.airframe_file.schema_dave_ml import DaveMlFile
from anser.scenario.schema_base import content_hash
from anser.scenario.schema_deviation import Deviation
from anser.units import DEG_RAD, RAD_DEG


@overload
def build_airframe(file: AirframeFile) -> DerivativeAircraft: ...
@overload
def build_airframe(file: DaveMlFile) -> DaveMlAircraft: ...
@overload
def build_airframe(file: AirframeFile | DaveMlFile) -> DerivativeAircraft | DaveMlAircraft: ...
def build_airframe(file: AirframeFile | DaveMlFile) -> DerivativeAircraft | DaveMlAircraft:
    """Build the airframe of a file; files of the same content give the same object."""
    return _built(content_hash(file), _Held(file))


class _Held:
    """A file as an argument that a cache does not look at: its content's hash stands beside it."""

    def __init__(self, file: AirframeFile | DaveMlFile) -> None:
        self.file = file

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held)


@functools.lru_cache(maxsize=64)
def _built(_: str, held: _Held) -> DerivativeAircraft | DaveMlAircraft:
    file = held.file
    return build_dave_ml(file) if isinstance(file, DaveMlFile) else _of_derivatives(file)


def _of_derivatives(file: AirframeFile) -> DerivativeAircraft:
    geometry, aero, valid = file.geometry, file.aerodynamics, file.validity
    aspect = geometry.span_m**2 / geometry.wing_area_m2
    tables, places = _tables(file)
    derivatives = _derivatives(file)
    return DerivativeAircraft(
        mass_properties=build_mass(file.mass),
        actuators=build_actuators(file.surface),
        engine=build_engine(file.engine),
        alpha_range=build_ends(valid.alpha_deg, DEG_RAD),
        beta_range=build_ends(valid.beta_deg, DEG_RAD),
        span=as_array(geometry.span_m),
        wing_area=as_array(geometry.wing_area_m2),
        mean_chord=as_array(geometry.mean_chord_m),
        cg_offset_b=as_array(geometry.cg_offset_m),
        derivatives=as_array(derivatives),
        induced_drag=as_array(0.0 if aero.oswald is None else 1.0 / (math.pi * aero.oswald * aspect)),
        stall_sharpness=as_array(aero.stall_sharpness),
        stall_alpha=as_array(NEVER if aero.stall_alpha_deg is None else aero.stall_alpha_deg * DEG_RAD),
        validity=build_validity(valid),
        tables=tables,
        table_factors=None if tables is None else as_array(np.ones(len(places))),
        table_places=places,
        table_arguments=_arguments(file),
        still_side_force=_has_still_side_force(derivatives, places),
    )


def _has_still_side_force(derivatives: np.ndarray, places: Sequence[tuple[int, int]]) -> bool:
    """Whether the side force has a part that neither sideslip nor a rate or a deflection makes."""
    row = COEFFICIENTS.index("CY")
    still = [column for column, name in enumerate(ARGUMENTS) if name in STILL]
    return bool(np.any(derivatives[row, still])) or any(
        place in {(row, column) for column in still} for place in places
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


def with_derivatives(airframe: DerivativeAircraft, file: AirframeFile, instead: dict[str, float]) -> DerivativeAircraft:
    """Airframe with other values of some derivatives, in the file's units."""
    values, scale = np.array(airframe.derivatives), per_angle(file)
    for name, value in instead.items():
        column = ARGUMENTS.index(name[2:])
        values[COEFFICIENTS.index(name[:2]), column] = value * scale[column]
    still = _has_still_side_force(values, airframe.table_places)
    return dataclasses.replace(airframe, derivatives=as_array(values), still_side_force=still)


def dispersed_airframe(
    airframe: DerivativeAircraft | DaveMlAircraft, deviation: Deviation
) -> DerivativeAircraft | DaveMlAircraft:
    """Airframe that differs as a scenario says; factors are on `DerivativeAircraft.derivatives`, or on CX to Cn."""
    body = BodyDispersion(
        thrust=as_array(deviation.thrust),
        mass=as_array(deviation.mass),
        second_moments=as_array(deviation.second_moments),
        actuator_bandwidth=as_array(deviation.actuator_bandwidth),
        cg_shift=as_array(deviation.cg_shift),
    )
    given = deviation.coefficients
    if isinstance(airframe, DaveMlAircraft):
        whole = as_array([getattr(given, name) for name in BODY_COEFFICIENTS])
        return dispersed_dave_ml_aircraft(airframe, whole, body)
    columns = columns_of(airframe.actuators.names)
    factors = np.asarray([[getattr(given, row + column, 1.0) for column in columns] for row in COEFFICIENTS])
    tables = as_array([factors[place] for place in airframe.table_places]) if airframe.table_places else None
    return dispersed_derivative_aircraft(airframe, DerivativeDispersion(as_array(factors), tables, body))
