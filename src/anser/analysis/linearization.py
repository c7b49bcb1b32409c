"""Linear models by forward-mode differentiation.

Coordinates of an aircraft's state, the open-loop model, and the sampled model under one loop of the autopilot.
Kernel: JAX only.
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
from anser.aircraft.motion import flight_condition, state_derivative
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
    trimmed_autopilot_state,
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
from anser.spatial.wind_axes import bank_about_velocity, flow_angles, path_angles
from anser.units import DEG_RAD
from anser.variables import STANDARD_SURFACES

_FLIGHT_STATES = ("V", "alpha", "beta", "phi", "theta", "psi", "P", "Q", "R", "altitude")
"""Airspeed, flow angles, roll, pitch, yaw, body rates, altitude: m/s, rad, rad/s, m."""
AIR_OUTPUTS = ("n_z", "gamma", "chi", "mu")
"""Normal load factor (force along body -z over weight), path angle, course and bank of the motion through the air."""

Coordinates = Float[Array, " state"]
"""Values of `body_states` and the states of the actuators."""

_MARGIN_COSINE = math.cos(89.0 * DEG_RAD)


def body_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Names of the states of flight and engine (power in percent)."""
    return _FLIGHT_STATES + airframe.engine.state_names


def all_states(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Names of all states, those of the actuators last (deflections in rad)."""
    return body_states(airframe) + airframe.actuators.state_names


def coordinates_of(environment: Environment, state: AircraftState) -> Coordinates:
    """Coordinates of a state; north and east are left out, for nothing depends on them."""
    velocity_air_b, _ = _through_air(environment, state)
    flow = jnp.stack(flow_angles(velocity_air_b))
    euler = euler_from_quaternion(state.quaternion)
    altitude = -state.position_n[2:]
    own = [jnp.ravel(leaf) for leaf in jax.tree.leaves((state.engine, state.actuators))]
    return jnp.concatenate([flow, euler, state.rates_b, altitude, *own])


def state_at(environment: Environment, coordinates: Coordinates, like: AircraftState) -> AircraftState:
    """State of coordinates, north, east and the structure as in `like`: the inverse of `coordinates_of`."""
    V, alpha, beta, phi, theta, psi = coordinates[:6]
    position_n = jnp.stack([like.position_n[0], like.position_n[1], -coordinates[9]])
    velocity_air_b = V * jnp.stack([jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)])
    wind_b = rotate(rotation_from_euler(phi, theta, psi), environment.wind.at(position_n, 0.0))
    _, own_of = ravel_pytree((like.engine, like.actuators))
    engine, actuators = own_of(coordinates[len(_FLIGHT_STATES) :])
    return AircraftState(
        position_n=position_n,
        velocity_b=velocity_air_b + wind_b,
        quaternion=quaternion_from_euler(phi, theta, psi),
        rates_b=coordinates[6:9],
        actuators=actuators,
        engine=engine,
    )


def air_outputs(airframe: AbstractAirframe, environment: Environment, state: AircraftState) -> Float[Array, "4"]:
    """Values of `AIR_OUTPUTS` in a state."""
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    _, alpha, beta = flow_angles(velocity_air_b)
    gamma, chi = path_angles(velocity_air_n)
    mu = bank_about_velocity(rotation_from_quaternion(state.quaternion), alpha, beta)
    weight = airframe.mass_properties.mass * environment.gravity
    load_factor = -flight_condition(airframe, environment, 0.0, state).wrench.force_b[2] / weight
    return jnp.stack([load_factor, gamma, chi, mu])


def is_regular(environment: Environment, state: AircraftState) -> Flag:
    """Whether the coordinates are good at a state.

    They fail, not the flight, where roll and yaw are one (nose straight up or down), where there is no course (flight
    straight up or down) or no angle of attack (sideslip of 90 deg): False within 1 deg of any of these, and at rest.
    """
    velocity_air_b, velocity_air_n = _through_air(environment, state)
    V, _, beta = flow_angles(velocity_air_b)
    gamma, _ = path_angles(velocity_air_n)
    theta = euler_from_quaternion(state.quaternion)[1]
    cosines = jnp.cos(jnp.stack([theta, gamma, beta]))
    return (V > 0.0) & jnp.all(cosines > _MARGIN_COSINE)


def _through_air(environment: Environment, state: AircraftState) -> tuple[Vector3, Vector3]:
    """Velocity through the air in body and in NED axes, m/s."""
    R_bn = rotation_from_quaternion(state.quaternion)
    wind_n = environment.wind.at(state.position_n, 0.0)
    return state.velocity_b - rotate(R_bn, wind_n), rotate_back(R_bn, state.velocity_b) - wind_n


class LinearModel(eqx.Module):
    """Small departures from a flight condition: dx_dot = A dx + B du, dy = C dx + D du; SI units and radians.

    Where `step` is not 0 the model is one of samples: dx(k+1) = A dx(k) + B du(k).

    Attributes
    ----------
    A, B, C, D
        Matrices; rows and columns in the order of the names.
    x, u, y
        States, inputs and outputs of the condition that is departed from.
    x_dot
        Rates of the states in it: 0 but for those that may change in steady flight (heading, altitude, and the pitch
        angle of a pull-up). Of a sampled model: the mean rates over one step.
    step
        Sampling period, s; 0 for continuous time.
    regular
        Whether the coordinates are good at this condition: see `is_regular`.
    states, inputs, outputs
        Names.
    surfaces
        Names of the airframe's control surfaces, of which states and inputs are made.
    """

    A: Float[Array, "state state"]
    B: Float[Array, "state input"]
    C: Float[Array, "output state"]
    D: Float[Array, "output input"]
    x: Float[Array, " state"]
    u: Float[Array, " input"]
    y: Float[Array, " output"]
    x_dot: Float[Array, " state"]
    step: Scalar
    regular: Flag
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)
    surfaces: tuple[str, ...] = eqx.field(static=True, default=STANDARD_SURFACES)


def linearize(
    airframe: AbstractAirframe,
    environment: Environment,
    state: AircraftState,
    controls: Controls,
    *,
    actuators: bool = False,
) -> LinearModel:
    """Linear model of the six-degree-of-freedom motion over a flat Earth about any condition, steady or not.

    The derivatives are exact. Where a table or the engine's lag has a kink, they are those of the side to which the
    look-up belongs (of the cell above a breakpoint); at a stop of the throttle or of an actuator, the mean of both
    sides.

    Parameters
    ----------
    airframe, environment
        Any airframe; a flat Earth.
    state, controls
        The condition, for instance of a `TrimPoint`.
    actuators
        False: the inputs elevator, aileron, rudder, or whatever the surfaces are, are deflections (those of
        `controls`). True: they are commands to the actuators, whose states (those of `state`) are added.

    Raises
    ------
    TypeError
        The Earth is not flat: the classical states belong to a flat one.
    """
    require_flat_earth(environment)
    names = all_states(airframe) if actuators else body_states(airframe)
    count, surfaces = len(names), airframe.actuators.names

    def motion(xu: Array) -> Array:
        x, u = xu[:count], xu[count:]
        if actuators:
            now = state_at(environment, x, state)
        else:
            rest = coordinates_of(environment, state)[count:]
            now = state_at(environment, jnp.concatenate([x, rest]), state)
            now = eqx.tree_at(lambda s: s.actuators, now, airframe.actuators.steady_state(u[1:]))
        rate = state_derivative(airframe, environment, 0.0, now, Controls(surfaces=u[1:], throttle=u[0]))
        _, x_dot = jax.jvp(lambda s: coordinates_of(environment, s), (now,), (rate,))
        return jnp.concatenate([x_dot[:count], x, air_outputs(airframe, environment, now)])

    x = coordinates_of(environment, state)[:count]
    u = jnp.concatenate([jnp.asarray(controls.throttle)[None], controls.surfaces])
    found = linearize_function(motion, jnp.concatenate([x, u]))
    (A, B), (C, D) = (jnp.split(rows, [count], axis=1) for rows in jnp.split(found.slope, [count]))
    x_dot, y = jnp.split(found.value, [count])
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
    """A value and its derivatives, one row for each element."""

    value: Float[Array, " row"]
    slope: Float[Array, "row column"]


def linearize_function(function: Callable[[Array], Array], at: Float[Array, " column"]) -> Linearization:
    """Value and forward-mode derivatives, one column after the other.

    The same as `jax.jacfwd`, which takes all columns at once and twice as long to compile.
    """
    values, columns = jax.lax.map(lambda tangent: jax.jvp(function, (at,), (tangent,)), jnp.eye(at.size))
    return Linearization(values[0], columns.T)


def require_flat_earth(environment: Environment) -> None:
    """Refuse a round Earth."""
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
"""What each loop controls, from the innermost outwards."""


def _named(channels: tuple[str, ...], what: str) -> tuple[str, ...]:
    return tuple(f"{channel}_{what}" for channel in channels)


_OWN_MEMORY: dict[Loop, list[tuple[str, tuple[str, ...]]]] = {
    "rates": [
        ("rates_integral", _named(CHANNELS["rates"], "integral")),
        ("surfaces_filter", ()),
    ],
    "attitude": [
        ("attitude_integral", _named(CHANNELS["attitude"], "integral")),
        ("rates_filter", _named(CHANNELS["rates"], "filter")),
        ("surfaces_slow", ()),
    ],
    "velocity": [
        ("velocity_integral", _named(CHANNELS["velocity"], "integral")),
        ("attitude_filter", _named(CHANNELS["attitude"], "filter")),
    ],
}
"""Fields of the autopilot's memory that each loop adds to those of the loops inside it, with names of their elements;
where there are none, of the surfaces."""
_OF_SURFACES = {"surfaces_filter": "filter", "surfaces_slow": "slow"}
SENSOR_STATE_FIELDS = (
    "residual",
    (
        *_named(("X", "Y", "Z"), "residual"),
        *_named(CHANNELS["rates"], "dot_residual"),
        *_named(CHANNELS["rates"], "last"),
        *_named(CHANNELS["rates"], "dot_last"),
    ),
)
"""Memory of the sensors, which takes part in incremental inversion."""
_EULER = slice(3, 6)


def linearize_loop(case: LoopCase, loop: Loop) -> LinearModel:
    """Linear model of the sampled loop about a trim point: dx(k+1) = A dx(k) + B dc(k).

    States: those of the aircraft with its actuators, and the autopilot's memory (integrals, filters). Inputs: the
    commands to the loop's three channels, held over a step; the throttle stays at trim unless the velocity loop is
    closed. It is the step of `step_response`: control law, then `advance`. Where a command, a surface or the throttle
    stands at a limit, the loop is open there, and so is the model.

    Parameters
    ----------
    case
        What flies from which trim point, and how. The gains' sensor bandwidth must be a concrete number, not traced:
        above 0 (incremental inversion) the memory of the sensors is part of the state.
    loop
        Which loop is commanded; those inside it are closed.

    Raises
    ------
    TypeError
        The Earth is not flat.
    """
    require_flat_earth(case.environment)
    # Compiled in two parts: the motion, by far the larger, is the same for all loops.
    states = all_states(case.airframe)
    own, commands = len(states), len(case.airframe.actuators.names) + 1
    memory = state_fields_of(loop, case.airframe) + (
        [SENSOR_STATE_FIELDS] if bool(case.gains.sensor_bandwidth > 0) else []
    )
    z, command, law = _law(case, loop, tuple(field for field, _ in memory))
    motion = sampled_motion(case, law.value[:commands])
    after = jnp.concatenate([motion.value[:own], law.value[commands:]])
    # x_after = M (x, controls) and (controls, memory_after) = L (x, memory, command), by the chain rule.
    moved, seen = jnp.split(motion.slope, [own])
    through = moved[:, own:] @ law.slope[:commands]
    through = through.at[:, :own].add(moved[:, :own])
    A, B = jnp.split(jnp.concatenate([through, law.slope[commands:]]), [z.size], axis=1)
    change = after - z
    change = change.at[_EULER].set(wrap_angle(change[_EULER]))
    return LinearModel(
        A=A,
        B=B,
        C=jnp.concatenate([jnp.eye(own), seen[:, :own]]) @ jnp.eye(own, z.size),
        D=jnp.zeros((own + len(AIR_OUTPUTS), 3)),
        x=z,
        u=command,
        y=jnp.concatenate([z[:own], motion.value[own:]]),
        x_dot=change / case.step,
        step=case.step,
        regular=is_regular(case.environment, case.trim.state),
        states=states + tuple(name for _, names in memory for name in names),
        inputs=_named(CHANNELS[loop], "command"),
        outputs=states + AIR_OUTPUTS,
        surfaces=case.airframe.actuators.names,
    )


@compiled_quickly
def _law(case: LoopCase, loop: Loop, fields: tuple[str, ...]) -> tuple[Array, Vector3, Linearization]:
    """States and commands of the condition; controls and memory after a sample, as they depend on both."""
    airframe, environment, trim = case.airframe, case.environment, case.trim
    autopilot = InversionAutopilot(case.gains, case.limits, loop=loop)
    start, belief = trimmed_autopilot_state(trim), exact_belief(airframe, environment, trim.state)
    held = loop_outputs(belief, loop)
    rate = believed_motion(belief).path_rates if loop == "velocity" else jnp.zeros(3)

    def elements(memory: AutopilotState) -> list[Array]:
        return [leaf for field in fields for leaf in jax.tree.leaves(getattr(memory, field))]

    own = len(all_states(airframe))

    def law(zc: Array) -> Array:
        state = state_at(environment, zc[:own], trim.state)
        memory = eqx.tree_at(elements, start, split_like(zc[own:-3], elements(start)))
        command = loop_command(loop, zc[-3:], rate, trim.controls.throttle)
        belief = exact_belief(airframe, environment, state)
        controls, _, memory = autopilot.control(memory, belief, command, case.step)
        return jnp.concatenate([controls.surfaces, controls.throttle[None], *elements(memory)])

    z = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start)])
    return z, held, linearize_function(law, jnp.concatenate([z, held]))


@compiled_quickly
def sampled_motion(case: LoopCase, controls: Float[Array, " command"]) -> Linearization:
    """State after one step and outputs before it, as they depend on the state before and on the controls."""
    airframe, environment, start = case.airframe, case.environment, case.trim.state
    own = len(all_states(airframe))

    def motion(xu: Array) -> Array:
        state = state_at(environment, xu[:own], start)
        surfaces, throttle = xu[own:-1], xu[-1]
        after = advance(airframe, environment, 0.0, state, Controls(surfaces, throttle), case.step)
        return jnp.concatenate([coordinates_of(environment, after), air_outputs(airframe, environment, state)])

    return linearize_function(motion, jnp.concatenate([coordinates_of(environment, start), controls]))


def split_like(flat: Float[Array, " element"], like: Sequence[Array]) -> list[Array]:
    """A vector cut into arrays of given shapes."""
    ends = np.cumsum([leaf.size for leaf in like])[:-1]
    return [part.reshape(leaf.shape) for part, leaf in zip(jnp.split(flat, ends), like, strict=True)]


def state_fields_of(loop: Loop, airframe: AbstractAirframe) -> list[tuple[str, tuple[str, ...]]]:
    """Fields of the autopilot's memory that take part in a loop, with the names of their elements."""
    surfaces, found = airframe.actuators.names, []
    for inner in CHANNELS:
        found += [(field, names or _named(surfaces, _OF_SURFACES[field])) for field, names in _OWN_MEMORY[inner]]
        if inner == loop:
            break
    return found
