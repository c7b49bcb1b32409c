"""The whole autopilot's sampled closed loop with a test input at every place where a loop can be broken."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from anser.aircraft import AbstractAirframe
from anser.control import (
    AutopilotGains,
    AutopilotSignals,
    AutopilotState,
    Excitation,
)
from anser.control.autopilot import velocity_control
from anser.control.onboard_model import onboard_model
from anser.planning import PathCommand
from anser.simulation.linearize_chart import all_states, coordinates_of, state_at
from anser.simulation.linearize_open import expand, require_flat
from anser.simulation.linearize_sampled import SENSOR_MEMORY, memory_of, parts, sampled_motion
from anser.simulation.response import LoopCase, believed, motion_of, trimmed_memory

INNER_BREAKPOINTS = ("throttle", "P", "Q", "R", "mu", "alpha")
"""Where a loop can be broken besides the commands to the actuators: the command to the engine, those to the loop of the
body rates and to the loop of the attitude. The wanted sideslip is 0 whatever happens: no loop runs through it."""
HELD_BACK = ("thrust", "alpha or load factor", "bank", "body rates", "surfaces")
"""Commands of the autopilot that can stand at a limit, where the loop is open; surfaces also at that of their rates."""

MemoryFields = tuple[str, ...]


class ExcitedLoop(eqx.Module):
    """The closed loop about a trim point: dx(k+1) = A dx(k) + B dw(k), dz(k) = C dx(k) + D dw(k).

    At each breakpoint u = z + w: z is the command that the autopilot computes, u is the one that is passed on, w is the
    test input.

    Attributes
    ----------
    A, B, C, D
        Matrices; w and z in the order of `breakpoints`. No command depends on its own test input in the same sample:
        the diagonal of D is 0.
    limited
        Which of `HELD_BACK` stand at a limit in the trim point: the autopilot does not hold it.
    """

    A: Float[Array, "state state"]
    B: Float[Array, "state breakpoint"]
    C: Float[Array, "breakpoint state"]
    D: Float[Array, "breakpoint breakpoint"]
    limited: Bool[Array, "5"]


def breakpoints(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Where a loop can be broken, the actuators first."""
    return airframe.actuators.names + INNER_BREAKPOINTS


def loop_memory(gains: AutopilotGains, airframe: AbstractAirframe) -> MemoryFields:
    """Fields of the autopilot's memory that take part in the closed loop; the gains must be concrete.

    Left out are the sensors' where the inversion is model-based, and the attitude's integrals where they have no gain:
    they would be integrators that act on nothing.
    """
    fields = [field for field, _ in memory_of("velocity", airframe)]
    if not bool(jnp.any(gains.attitude.integral != 0.0)):
        fields.remove("attitude_integral")
    return (*fields, *((SENSOR_MEMORY[0],) if bool(gains.sensor_bandwidth > 0.0) else ()))


def excited_loop(case: LoopCase, memory: MemoryFields) -> ExcitedLoop:
    """Differentiate the sampled loop, `velocity_control` and then `advance`, about a trim point.

    The command is the steady flight itself. In a steady turn the course it asks for turns with the aircraft, so that
    the departures from it obey the same equations at every sample.

    Parameters
    ----------
    case
        What flies from which trim point, and how; the Earth must be flat.
    memory
        What `loop_memory` says of the gains; a static argument of compiled functions.

    Raises
    ------
    TypeError
        The Earth is not flat.
    """
    airframe, environment, trim = case.airframe, case.environment, case.trim
    require_flat(environment)
    own, commands = len(all_states(airframe)), len(airframe.actuators.names) + 1
    count = len(breakpoints(airframe))
    start, path = trimmed_memory(trim), motion_of(believed(airframe, environment, trim.state))
    wanted = PathCommand(path.V, path.gamma, path.chi, *path.path_rates)

    def elements(of: AutopilotState) -> list[Array]:
        return [leaf for field in memory for leaf in jax.tree.leaves(getattr(of, field))]

    def sampled(zw: Array) -> Array:
        state = state_at(environment, zw[:own], trim.state)
        before = eqx.tree_at(elements, start, parts(zw[own:-5], elements(start)))
        added = Excitation(attitude=jnp.append(zw[-2:], 0.0), rates_b=zw[-5:-2])
        belief = believed(airframe, environment, state)
        model = onboard_model(belief, case.limits, case.gains, before, case.step)
        controls, signals, after = velocity_control(model, case.gains, before, wanted, added)
        passed = [controls.surfaces, controls.throttle[None], signals.rates_b, signals.attitude.angles[:2]]
        return jnp.concatenate([*passed, *elements(after), _limited(signals).astype(float)])

    x = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start), jnp.zeros(5)])
    law = expand(sampled, x)
    motion = sampled_motion(case, law.value[:commands])
    by_state, by_command = jnp.split(motion.slope[:own], [own], axis=1)
    z, after = jnp.split(law.slope[: -len(HELD_BACK)], [count])
    moved = by_command @ z[:commands]
    moved = moved.at[:, :own].add(by_state)
    A, B = jnp.split(jnp.concatenate([moved, after]), [x.size - 5], axis=1)
    C, D = jnp.split(z, [x.size - 5], axis=1)
    # a surface that the command does not move at once stands at its stop or moves as fast as it can: the trim is none
    # that the autopilot holds, as with a sideslip in it
    commanded, unmoved = jnp.asarray(airframe.actuators.commanded), jnp.all(by_command[:, :-1] == 0.0, axis=0)
    # what is added to the commands of surfaces and throttle passes the autopilot by
    to_controls = jnp.concatenate([by_command, jnp.zeros((after.shape[0], commands))])
    return ExcitedLoop(
        A=A,
        B=jnp.concatenate([to_controls, B], axis=1),
        C=C,
        D=jnp.concatenate([jnp.zeros((count, commands)), D], axis=1),
        limited=(law.value[-len(HELD_BACK) :] > 0.5).at[-1].max(jnp.any(commanded & unmoved)),
    )


def broken(loop: ExcitedLoop, at: int) -> tuple[Array, Array, Array]:
    """A, B (column) and C (row) of the loop transfer function at a breakpoint, all other loops closed.

    From the command that is passed on to minus the one that is computed: negative feedback.
    """
    B, C = loop.B[:, at : at + 1], loop.C[at : at + 1]
    return loop.A - B @ C, B, -C


def _limited(signals: AutopilotSignals) -> Bool[Array, "5"]:
    """Values of `HELD_BACK`."""
    thrust, attitude = signals.thrust, signals.attitude
    return jnp.stack(
        [
            thrust.saturated,
            attitude.alpha_saturated,
            attitude.bank_saturated,
            signals.rates_limited,
            signals.surfaces_limited,
        ]
    )
