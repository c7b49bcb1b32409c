"""Models of aircraft with unknown derivatives: short period, lateral motion, and the nonlinear equations of motion.

States, inputs and outputs have the keys of the catalogue, so that a record gives the manoeuvre.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft.air_data import Wrench, air_data
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import ReferenceLengths, reference_lengths
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.global_model import GLOBAL_TERMS, F16Global
from anser.aircraft.motion import angular_acceleration
from anser.airframe_data import COEFFICIENTS, derivative_columns, derivative_index
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import StandardAtmosphere
from anser.identification.dynamic_models import DynamicModel, Manoeuvre, Parameters, make_manoeuvre
from anser.identification.kinematics import RATES, SPECIFIC_FORCE
from anser.identification.records import FlightRecord
from anser.numerics.linear import cross
from anser.shapes import Scalar
from anser.spatial.wind_axes import air_direction_b


def _linear_terms(arguments: dict[str, Array], theta: Parameters, axis: str) -> Array:
    """Return the sum of the derivatives of an axis times their arguments, with the constant `AXIS_0`; absent: zero."""
    terms = [theta[f"{axis}_{name}"] * x for name, x in arguments.items() if f"{axis}_{name}" in theta]
    return sum(terms, theta.get(f"{axis}_0", jnp.zeros(())))


class ShortPeriod(eqx.Module):
    """Equations of the short period in nearly level flight at constant airspeed: see `short_period_model`."""

    speed: Scalar
    surfaces: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of angle of attack and pitch rate, and the outputs."""
        alpha, q = x
        arguments = {"alpha": alpha, "q": q, **dict(zip(self.surfaces, u, strict=True))}
        Z, M = (_linear_terms(arguments, theta, axis) for axis in "ZM")
        return jnp.stack([q + Z, M]), jnp.stack([alpha, q, self.speed * Z - STANDARD_GRAVITY_M_S2])


def short_period_model(speed_m_s: float, surfaces: Sequence[str] = ("elevator",)) -> DynamicModel:
    """Return the model alpha' = q + Z, q' = M, f_z = V Z - g, with Z = Z_alpha alpha + Z_q q + Z_elevator u + Z_0.

    M likewise. The derivatives per rad are parameters named in this way; one that is neither estimated nor fixed is
    zero. The unit of Z is rad/s, of M rad/s^2.
    """
    equations = ShortPeriod(jnp.asarray(float(speed_m_s)), tuple(surfaces))
    outputs = ("alpha", "pitch_rate", "specific_force_z")
    return DynamicModel(equations, outputs[:2], tuple(surfaces), outputs)


class LateralMotion(eqx.Module):
    """Equations of the lateral motion about straight flight at constant airspeed: see `lateral_model`."""

    speed: Scalar
    alpha: Scalar  # of the straight flight, rad
    pitch: Scalar  # of the straight flight, rad
    surfaces: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of sideslip, roll rate, yaw rate and roll, and the outputs."""
        beta, p, r, roll = x
        arguments = {"beta": beta, "p": p, "r": r, **dict(zip(self.surfaces, u, strict=True))}
        Y, L, N = (_linear_terms(arguments, theta, axis) for axis in "YLN")
        gravity = STANDARD_GRAVITY_M_S2 / self.speed * jnp.cos(self.pitch) * jnp.sin(roll)
        beta_dot = Y + p * jnp.sin(self.alpha) - r * jnp.cos(self.alpha) + gravity
        roll_dot = p + jnp.tan(self.pitch) * r * jnp.cos(roll)
        return jnp.stack([beta_dot, L, N, roll_dot]), jnp.stack([beta, p, r, roll, self.speed * Y])


def lateral_model(
    speed_m_s: float,
    alpha_rad: float = 0.0,
    pitch_rad: float = 0.0,
    surfaces: Sequence[str] = ("aileron", "rudder"),
) -> DynamicModel:
    """Return the model of sideslip, roll rate, yaw rate and roll about straight flight, with side force f_y = V Y.

    Y = Y_beta beta + Y_p p + Y_r r + Y_aileron u + ... + Y_0, rad/s, and L and N likewise, rad/s^2, are the sums of
    derivatives (per rad) and arguments; one that is neither estimated nor fixed is zero. L and N contain the product of
    inertia. Angle of attack and pitch of the straight flight are constant.
    """
    speed, alpha, pitch = (jnp.asarray(float(value)) for value in (speed_m_s, alpha_rad, pitch_rad))
    outputs = ("beta", "roll_rate", "yaw_rate", "roll", "specific_force_y")
    return DynamicModel(LateralMotion(speed, alpha, pitch, tuple(surfaces)), outputs[:4], tuple(surfaces), outputs)


_MOTION = ("airspeed", "alpha", "beta", "roll", "pitch", *RATES)
_OUTPUTS: tuple[str, ...] = (*_MOTION, *SPECIFIC_FORCE)


class AircraftMotion(eqx.Module):
    """Equations of motion of an aircraft with unknown derivatives: see `aircraft_model`."""

    airframe: AbstractAirframe
    lengths: ReferenceLengths
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of the states `airspeed` to `yaw_rate`, and the outputs."""
        V, alpha, beta, roll, pitch = x[:5]
        rates, surfaces, power, altitude = x[5:], u[:-2], u[-2], u[-1]
        airframe, increments = self._identified(theta)
        velocity = V * air_direction_b(alpha, beta)
        data = air_data(velocity, altitude, StandardAtmosphere().at(altitude))
        wrench = airframe.aerodynamics(data, rates, surfaces) + airframe.engine.propulsion(power, data)
        scales = jnp.stack([self.lengths.span, self.lengths.mean_chord, self.lengths.span])
        hats = rates * scales / (2.0 * V)
        ones = jnp.ones(())
        arguments = jnp.concatenate([jnp.stack([ones, alpha, beta, *hats, alpha**2, beta**2]), surfaces])
        CL, CD, CY, *moments = increments @ arguments
        sa, ca = jnp.sin(alpha), jnp.cos(alpha)
        force = jnp.stack([CL * sa - CD * ca, CY, -CL * ca - CD * sa])
        scale = data.qbar * self.lengths.wing_area
        wrench = wrench + Wrench(scale * force, scale * scales * jnp.stack(moments))
        specific_force = wrench.force_b / airframe.mass_properties.mass
        down = jnp.stack([-jnp.sin(pitch), jnp.sin(roll) * jnp.cos(pitch), jnp.cos(roll) * jnp.cos(pitch)])
        acceleration = specific_force + STANDARD_GRAVITY_M_S2 * down - cross(rates, velocity)
        flow_rates = jnp.stack(
            [
                jnp.sum(velocity * acceleration) / V,
                (acceleration[2] * ca - acceleration[0] * sa) / (V * jnp.cos(beta)),
                (acceleration[1] * jnp.cos(beta) - jnp.sin(beta) * (acceleration[0] * ca + acceleration[2] * sa)) / V,
            ]
        )
        turning = rates[1] * jnp.sin(roll) + rates[2] * jnp.cos(roll)
        attitude_rates = jnp.stack(
            [rates[0] + jnp.tan(pitch) * turning, rates[1] * jnp.cos(roll) - rates[2] * jnp.sin(roll)]
        )
        angular = angular_acceleration(airframe.mass_properties, rates, wrench.moment_b)
        values: dict[str, Array] = dict(zip(_OUTPUTS, (*x, *specific_force), strict=True))
        return jnp.concatenate([flow_rates, attitude_rates, angular]), jnp.stack([values[key] for key in self.outputs])

    def _identified(self, theta: Parameters) -> tuple[AbstractAirframe, Float[Array, "6 argument"]]:
        """Return the airframe with the values of the parameters, and increments of coefficients by derivative."""
        airframe, surfaces = self.airframe, self.airframe.actuators.names
        increments = jnp.zeros((len(COEFFICIENTS), len(derivative_columns(surfaces))))
        for name, value in theta.items():
            if name.startswith("d") and (index := derivative_index(name[1:], surfaces)) is not None:
                increments = increments.at[index].set(value)
            elif (entry := _own_parameter(airframe, name)) is not None:
                field, index = entry
                table = getattr(airframe, field).at[index].set(value)
                airframe = eqx.tree_at(lambda a, field=field: getattr(a, field), airframe, table)
        return airframe, increments


_GLOBAL_NAMES = tuple(f"{coefficient}[{term}]" for coefficient, terms in GLOBAL_TERMS.items() for term in terms)


def _own_parameter(airframe: AbstractAirframe, name: str) -> tuple[str, int | tuple[int, int]] | None:
    """Return the field of an airframe, and the index in it, that holds a named parameter; None for an unknown name."""
    if isinstance(airframe, DerivativeAircraft):
        index = derivative_index(name, tuple(airframe.actuators.names))
        return None if index is None else ("derivatives", index)
    if isinstance(airframe, F16Global) and name in _GLOBAL_NAMES:
        return "parameters", _GLOBAL_NAMES.index(name)
    return None


def aircraft_model(airframe: AbstractAirframe, names: Sequence[str], outputs: Sequence[str] = _OUTPUTS) -> DynamicModel:
    """Return the nonlinear model of an aircraft in still standard air, with derivatives as parameters.

    The states are airspeed, flow angles, roll, pitch and body rates; the inputs are the positions of the surfaces
    (rad), the engine's power (percent) and the altitude (m).

    Parameters
    ----------
    airframe
        The aircraft; values that are not among the parameters are its own.
    names
        Names of the parameters. `Cm_alpha` is a derivative of an aircraft file, about the file's reference point;
        `Cm[alpha q]` is a term of the global model of the F-16 (`anser.aircraft.global_model.GLOBAL_TERMS`);
        `dCm_alpha` is an increment of the coefficient of any aircraft, about the centre of gravity. Arguments are those
        of `anser.airframe_data.DERIVATIVE_ARGUMENTS` and the surfaces.
    outputs
        Keys of the outputs, from the states and the specific force.

    Raises
    ------
    ValueError
        A name is no parameter of the aircraft, or an output is unknown.
    """
    surfaces = tuple(airframe.actuators.names)
    for name in names:
        is_increment = name.startswith("d") and derivative_index(name[1:], surfaces) is not None
        if not is_increment and _own_parameter(airframe, name) is None:
            expected = "an increment such as dCm_alpha"
            if isinstance(airframe, DerivativeAircraft):
                expected = f"a derivative such as Cm_alpha or Cm_{surfaces[0]}, or {expected}"
            if isinstance(airframe, F16Global):
                expected = f"a term such as {_GLOBAL_NAMES[-1]}, or {expected}"
            raise ValueError(f"names: arrived {name!r} for {type(airframe).__name__}; expected {expected}")
    if not outputs or not set(outputs) <= set(_OUTPUTS):
        raise ValueError(f"outputs: arrived {list(outputs)}; expected some of {', '.join(_OUTPUTS)}")
    equations = AircraftMotion(airframe, reference_lengths(airframe), tuple(outputs))
    return DynamicModel(equations, _MOTION, (*surfaces, "power", "altitude"), tuple(outputs))


def record_manoeuvre(model: DynamicModel, record: FlightRecord, *, held: bool = False) -> Manoeuvre:
    """Return the manoeuvre of a record for a model whose names are keys of the catalogue.

    The initial state is measured; for a noisy record it is estimated as `initial_states`. Inputs follow straight lines
    between the samples, as positions of surfaces do, unless `held`.

    Raises ValueError if the record lacks a channel of the model.
    """
    inputs, outputs = (record.stack(*keys).T for keys in (model.inputs, model.outputs))
    start = np.array([record[key][0] for key in model.states])
    return make_manoeuvre(model, record.time_s, inputs, outputs, start, held=held)
