"""Aerodynamic coefficients at the samples of a record, from specific forces, body rates, mass properties and thrust."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from anser.aircraft.air_data import AirData, Wrench
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import reference_lengths
from anser.aircraft.engines import NoEngine
from anser.aircraft.motion import moment_for_acceleration
from anser.compiling.options import compiled_quickly
from anser.environment.atmosphere import StandardAtmosphere
from anser.identification.kinematics import RATES, SPECIFIC_FORCE, with_specific_force
from anser.identification.records import FlightRecord
from anser.identification.smoothing import smooth
from anser.numerics.arrays import as_array, bucket_size, pad_to_multiple
from anser.numerics.linear import cross
from anser.results.variable_labels import unit_attributes
from anser.shapes import Scalar, Vector3

COEFFICIENT_NAMES: tuple[str, ...] = ("CL", "CD", "CY", "Cl", "Cm", "Cn", "CX", "CZ")
"""Lift and drag (body forces turned by alpha alone), side force; roll, pitch and yaw moment; forces along x and z."""
_INERTIAL_RATES = ("inertial_roll_rate", "inertial_pitch_rate", "inertial_yaw_rate")
_ROWS = 512
"""Multiple to which the number of samples is padded, so that few programs are compiled."""


@dataclasses.dataclass(frozen=True)
class CoefficientHistory:
    """Aerodynamic coefficients, and the arguments of their derivatives, at the samples of a record.

    `coefficients` has the names of `COEFFICIENT_NAMES`; moments refer to the point `reference_m` of
    `compute_coefficients`. `arguments` has `alpha`, `beta` (rad), `p`, `q`, `r` (p b/2V, q c/2V, r b/2V,
    non-dimensional) and the recorded surfaces (rad). `record` has the specific force at the centre of gravity.
    """

    coefficients: dict[str, Float[np.ndarray, " sample"]]
    arguments: dict[str, Float[np.ndarray, " sample"]]
    record: FlightRecord

    @property
    def dataset(self) -> xr.Dataset:
        """Coefficients and arguments as a dataset over `time` (s); angles in rad."""
        data: dict[str, Any] = {
            name: ("time", values, unit_attributes("1", f"Coefficient {name}"))
            for name, values in self.coefficients.items()
        }
        for name, values in self.arguments.items():
            unit = "1" if name in ("p", "q", "r") else "rad"
            data[name] = ("time", values, unit_attributes(unit, f"Argument {name}"))
        return xr.Dataset(data, {"time": ("time", self.record.time_s, unit_attributes("s", "Time"))})


def compute_coefficients(
    record: FlightRecord,
    airframe: AbstractAirframe,
    *,
    accelerometer_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    reference_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> CoefficientHistory:
    """Compute the coefficients of the aerodynamic forces and moments at the samples of a record.

    The aerodynamic force is m f minus the engine's force. The aerodynamic moment is J w' + w x (J w + h) minus the
    engine's moment. f is the specific force at the centre of gravity, w are the smoothed body rates, h is the spin
    momentum of the engine. Source: V. Klein and E. A. Morelli, *Aircraft System Identification* (2006), section 5.2.

    Parameters
    ----------
    record
        Record with these channels:

        - airspeed (above 1 m/s), alpha, body rates; without beta, the sideslip angle is zero
        - specific force, or velocity with attitude
        - altitude, or dynamic pressure with Mach number
        - power or thrust along x, if the airframe has an engine; a recorded thrust replaces the x force of the engine
          model
    airframe
        Aircraft that gives mass properties, reference lengths and engine.
    accelerometer_m
        Position of the accelerometers relative to the centre of gravity, body axes, m.
    reference_m
        Reference point of the moment coefficients relative to the centre of gravity, body axes, m.

    Raises
    ------
    ValueError
        If the record lacks a channel, or an airspeed is 1 m/s or less.
    """
    record = with_specific_force(record, accelerometer_m)
    if "power" not in record and "thrust" not in record and not isinstance(airframe.engine, NoEngine):
        raise ValueError(
            "record: arrived without power_percent and thrust_n; expected one of them, to subtract the thrust (0 N "
            "for a glide)"
        )
    rates_channels = _INERTIAL_RATES if all(key in record for key in _INERTIAL_RATES) else RATES
    rates = smooth(record.stack(*rates_channels), record.step_s)
    missing = np.full_like(rates.values[0], np.nan)
    engine = [record.channels.get(key, missing) for key in ("power", "thrust")]
    rows = np.stack([*_air_rows(record), *engine, *rates.values, *rates.rate, *record.stack(*SPECIFIC_FORCE)]).T
    padded = as_array(pad_to_multiple(rows, bucket_size(len(rows), _ROWS)))
    measured = _measured_coefficients(airframe, as_array(np.asarray(reference_m, dtype=float)), padded)
    coefficients = dict(zip(COEFFICIENT_NAMES, np.asarray(measured)[: len(rows)].T, strict=True))
    arguments = _arguments_of(airframe, record)
    present = {name: x for name, x in arguments.items() if name in record or name not in airframe.actuators.names}
    return CoefficientHistory(coefficients, present, record)


@compiled_quickly
def _measured_coefficients(
    airframe: AbstractAirframe, reference_b: Vector3, rows: Float[Array, "row 17"]
) -> Float[Array, "row 8"]:
    """Return the coefficients `COEFFICIENT_NAMES` of each row, with moments about `reference_b` (body axes, m).

    A row has the six entries of `_air_of_row`, power (percent), thrust (N), body rates (rad/s), angular acceleration
    (rad/s^2), specific force (m/s^2). Power or thrust is NaN if not recorded.
    """

    def evaluate(row: Float[Array, "17"]) -> Float[Array, "8"]:
        data, power, thrust = _air_of_row(row[:6]), row[6], row[7]
        propulsion = airframe.engine.propulsion(jnp.nan_to_num(power), data)
        engine_force_b, engine_moment_b = (
            jnp.where(jnp.isnan(power), 0.0, part) for part in (propulsion.force_b, propulsion.moment_b)
        )
        missing = jnp.where(jnp.isnan(thrust), 0.0, thrust - engine_force_b[0])
        missing_b = jnp.stack([missing, jnp.zeros_like(missing), jnp.zeros_like(missing)])
        point_b = jnp.asarray(getattr(airframe.engine, "point_b", jnp.zeros(3)))
        force_b = airframe.mass_properties.mass * row[14:17] - engine_force_b - missing_b
        moment_b = moment_for_acceleration(airframe.mass_properties, row[8:11], row[11:14])
        moment_b = moment_b - engine_moment_b - cross(point_b, missing_b)
        wrench = Wrench(force_b, moment_b - cross(reference_b, force_b))
        body = reference_lengths(airframe).coefficients(data.qbar, wrench)
        return jnp.concatenate([_in_lift_axes(body, data.alpha), body[::2][:2]])

    return jax.vmap(evaluate)(rows)


def _in_lift_axes(body: Float[Array, "6"], alpha: Scalar) -> Float[Array, "6"]:
    """Return CL, CD, CY, Cl, Cm, Cn from the body-axis CX, CY, CZ, Cl, Cm, Cn at an angle of attack (rad)."""
    CX, CY, CZ, *moments = body
    sa, ca = jnp.sin(alpha), jnp.cos(alpha)
    return jnp.stack([CX * sa - CZ * ca, -CX * ca - CZ * sa, CY, *moments])


def _air_of_row(row: Float[Array, "6"]) -> AirData:
    """Return the air data from airspeed (m/s), alpha, beta (rad), altitude (m), dynamic pressure (Pa) and Mach number.

    If dynamic pressure or Mach number is NaN, the standard atmosphere at the altitude gives the value.
    """
    V, alpha, beta, altitude, qbar, mach = row
    air = StandardAtmosphere().at(jnp.nan_to_num(altitude))
    qbar = jnp.where(jnp.isnan(qbar), 0.5 * air.density * V**2, qbar)
    mach = jnp.where(jnp.isnan(mach), V / air.speed_of_sound, mach)
    return AirData(V, alpha, beta, 2.0 * qbar / V**2, qbar, mach, jnp.nan_to_num(altitude))


def _air_rows(record: FlightRecord) -> Float[np.ndarray, "6 sample"]:
    V = record["airspeed"]
    if not np.all(V > 1.0):
        raise ValueError(f"record: arrived airspeed_m_s down to {np.min(V):g} m/s; expected more than 1 m/s")
    if "altitude" not in record and not ("dynamic_pressure" in record and "mach" in record):
        raise ValueError("record: arrived without altitude_m; expected it, or dynamic_pressure_pa with mach")
    zero, missing = np.zeros_like(V), np.full_like(V, np.nan)
    beta = record.channels.get("beta", zero)
    return np.stack(
        [V, record["alpha"], beta, *(record.channels.get(k, missing) for k in ("altitude", "dynamic_pressure", "mach"))]
    )


def model_coefficients(
    airframe: AbstractAirframe, arguments: Float[Array, " argument"], air: AirData
) -> Float[Array, "6"]:
    """Return CL, CD, CY, Cl, Cm, Cn (about the centre of gravity) of an airframe's aerodynamic model.

    `arguments` are alpha, beta (rad), p b/2V, q c/2V, r b/2V and the surfaces (rad); the flow angles of `air` are not
    used. Differentiable.
    """
    lengths = reference_lengths(airframe)
    alpha, beta = arguments[0], arguments[1]
    at = eqx.tree_at(lambda a: (a.alpha, a.beta), air, (alpha, beta))
    scales = jnp.stack([lengths.span, lengths.mean_chord, lengths.span])
    wrench = airframe.aerodynamics(at, arguments[2:5] * 2.0 * air.V / scales, arguments[5:])
    return _in_lift_axes(lengths.coefficients(air.qbar, wrench), alpha)


@compiled_quickly
def _own_derivatives(
    airframe: AbstractAirframe, arguments: Float[Array, " argument"], air: Float[Array, "6"]
) -> tuple[Float[Array, "6"], Float[Array, "6 argument"]]:
    def coefficients(row: Float[Array, " argument"]) -> Float[Array, "6"]:
        return model_coefficients(airframe, row, _air_of_row(air))

    return coefficients(arguments), jax.jacfwd(coefficients)(arguments)


def airframe_derivatives(airframe: AbstractAirframe, record: FlightRecord) -> dict[str, float]:
    """Return the derivatives (per rad) of an airframe's aerodynamic model at the mean values of a record, by name.

    The derivatives, such as `CL_alpha`, are with respect to the arguments of `CoefficientHistory` and every surface.
    `CL0` is the constant of the linear equation CL = CL0 + CL_alpha alpha + ...
    """
    arguments = _arguments_of(airframe, record)
    means = np.array([np.mean(values) for values in arguments.values()])
    program = _own_derivatives(airframe, as_array(means), as_array(np.mean(_air_rows(record), axis=1)))
    values, table = map(np.asarray, program)
    named = {f"{row}0": float(c) for row, c in zip(COEFFICIENT_NAMES, values - table @ means, strict=False)}
    for row, slopes in zip(COEFFICIENT_NAMES, table, strict=False):
        named |= {f"{row}_{name}": float(slope) for name, slope in zip(arguments, slopes, strict=True)}
    return named


def _arguments_of(airframe: AbstractAirframe, record: FlightRecord) -> dict[str, Float[np.ndarray, " sample"]]:
    """Return alpha, beta (rad), p b/2V, q c/2V, r b/2V, surfaces (rad) by name; missing beta and surfaces are 0."""
    lengths, V = reference_lengths(airframe), record["airspeed"]
    scales = np.array([[lengths.span], [lengths.mean_chord], [lengths.span]], dtype=float)
    hats = dict(zip(("p", "q", "r"), record.stack(*RATES) * scales / (2.0 * V), strict=True))
    zero = np.zeros_like(V)
    surfaces = {name: record.channels.get(name, zero) for name in airframe.actuators.names}
    return {"alpha": record["alpha"], "beta": record.channels.get("beta", zero), **hats, **surfaces}
