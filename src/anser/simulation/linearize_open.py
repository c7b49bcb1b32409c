"""Linear model of one aircraft about a flight condition, by forward-mode differentiation of the equations of motion."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, AircraftState, Controls, state_derivative
from anser.environment import Environment, FlatEarth
from anser.shapes import Flag, Scalar
from anser.simulation.linearize_chart import (
    AIR_OUTPUTS,
    air_outputs,
    all_states,
    body_states,
    coordinates_of,
    regular_at,
    state_at,
)


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
        Whether the coordinates are good at this condition: see `regular_at`.
    states, inputs, outputs
        Names.
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
    require_flat(environment)
    names = all_states(airframe) if actuators else body_states(airframe)
    count, surfaces = len(names), airframe.actuators.names

    def motion(xu: Array) -> Array:
        x, u = xu[:count], xu[count:]
        if actuators:
            now = state_at(environment, x, state)
        else:
            rest = coordinates_of(environment, state)[count:]
            now = state_at(environment, jnp.concatenate([x, rest]), state)
            now = eqx.tree_at(lambda s: s.actuators, now, airframe.actuators.settled(u[1:]))
        rate = state_derivative(airframe, environment, 0.0, now, Controls(surfaces=u[1:], throttle=u[0]))
        _, x_dot = jax.jvp(lambda s: coordinates_of(environment, s), (now,), (rate,))
        return jnp.concatenate([x_dot[:count], x, air_outputs(airframe, environment, now)])

    x = coordinates_of(environment, state)[:count]
    u = jnp.concatenate([jnp.asarray(controls.throttle)[None], controls.surfaces])
    found = expand(motion, jnp.concatenate([x, u]))
    (A, B), (C, D) = (jnp.split(rows, [count], axis=1) for rows in jnp.split(found.slope, [count]))
    x_dot, y = jnp.split(found.value, [count])
    return LinearModel(
        *(A, B, C, D, x, u, y, x_dot),
        step=jnp.zeros(()),
        regular=regular_at(environment, state),
        states=names,
        inputs=("throttle", *(f"{name}_command" if actuators else name for name in surfaces)),
        outputs=names + AIR_OUTPUTS,
    )


class Expansion(NamedTuple):
    """A value and its derivatives, one row for each element."""

    value: Float[Array, " row"]
    slope: Float[Array, "row column"]


def expand(function: Callable[[Array], Array], at: Float[Array, " column"]) -> Expansion:
    """Value and forward-mode derivatives, one column after the other.

    The same as `jax.jacfwd`, which takes all columns at once and twice as long to compile.
    """
    values, columns = jax.lax.map(lambda tangent: jax.jvp(function, (at,), (tangent,)), jnp.eye(at.size))
    return Expansion(values[0], columns.T)


def require_flat(environment: Environment) -> None:
    """Refuse a round Earth."""
    if not isinstance(environment.earth, FlatEarth):
        raise TypeError(
            f"linearization: the environment's Earth is a {type(environment.earth).__name__}; "
            "expected a FlatEarth, to which V, alpha, ..., psi, altitude belong"
        )
