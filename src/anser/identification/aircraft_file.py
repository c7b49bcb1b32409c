"""Aircraft file with estimated derivatives; mass, geometry, actuators and engine come from an existing aircraft."""

import json
import re
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.actuators import SecondOrderActuators
from anser.aircraft.air_data import AirData
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import reference_lengths
from anser.aircraft.engines import NoEngine
from anser.aircraft_files.schema import AirframeFile
from anser.airframe_data import COEFFICIENTS, DERIVATIVE_ARGUMENTS, PRODUCTS
from anser.compiling.options import compiled_quickly
from anser.environment.atmosphere import StandardAtmosphere
from anser.identification.records import FlightRecord
from anser.numerics.arrays import as_array
from anser.units import RAD_DEG

_ALTITUDES_M, _MACHS = np.linspace(0.0, 15_000.0, 6), np.linspace(0.0, 1.0, 6)
"""Altitudes (m) and Mach numbers of the thrust tables, for an engine that no aircraft file describes."""
_JET_ASSUMED = "power in proportion to the throttle, thrust by a straight line from idle to full power, and one lag"
"""Text on the assumed engine model, for an engine that no aircraft file describes."""
_ACTUATOR_KEYS = (
    *("name", "limit_deg", "lower_deg", "upper_deg", "rate_limit_deg_s"),
    *("lag_s", "frequency_rad_s", "damping"),
)
_ALPHA_MARGIN_DEG, _BETA_MARGIN_DEG, _SPEED_SHARE = 3.0, 8.0, 0.2
"""Margins of the range of validity beyond the range of the record: alpha, beta (deg), fraction of the airspeed."""


def aircraft_file_text(
    name: str,
    record: FlightRecord,
    airframe: AbstractAirframe,
    file: AirframeFile | None,
    estimated: Mapping[str, float],
    assumed: Mapping[str, float],
    source: str,
) -> str:
    """Return the text of an aircraft file with estimated derivatives.

    Parameters
    ----------
    name
        Name of the aircraft: small letters, digits, hyphens.
    record
        Record from which the derivatives are estimated; gives the range of validity in airspeed, alpha and beta.
    airframe
        Aircraft that gives mass properties, lengths, actuators and engine.
    file
        Aircraft file of `airframe`; None: there is no file. An engine that is not in the file is described by tables of
        idle and full thrust over altitude and Mach number; an aircraft without an engine gets none.
    estimated
        Estimated derivatives, with names such as `CL_alpha` and `CL0`.
    assumed
        Values of derivatives that are not estimated. A derivative in neither `estimated` nor `assumed` is zero.
    source
        Origin of the estimates, as text for the file.

    Raises
    ------
    ValueError
        If the engine is not in the file and its power does not follow the throttle.
    """
    derivatives = {**assumed, **estimated}
    filled = ", ".join(key for key, value in assumed.items() if value)
    keys = [row + column for row in COEFFICIENTS for column in DERIVATIVE_ARGUMENTS]
    lengths = reference_lengths(airframe)
    given = {} if file is None else file.model_dump(mode="json", exclude_none=True)
    actuators = [{key: s[key] for key in _ACTUATOR_KEYS if key in s} for s in given.get("surface", ())]
    if not actuators:
        actuators = [_actuator(airframe, k) for k in range(len(airframe.actuators.names))]
    has_jet_table = "engine" not in given and not isinstance(airframe.engine, NoEngine)
    assumed_parts = ["mass, geometry, actuators and engine"]
    assumed_parts += [f"of the aircraft: {filled}"] if filled else []
    assumed_parts += [_JET_ASSUMED] if has_jet_table else []
    tables: dict[str, Any] = {
        "format": 1,
        "name": name,
        "description": "Aircraft estimated from a flight",
        "source": source,
        "assumed": "; ".join(assumed_parts),
        "mass": given.get("mass") or _mass(airframe),
        "geometry": {
            "span_m": float(lengths.span),
            "wing_area_m2": float(lengths.wing_area),
            "mean_chord_m": float(lengths.mean_chord),
        },
        "aerodynamics": {key: derivatives[key] for key in keys if derivatives.get(key)},
        "surface": [
            actuator | {row: derivatives.get(f"{row}_{actuator['name']}", 0.0) for row in COEFFICIENTS}
            for actuator in actuators
        ],
        "validity": _validity(record),
    }
    if "engine" in given:
        tables["engine"] = given["engine"]
    elif has_jet_table:
        tables["engine"] = {"jet": _jet(airframe)}
    return _toml(tables)


def _mass(airframe: AbstractAirframe) -> dict[str, float]:
    body = airframe.mass_properties
    J = np.asarray(body.inertia_b, dtype=float)
    moments = {f"J{axis}{axis}_kg_m2": float(J[k, k]) for k, axis in enumerate("xyz")}
    products = {f"{name}_kg_m2": -float(J[index]) for name, index in PRODUCTS.items()}
    spin = float(np.asarray(body.spin_momentum_b)[0])
    return {"mass_kg": float(body.mass), **moments, **products, "spin_momentum_kg_m2_s": spin}


def _actuator(airframe: AbstractAirframe, k: int) -> dict[str, Any]:
    actuators = airframe.actuators
    stops = {"lower_deg": float(actuators.lower[k]) * RAD_DEG, "upper_deg": float(actuators.upper[k]) * RAD_DEG}
    if isinstance(actuators, SecondOrderActuators):
        dynamics = {"frequency_rad_s": float(actuators.frequency[k]), "damping": float(actuators.damping[k])}
    else:
        dynamics = {"lag_s": float(actuators.time_constant[k])}
    rate = float(actuators.rate_limit[k]) * RAD_DEG
    return {"name": actuators.names[k], **stops, "rate_limit_deg_s": rate, **dynamics}


def _validity(record: FlightRecord) -> dict[str, list[float]]:
    V, alpha = record["airspeed"], record["alpha"] * RAD_DEG
    beta = float(np.max(np.abs(record.channels.get("beta", np.zeros(1))))) * RAD_DEG + _BETA_MARGIN_DEG
    return {
        "airspeed_m_s": [float(np.min(V)) * (1.0 - _SPEED_SHARE), float(np.max(V)) * (1.0 + _SPEED_SHARE)],
        "alpha_deg": [float(np.min(alpha)) - _ALPHA_MARGIN_DEG, float(np.max(alpha)) + _ALPHA_MARGIN_DEG],
        "beta_deg": [-beta, beta],
    }


@compiled_quickly
def _thrusts(
    airframe: AbstractAirframe, altitudes: Float[Array, " row"], machs: Float[Array, " row"]
) -> tuple[Float[Array, "row 2 3"], Float[Array, "row 2 3"], Float[Array, ""]]:
    """Return the engine's forces (N) and moments (N m) at idle and full power, and the time constant of the power (s).

    Forces and moments are in body axes, one row for each pair of altitude (m) and Mach number.
    """

    def data_at(altitude: Float[Array, ""], mach: Float[Array, ""]) -> AirData:
        air = StandardAtmosphere().at(altitude)
        V = mach * air.speed_of_sound
        return AirData(V, 0.0 * V, 0.0 * V, air.density, 0.5 * air.density * V**2, mach, altitude)

    def wrench(altitude: Float[Array, ""], mach: Float[Array, ""]) -> tuple[Array, Array]:
        both = [airframe.engine.propulsion(power, data_at(altitude, mach)) for power in (0.0, 100.0)]
        return jnp.stack([w.force_b for w in both]), jnp.stack([w.moment_b for w in both])

    engine, middle = airframe.engine, data_at(altitudes[0], jnp.asarray(0.4))
    rate = engine.rate(engine.steady_state(20.0), engine.throttle_for_power(30.0), middle)
    return *jax.vmap(wrench)(altitudes, machs), 10.0 / rate.power


def _jet(airframe: AbstractAirframe) -> dict[str, Any]:
    shape = _ALTITUDES_M.size, _MACHS.size
    grid = np.meshgrid(_ALTITUDES_M, _MACHS, indexing="ij")
    force_b, moment_b, lag = (np.asarray(a) for a in _thrusts(airframe, *(as_array(np.ravel(axis)) for axis in grid)))
    if not (np.isfinite(lag) and lag > 0.0):
        raise ValueError(
            f"aircraft: arrived {type(airframe.engine).__name__}, whose power does not follow the throttle"
        )
    idle, full = force_b[:, 0, 0].reshape(shape), force_b[:, 1, 0].reshape(shape)
    largest = int(np.argmax(force_b[:, 1, 0]))
    point = np.array([0.0, -moment_b[largest, 1, 2], moment_b[largest, 1, 1]]) / force_b[largest, 1, 0]
    return {
        "idle_N": np.round(idle, 3).tolist(),
        "full_N": np.round(full, 3).tolist(),
        "altitude_m": _ALTITUDES_M.tolist(),
        "mach": _MACHS.tolist(),
        "lag_s": float(lag),
        "point_m": point.tolist(),
    }


def _toml(tables: Mapping[str, Any], path: str = "") -> str:
    """Return nested tables as TOML text; `path` is the dotted name of the table.

    Floats have nine significant digits.
    """
    lines, parts = [], []
    for key, value in tables.items():
        name = f"{path}.{key}" if path else key
        if isinstance(value, Mapping):
            parts.append(f"\n[{name}]\n{_toml(value, name)}")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            parts += [f"\n[[{name}]]\n{_toml(entry, name)}" for entry in value]
        else:
            lines.append(f"{key} = {json.dumps(_rounded(value), ensure_ascii=False)}\n")
    return "".join([*lines, *parts])


def _rounded(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.9g}") + 0.0 if isinstance(value, float) else value


def slug(text: str) -> str:
    """Return a valid aircraft name made from a text: small letters, digits, single hyphens, at most 64 characters."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:64] or "aircraft"
