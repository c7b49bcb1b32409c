"""Linear models by forward-mode differentiation: the airframe in continuous time, and sampled loops of the autopilot.

The states are the classical ones: airspeed, flow angles, Euler angles, body rates, altitude, engine and actuators.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from anser.aircraft.airframe import AbstractAirframe, AircraftState, Controls
from anser.aircraft.motion import air_data_and_forces, flat_earth_derivative
from anser.compiling.options import compiled_quickly
from anser.control.autopilot_state import AutopilotState
from anser.control.feedback import wrap_angle
from anser.control.inversion_autopilot import InversionAutopilot, Loop
from anser.environment.earth import FlatEarth
from anser.environment.environment import Environment
from anser.shapes import Flag, Scalar, Vector3
from anser.simulation.response import (
    LoopCase,
    believed_motion,
    exact_belief,
    loop_command,
    loop_outputs,
    loop_start,
    modelled_belief,
)
from anser.simulation.vehicle import advance
from anser.spatial.rotations import (
    euler_from_quaternion,
    quaternion_from_euler,
    rotate,
    rotate_back,
    rotation_from_euler,
    rotation_from_quaternion,
)
from anser.spatial.wind_axes import air_direction_b, bank_about_velocity, flow_angles, path_angles
from anser.units import DEG_RAD
from anser.variables import STANDARD_SURFACES

_FLIGHT_STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude")
"""Names of the flight states: airspeed (m/s), flow angles, roll, pitch, yaw (rad), body rates (rad/s), altitude (m)."""
AIR_OUTPUTS = ("n_z", "gamma", "chi", "mu")
"""Normal load factor (force along body -z over weight); path angle, course, bank of the air-relative velocity, rad."""

Coordinates = Float[Array, " state"]
"""Vector of the states named by `all_states`: flight, engine and actuators, SI units and radians."""

_MARGIN_COSINE = math.cos(89.0 * DEG_RAD)
"""Least cosine of pitch, path and sideslip angle at which the coordinates are regular."""


def body_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Return the names of the flight states (V to altitude), then of the engine's states (power in percent)."""
    return _FLIGHT_STATES + airframe.engine.state_names


def all_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Return the names of the states of flight, engine and actuators, in this order (deflections in rad)."""
    return body_states(airframe) + airframe.actuators.state_names


def coordinates_of(environment: Environment, state: AircraftState) -> Coordinates:
    """Return the state as the vector of `all_states`; north and east, which do not affect the dynamics, are omitted."""
    velocity_air_b, _ = _through_air(environment, state)
    flow = jnp.stack(flow_angles(velocity_air_b))
    euler = euler_from_quaternion(state.quaternion)
    altitude = -state.position_n[2:]
    component_states = [jnp.ravel(leaf) for leaf in jax.tree.leaves((state.engine, state.actuators))]
    return jnp.concatenate([flow, euler, state.rates_b, altitude, *component_states])


def state_at(environment: Environment, coordinates: Coordinates, template: AircraftState) -> AircraftState:
    """Return the aircraft state of a vector `coordinates`, the inverse of `coordinates_of`.

    North, east, and the structure of the states of engine and actuators come from `template`.
    """
    V, alpha, beta, phi, theta, psi = coordinates[:6]
    position_n = jnp.stack([template.position_n[0], template.position_n[1], -coordinates[9]])
    velocity_air_b = V * air_direction_b(alpha, beta)
    wind_b = rotate(rotation_from_euler(phi, theta, psi), environment.wind.at(position_n, 0.0))
    _, unflatten = ravel_pytree((template.engine, template.actuators))
    engine, actuators = unflatten(coordinates[len(_FLIGHT_STATES) :])
    return AircraftState(
        position_n=position_n,
        velocity_b=velocity_air_b + wind_b,
        quaternion=quaternion_from_euler(phi, theta, psi),
        rates_b=coordinates[6:9],
        actuators=actuators,
        engine=engine,
    )


def air_outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> Float[Array, "4"]:
    """Return the values of `AIR_OUTPUTS` in a state: normal load factor, path angle, course and bank (rad)."""
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    _, alpha, beta = flow_angles(velocity_air_b)
    gamma, chi = path_angles(velocity_air_n)
    mu = bank_about_velocity(rotation_from_quaternion(state.quaternion), alpha, beta)
    weight = airframe.mass_properties.mass * environment.gravity
    load_factor = -air_data_and_forces(airframe, environment, 0.0, state).wrench.force_b[2] / weight
    return jnp.stack([load_factor, gamma, chi, mu])


def is_regular(environment: Environment, state: AircraftState) -> Flag:
    """Return whether Euler angles, course and flow angles are well defined at a state.

    The result is False at zero airspeed, and within 1 deg of a vertical nose, a vertical path or 90 deg of sideslip.
    """
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    V, _, beta = flow_angles(velocity_air_b)
    gamma, _ = path_angles(velocity_air_n)
    theta = euler_from_quaternion(state.quaternion)[1]
    cosines = jnp.cos(jnp.stack([theta, gamma, beta]))
    return (V > 0.0) & jnp.all(cosines > _MARGIN_COSINE)


def _through_air(environment: Environment, state: AircraftState) -> tuple[Vector3, Vector3]:
    """Return the velocity relative to the air in body axes and in NED axes, m/s."""
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, 0.0)
    return state.velocity_b - rotate(R_bn, wind_n), rotate_back(R_bn, state.velocity_b) - wind_n


class LinearModel(eqx.Module):
    """Linear model of small deviations d from a reference flight condition; SI units, radians, engine power in percent.

    Continuous time (`step` 0): dx_dot = A dx + B du, dy = C dx + D du. Sampled: dx(k+1) = A dx(k) + B du(k).
    """

    # matrices; rows and columns in the order of the names
    A: Float[Array, "state state"]
    B: Float[Array, "state input"]
    C: Float[Array, "output state"]
    D: Float[Array, "output input"]
    # states, inputs and outputs of the reference condition
    x: Float[Array, " state"]
    u: Float[Array, " input"]
    y: Float[Array, " output"]
    # rates of the states at the reference condition (sampled models: mean rates over a step). In steady flight only
    # heading, altitude and the pitch angle of a pull-up may have nonzero rates
    x_dot: Float[Array, " state"]
    step: Scalar  # sampling period, s; 0 for continuous time
    regular: Flag  # False within 1 deg of a vertical nose or path, or of 90 deg of sideslip: see `is_regular`
    # names of the states, inputs and outputs
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    # names of the airframe's control surfaces; part of the names of states and inputs
    surfaces: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)


def linearize(
    airframe: AbstractAirframe,
    environment: Environment,
    state: AircraftState,
    controls: Controls,
    *,
    actuators: bool = False,
) -> LinearModel:
    """Linearize the six-degree-of-freedom motion over a flat Earth about any condition, in continuous time.

    The derivatives are exact. At a grid point of a table, the derivative is taken in the cell above; at a kink of the
    engine's lag, on one side; at a stop of the throttle or of an actuator, it is the mean of both sides.

    Raises TypeError if the Earth is not flat.

    Parameters
    ----------
    state, controls
        Reference condition, for instance of a `TrimPoint`.
    actuators
        False: the inputs are the throttle and the deflections of the surfaces. True: the inputs are the throttle and
        the commands to the actuators, and the states of the actuators are added.
    """
    require_flat_earth(environment)
    names = all_states(airframe) if actuators else body_states(airframe)
    count, surfaces = len(names), airframe.actuators.names

    def motion(xu: Array) -> Array:
        x, u = xu[:count], xu[count:]
        if actuators:
            current_state = state_at(environment, x, state)
        else:
            actuator_states = coordinates_of(environment, state)[count:]
            current_state = state_at(environment, jnp.concatenate([x, actuator_states]), state)
            current_state = eqx.tree_at(lambda s: s.actuators, current_state, airframe.actuators.steady_state(u[1:]))
        rate = flat_earth_derivative(airframe, environment, 0.0, current_state, Controls(surfaces=u[1:], throttle=u[0]))
        _, x_dot = jax.jvp(lambda s: coordinates_of(environment, s), (current_state,), (rate,))
        return jnp.concatenate([x_dot[:count], x, air_outputs(airframe, environment, current_state)])

    x = coordinates_of(environment, state)[:count]
    u = jnp.concatenate([jnp.asarray(controls.throttle)[None], controls.surfaces])
    linearization = linearize_function(motion, jnp.concatenate([x, u]))
    (A, B), (C, D) = (jnp.split(block, [count], axis=1) for block in jnp.split(linearization.slope, [count]))
    x_dot, y = jnp.split(linearization.value, [count])
    return LinearModel(
        *(A, B, C, D, x, u, y, x_dot),
        step=jnp.zeros(()),
        regular=is_regular(environment, state),
        states=names,
        inputs=("throttle", *(f"{name}_command" if actuators else name for name in surfaces)),
        outputs=names + AIR_OUTPUTS,
        surfaces=surfaces,
    )


class Linearization(NamedTuple):
    """Value of a vector function at a point, and the Jacobian there: a row per element of the value."""

    value: Float[Array, " row"]
    slope: Float[Array, "row column"]


def linearize_function(function: Callable[[Array], Array], point: Float[Array, " column"]) -> Linearization:
    """Return value and Jacobian of a vector function at a point."""
    # `jax.jacfwd` gives the same Jacobian, but takes twice as long to compile
    values, columns = jax.lax.map(lambda tangent: jax.jvp(function, (point,), (tangent,)), jnp.eye(point.size))
    return Linearization(values[0], columns.T)


def require_flat_earth(environment: Environment) -> None:
    """Raise TypeError unless the environment's Earth is flat, as the states of `all_states` require."""
    if not isinstance(environment.earth, FlatEarth):
        raise TypeError(
            f"linearization: the environment's Earth is a {type(environment.earth).__name__}; "
            "expected a FlatEarth, to which V, alpha, ..., psi, altitude belong"
        )


CHANNELS: dict[Loop, tuple[str, str, str]] = {
    "rates": ("P", "Q", "R"),
    "attitude": ("mu", "alpha", "beta"),
    "velocity": ("V", "gamma", "chi"),
}
"""Names of the controlled channels of each loop, innermost loop first."""


def _with_suffix(channels: tuple[str, ...], suffix: str) -> tuple[str, ...]:
    return tuple(f"{channel}_{suffix}" for channel in channels)


_LOOP_STATE_FIELDS: dict[Loop, tuple[str, ...]] = {
    "rates": ("rates_integral", "surfaces_filter"),
    "attitude": ("attitude_integral", "rates_filter", "surfaces_slow"),
    "velocity": ("velocity_integral", "attitude_filter"),
}
"""Fields of `AutopilotState` that each loop adds to the fields of its inner loops."""
SENSOR_STATE_FIELDS = (
    "residual",
    (
        *_with_suffix(("X", "Y", "Z"), "residual"),
        *_with_suffix(CHANNELS["rates"], "dot_residual"),
        *_with_suffix(CHANNELS["rates"], "last"),
        *_with_suffix(CHANNELS["rates"], "dot_last"),
    ),
)
"""Field of `AutopilotState` for incremental inversion (measured minus modelled accelerations), and its elements."""
_EULER_ANGLES = slice(3, 6)


def linearize_loop(case: LoopCase, loop: Loop) -> LinearModel:
    """Linearize a sampled loop of the autopilot about a trim point: dx(k+1) = A dx(k) + B dc(k).

    - States x: aircraft with actuators, then integrals and filters of the autopilot; for incremental inversion (sensor
      bandwidth above 0) also the onboard model's residual: measured minus modelled forces and accelerations.
    - Inputs c: commands to the three channels of the loop, constant over a step. The throttle stays at trim unless
      `loop` is "velocity".

    If a command, a surface or the throttle is at a limit, the loop of the model is open there. The sensor bandwidth
    must be a number that JAX does not trace. Raises TypeError if the Earth is not flat.
    """
    require_flat_earth(case.environment)
    # Compiled in two parts: the motion, by far the larger part, is common to the loops.
    states = all_states(case.airframe)
    aircraft_size, controls_size = len(states), len(case.airframe.actuators.names) + 1
    fields = state_fields_of(loop, case.airframe) + (
        [SENSOR_STATE_FIELDS] if bool(case.gains.sensor_bandwidth > 0) else []
    )
    z, command, law = _law(case, loop, tuple(field for field, _ in fields))
    motion = sampled_motion(case, law.value[:controls_size])
    next_state = jnp.concatenate([motion.value[:aircraft_size], law.value[controls_size:]])
    # Chain rule: next_x = M (x, controls) and (controls, next_fields) = L (x, fields, command).
    state_slope, output_slope = jnp.split(motion.slope, [aircraft_size])
    closed_slope = state_slope[:, aircraft_size:] @ law.slope[:controls_size]
    closed_slope = closed_slope.at[:, :aircraft_size].add(state_slope[:, :aircraft_size])
    A, B = jnp.split(jnp.concatenate([closed_slope, law.slope[controls_size:]]), [z.size], axis=1)
    change = next_state - z
    change = change.at[_EULER_ANGLES].set(wrap_angle(change[_EULER_ANGLES]))
    return LinearModel(
        A=A,
        B=B,
        C=jnp.concatenate([jnp.eye(aircraft_size), output_slope[:, :aircraft_size]]) @ jnp.eye(aircraft_size, z.size),
        D=jnp.zeros((aircraft_size + len(AIR_OUTPUTS), 3)),
        x=z,
        u=command,
        y=jnp.concatenate([z[:aircraft_size], motion.value[aircraft_size:]]),
        x_dot=change / case.step,
        step=case.step,
        regular=is_regular(case.environment, case.trim.state),
        states=states + tuple(name for _, names in fields for name in names),
        inputs=_with_suffix(CHANNELS[loop], "command"),
        outputs=states + AIR_OUTPUTS,
        surfaces=case.airframe.actuators.names,
    )


@compiled_quickly
def _law(case: LoopCase, loop: Loop, fields: tuple[str, ...]) -> tuple[Array, Vector3, Linearization]:
    """Return states and commands at the trim point, and the linearized control law.

    The law maps (states, commands) to (surfaces in rad, throttle, next values of `fields` of `AutopilotState`).
    """
    airframe, environment, trim = case.airframe, case.environment, case.trim
    autopilot = InversionAutopilot(case.gains, case.limits, loop=loop)
    start, belief = loop_start(case), exact_belief(airframe, environment, trim.state)
    commands = loop_outputs(belief, loop)
    rate = believed_motion(belief).path_rates if loop == "velocity" else jnp.zeros(3)

    def elements(autopilot_state: AutopilotState) -> list[Array]:
        return [leaf for field in fields for leaf in jax.tree.leaves(getattr(autopilot_state, field))]

    aircraft_size = len(all_states(airframe))

    def law(zc: Array) -> Array:
        state = state_at(environment, zc[:aircraft_size], trim.state)
        autopilot_state = eqx.tree_at(elements, start, split_like(zc[aircraft_size:-3], elements(start)))
        command = loop_command(loop, zc[-3:], rate, trim.controls.throttle)
        belief = modelled_belief(case, state)
        controls, _, autopilot_state = autopilot.control(autopilot_state, belief, command, case.step)
        return jnp.concatenate([controls.surfaces, controls.throttle[None], *elements(autopilot_state)])

    z = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start)])
    return z, commands, linearize_function(law, jnp.concatenate([z, commands]))


@compiled_quickly
def sampled_motion(case: LoopCase, controls: Float[Array, " command"]) -> Linearization:
    """Linearize one sampling step of the aircraft's motion about the state of the trim point and about `controls`.

    The step maps (state, surfaces, throttle) to (next state, `AIR_OUTPUTS` before the step). A state has the elements
    of `all_states`; `controls` are the surfaces (rad) and the throttle (0 to 1).
    """
    airframe, environment, start = case.airframe, case.environment, case.trim.state
    aircraft_size = len(all_states(airframe))

    def motion(xu: Array) -> Array:
        state = state_at(environment, xu[:aircraft_size], start)
        surfaces, throttle = xu[aircraft_size:-1], xu[-1]
        next_state = advance(airframe, environment, 0.0, state, Controls(surfaces, throttle), case.step)
        return jnp.concatenate([coordinates_of(environment, next_state), air_outputs(airframe, environment, state)])

    return linearize_function(motion, jnp.concatenate([coordinates_of(environment, start), controls]))


def split_like(flat: Float[Array, " element"], templates: Sequence[Array]) -> list[Array]:
    """Split a vector into consecutive arrays with the shapes of `templates`."""
    bounds = np.cumsum([leaf.size for leaf in templates])[:-1]
    return [part.reshape(leaf.shape) for part, leaf in zip(jnp.split(flat, bounds), templates, strict=True)]


def state_fields_of(loop: Loop, airframe: AbstractAirframe) -> list[tuple[str, tuple[str, ...]]]:
    """Return the fields of `AutopilotState` for a loop and its inner loops, each with the names of its elements."""
    elements, fields = {**CHANNELS, "surfaces": airframe.actuators.names}, []
    for inner in CHANNELS:
        for field in _LOOP_STATE_FIELDS[inner]:
            group, suffix = field.split("_")
            fields.append((field, _with_suffix(elements[group], suffix)))
        if inner == loop:
            break
    return fields
