"""Linear model of one aircraft under one loop of its autopilot, from sample to sample."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from anser.aircraft import AbstractAirframe, Controls
from anser.compiling import compiled_quickly
from anser.control import AutopilotState, InversionAutopilot, Loop, wrapped
from anser.shapes import Vector3
from anser.simulation.linearize_chart import (
    AIR_OUTPUTS,
    air_outputs,
    all_states,
    coordinates_of,
    regular_at,
    state_at,
)
from anser.simulation.linearize_open import Expansion, LinearModel, expand, require_flat
from anser.simulation.motion import advance
from anser.simulation.response import LoopCase, believed, loop_command, measured_by, motion_of, trimmed_memory

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
SENSOR_MEMORY = (
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
    require_flat(case.environment)
    # Compiled in two parts: the motion, by far the larger, is the same for all loops.
    states = all_states(case.airframe)
    own, commands = len(states), len(case.airframe.actuators.names) + 1
    memory = memory_of(loop, case.airframe) + ([SENSOR_MEMORY] if bool(case.gains.sensor_bandwidth > 0) else [])
    z, command, law = _law(case, loop, tuple(field for field, _ in memory))
    motion = sampled_motion(case, law.value[:commands])
    after = jnp.concatenate([motion.value[:own], law.value[commands:]])
    # x_after = M (x, controls) and (controls, memory_after) = L (x, memory, command), by the chain rule.
    moved, seen = jnp.split(motion.slope, [own])
    through = moved[:, own:] @ law.slope[:commands]
    through = through.at[:, :own].add(moved[:, :own])
    A, B = jnp.split(jnp.concatenate([through, law.slope[commands:]]), [z.size], axis=1)
    change = after - z
    change = change.at[_EULER].set(wrapped(change[_EULER]))
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
        regular=regular_at(case.environment, case.trim.state),
        states=states + tuple(name for _, names in memory for name in names),
        inputs=_named(CHANNELS[loop], "command"),
        outputs=states + AIR_OUTPUTS,
    )


@compiled_quickly
def _law(case: LoopCase, loop: Loop, fields: tuple[str, ...]) -> tuple[Array, Vector3, Expansion]:
    """States and commands of the condition; controls and memory after a sample, as they depend on both."""
    airframe, environment, trim = case.airframe, case.environment, case.trim
    autopilot = InversionAutopilot(case.gains, case.limits, loop=loop)
    start, belief = trimmed_memory(trim), believed(airframe, environment, trim.state)
    held = measured_by(belief, loop)
    rate = motion_of(belief).path_rates if loop == "velocity" else jnp.zeros(3)

    def elements(memory: AutopilotState) -> list[Array]:
        return [leaf for field in fields for leaf in jax.tree.leaves(getattr(memory, field))]

    own = len(all_states(airframe))

    def law(zc: Array) -> Array:
        state = state_at(environment, zc[:own], trim.state)
        memory = eqx.tree_at(elements, start, parts(zc[own:-3], elements(start)))
        command = loop_command(loop, zc[-3:], rate, trim.controls.throttle)
        belief = believed(airframe, environment, state)
        controls, _, memory = autopilot.control(memory, belief, command, case.step)
        return jnp.concatenate([controls.surfaces, controls.throttle[None], *elements(memory)])

    z = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start)])
    return z, held, expand(law, jnp.concatenate([z, held]))


@compiled_quickly
def sampled_motion(case: LoopCase, controls: Float[Array, " command"]) -> Expansion:
    """State after one step and outputs before it, as they depend on the state before and on the controls."""
    airframe, environment, start = case.airframe, case.environment, case.trim.state
    own = len(all_states(airframe))

    def motion(xu: Array) -> Array:
        state = state_at(environment, xu[:own], start)
        surfaces, throttle = xu[own:-1], xu[-1]
        after = advance(airframe, environment, 0.0, state, Controls(surfaces, throttle), case.step)
        return jnp.concatenate([coordinates_of(environment, after), air_outputs(airframe, environment, state)])

    return expand(motion, jnp.concatenate([coordinates_of(environment, start), controls]))


def parts(flat: Float[Array, " element"], like: Sequence[Array]) -> list[Array]:
    """A vector cut into arrays of given shapes."""
    ends = np.cumsum([leaf.size for leaf in like])[:-1]
    return [part.reshape(leaf.shape) for part, leaf in zip(jnp.split(flat, ends), like, strict=True)]


def memory_of(loop: Loop, airframe: AbstractAirframe) -> list[tuple[str, tuple[str, ...]]]:
    """Fields of the autopilot's memory that take part in a loop, with the names of their elements."""
    surfaces, found = airframe.actuators.names, []
    for inner in CHANNELS:
        found += [(field, names or _named(surfaces, _OF_SURFACES[field])) for field, names in _OWN_MEMORY[inner]]
        if inner == loop:
            break
    return found
