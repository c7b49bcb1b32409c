"""Dynamic models of an aircraft with unknown derivatives: short period, linear motion, nonlinear motion.

States, inputs and outputs have the names of record channels, such as `pitch_rate`.
"""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft.air_data import air_data
from anser.aircraft.airframe import AbstractAirframe
from anser.aircraft.corrected_airframe import ReferenceLengths, reference_lengths
from anser.aircraft.derivative_aircraft import DerivativeAircraft
from anser.aircraft.global_model import GLOBAL_TERMS, F16Global
from anser.aircraft.motion import angular_acceleration
from anser.airframe_data import COEFFICIENTS, derivative_columns, derivative_index
from anser.constants import STANDARD_GRAVITY_M_S2
from anser.environment.atmosphere import StandardAtmosphere
from anser.identification.dynamic_models import DynamicModel, Parameters
from anser.identification.kinematics import RATES, SPECIFIC_FORCE, attitude_rates, flow_rates, gravity_in_body
from anser.shapes import Scalar
from anser.spatial.wind_axes import air_direction_b


def linear_rates(axes: Sequence[str], arguments: Mapping[str, Array], theta: Parameters) -> Array:
    """Return for each axis, such as Z, the rate Z0 + Z_alpha alpha + Z_elevator elevator + ... of a linear model.

    `arguments` holds alpha, elevator, ... (states and inputs) by name, `theta` the parameters `Z0`, `Z_alpha`, ... by
    name; an absent parameter is zero.
    """
    zero = jnp.zeros(())
    sums = [
        sum((theta.get(f"{axis}_{name}", zero) * x for name, x in arguments.items()), theta.get(f"{axis}0", zero))
        for axis in axes
    ]
    return jnp.stack(sums)


class ShortPeriod(eqx.Module):
    """Equations of the short period at the airspeed `speed` (m/s); see `short_period_model`."""

    speed: Scalar
    surfaces: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of alpha and q, and the outputs alpha (rad), q (rad/s) and specific force z (m/s^2)."""
        alpha, q = x
        arguments = {"alpha": alpha, "q": q, **dict(zip(self.surfaces, u, strict=True))}
        rates = linear_rates("ZM", arguments, {"Z_q": jnp.ones(()), **theta})
        return rates, jnp.stack([alpha, q, self.speed * (rates[0] - q) - STANDARD_GRAVITY_M_S2])


def short_period_model(speed_m_s: float, surfaces: Sequence[str] = ("elevator",)) -> DynamicModel:
    """Return the short-period model in nearly level flight, with the outputs alpha, q and specific force f_z.

    alpha' = Z_alpha alpha + Z_q q + Z_elevator u + Z0 (rad/s) and q' = M_alpha alpha + M_q q + M_elevator u + M0
    (rad/s^2), with a term for each surface u (rad). The specific force along z is f_z = V (alpha' - q) - g (m/s^2). A
    parameter that is neither estimated nor fixed is 0, except Z_q = 1.
    """
    equations = ShortPeriod(jnp.asarray(float(speed_m_s)), tuple(surfaces))
    outputs = ("alpha", "pitch_rate", "specific_force_z")
    return DynamicModel(equations, outputs[:2], tuple(surfaces), outputs)


class RecordedMotion(eqx.Module):
    """Linear equations x' = A x + B u + c + known, with a known part of the rates; see `recorded_model`."""

    axes: tuple[str, ...] = eqx.field(static=True)
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of the states, and the states as outputs; `u` holds the inputs, then the known rates."""
        count = len(self.inputs)
        arguments = dict(zip((*self.states, *self.inputs), (*x, *u[:count]), strict=True))
        return linear_rates(self.axes, arguments, theta) + u[count:], x


def recorded_model(axes: Sequence[str], states: Sequence[str], inputs: Sequence[str]) -> DynamicModel:
    """Return the linear model x' = A x + B u + c + known with the states x as outputs.

    A, B and c consist of the parameters of `linear_rates`; `axes` are the first letters of their names for each state,
    such as Z and M. The known part of each state's rate, such as gravity, is an additional input `known_STATE`.
    """
    equations = RecordedMotion(tuple(axes), tuple(states), tuple(inputs))
    return DynamicModel(equations, equations.states, (*inputs, *(f"known_{name}" for name in states)), equations.states)


_MOTION = ("airspeed", "alpha", "beta", "roll", "pitch", *RATES)
_OUTPUTS: tuple[str, ...] = (*_MOTION, *SPECIFIC_FORCE)


class AircraftMotion(eqx.Module):
    """Equations of motion of an aircraft with unknown derivatives; see `aircraft_model`."""

    airframe: AbstractAirframe
    lengths: ReferenceLengths
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, x: Array, u: Array, theta: Parameters) -> tuple[Array, Array]:
        """Return the rates of the states, and the outputs; see `aircraft_model`."""
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
        body = jnp.stack([CL * sa - CD * ca, CY, -CL * ca - CD * sa, *moments])
        wrench = wrench + self.lengths.wrench(data.qbar, body)
        specific_force = wrench.force_b / airframe.mass_properties.mass
        gravity = gravity_in_body(roll, pitch, jnp)
        flow = flow_rates(V, alpha, beta, rates, specific_force, gravity, jnp)
        attitude = attitude_rates(roll, pitch, rates, jnp)[:2]
        angular = angular_acceleration(airframe.mass_properties, rates, wrench.moment_b)
        values: dict[str, Array] = dict(zip(_OUTPUTS, (*x, *specific_force), strict=True))
        return jnp.concatenate([flow, attitude, angular]), jnp.stack([values[key] for key in self.outputs])

    def _identified(self, theta: Parameters) -> tuple[AbstractAirframe, Float[Array, "6 argument"]]:
        """Return the airframe with the parameters in `theta`, and the increments of its coefficients.

        The increments, such as `dCm_alpha`, are derivatives of CL, CD, CY, Cl, Cm and Cn (rows) by the constant 1,
        alpha, beta, p b/2V, q c/2V, r b/2V, alpha^2, beta^2 and the surfaces (columns).
        """
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
    """Return where an airframe stores the parameter `name`: field name and index in the field; None if unknown."""
    if isinstance(airframe, DerivativeAircraft):
        index = derivative_index(name, tuple(airframe.actuators.names))
        return None if index is None else ("derivatives", index)
    if isinstance(airframe, F16Global) and name in _GLOBAL_NAMES:
        return "parameters", _GLOBAL_NAMES.index(name)
    return None


def aircraft_model(airframe: AbstractAirframe, names: Sequence[str], outputs: Sequence[str] = _OUTPUTS) -> DynamicModel:
    """Return the nonlinear equations of motion of an aircraft in still air, with derivatives as parameters.

    The states are airspeed (m/s), alpha, beta, roll, pitch (rad) and body rates (rad/s). The inputs are the deflections
    of the surfaces (rad), the engine's power (percent) and the density altitude (m), which is the altitude in the
    standard atmosphere.

    Parameters
    ----------
    airframe
        Aircraft that supplies all values that are not parameters.
    names
        Names of the parameters:

        - `Cm_alpha`: derivative in an aircraft file; moments refer to the file's reference point.
        - `Cm[alpha q]`: term of the global model of the F-16 (`anser.aircraft.global_model.GLOBAL_TERMS`).
        - `dCm_alpha`: increment of a derivative of any aircraft; moments refer to the centre of gravity.

        Derivatives end as in `anser.airframe_data.DERIVATIVE_ARGUMENTS`, or in `_` and the name of a surface.
    outputs
        Keys of the outputs, among the states and the specific force (`specific_force_x`, ..., m/s^2).

    Raises
    ------
    ValueError
        If a name is no parameter of the aircraft, or an output is unknown.
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
