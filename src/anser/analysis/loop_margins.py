"""Stability margins of sampled loops.

The closed loop with a test input at each breakpoint, its frequency response, and gain, phase, delay and disk
margins. Kernel: JAX only. The margins of one loop at a time follow from its closed-loop response to a test input.
With u = z + w at the breakpoint and z = T_zw w in the closed loop, the loop transfer function of negative feedback
is L = -T_zw / (1 + T_zw), the sensitivity S = 1 / (1 + L) = 1 + T_zw, the complementary one T = 1 - S, and S - T = 1
+ 2 T_zw. Disk margin: P. Seiler, A. Packard, P. Gahinet, "An Introduction to Disk Margins", *IEEE Control Systems*
40(5), 2020, with skew 0.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from anser.aircraft.airframe import AbstractAirframe
from anser.analysis.linearization import (
    SENSOR_STATE_FIELDS,
    all_states,
    coordinates_of,
    linearize_function,
    require_flat_earth,
    sampled_motion,
    split_like,
    state_at,
    state_fields_of,
)
from anser.control.autopilot import AutopilotSignals, Excitation, velocity_control
from anser.control.autopilot_state import AutopilotState
from anser.control.gains import AutopilotGains
from anser.control.onboard_model import onboard_model
from anser.parts.paths import PathCommand
from anser.shapes import Scalar, ScalarLike
from anser.simulation.response import LoopCase, believed_motion, exact_belief, trimmed_autopilot_state
from anser.units import DEG_RAD

INNER_BREAKPOINTS = ("throttle", "P", "Q", "R", "mu", "alpha")
"""Where a loop can be broken besides the commands to the actuators: the command to the engine, those to the loop of the
body rates and to the loop of the attitude. The wanted sideslip is 0 whatever happens: no loop runs through it."""
SATURABLE_COMMANDS = ("thrust", "alpha or load factor", "bank", "body rates", "surfaces")
"""Commands of the autopilot that can stand at a limit, where the loop is open; surfaces also at that of their rates."""

StateFields = tuple[str, ...]


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
        Which of `SATURABLE_COMMANDS` stand at a limit in the trim point: the autopilot does not hold it.
    """

    A: Float[Array, "state state"]
    B: Float[Array, "state breakpoint"]
    C: Float[Array, "breakpoint state"]
    D: Float[Array, "breakpoint breakpoint"]
    limited: Bool[Array, "5"]


def breakpoints(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Where a loop can be broken, the actuators first."""
    return airframe.actuators.names + INNER_BREAKPOINTS


def loop_state_fields(gains: AutopilotGains, airframe: AbstractAirframe) -> StateFields:
    """Fields of the autopilot's memory that take part in the closed loop; the gains must be concrete.

    Left out are the sensors' where the inversion is model-based, and the attitude's integrals where they have no gain:
    they would be integrators that act on nothing.
    """
    fields = [field for field, _ in state_fields_of("velocity", airframe)]
    if not bool(jnp.any(gains.attitude.integral != 0.0)):
        fields.remove("attitude_integral")
    return (*fields, *((SENSOR_STATE_FIELDS[0],) if bool(gains.sensor_bandwidth > 0.0) else ()))


def excited_loop(case: LoopCase, memory: StateFields) -> ExcitedLoop:
    """Differentiate the sampled loop, `velocity_control` and then `advance`, about a trim point.

    The command is the steady flight itself. In a steady turn the course it asks for turns with the aircraft, so that
    the departures from it obey the same equations at every sample.

    Parameters
    ----------
    case
        What flies from which trim point, and how; the Earth must be flat.
    memory
        What `loop_state_fields` says of the gains; a static argument of compiled functions.

    Raises
    ------
    TypeError
        The Earth is not flat.
    """
    airframe, environment, trim = case.airframe, case.environment, case.trim
    require_flat_earth(environment)
    own, commands = len(all_states(airframe)), len(airframe.actuators.names) + 1
    count = len(breakpoints(airframe))
    start, path = trimmed_autopilot_state(trim), believed_motion(exact_belief(airframe, environment, trim.state))
    wanted = PathCommand(path.V, path.gamma, path.chi, *path.path_rates)

    def elements(of: AutopilotState) -> list[Array]:
        return [leaf for field in memory for leaf in jax.tree.leaves(getattr(of, field))]

    def sampled(zw: Array) -> Array:
        state = state_at(environment, zw[:own], trim.state)
        before = eqx.tree_at(elements, start, split_like(zw[own:-5], elements(start)))
        added = Excitation(attitude=jnp.append(zw[-2:], 0.0), rates_b=zw[-5:-2])
        belief = exact_belief(airframe, environment, state)
        model = onboard_model(belief, case.limits, case.gains, before, case.step)
        controls, signals, after = velocity_control(model, case.gains, before, wanted, added)
        passed = [controls.surfaces, controls.throttle[None], signals.rates_b, signals.attitude.angles[:2]]
        return jnp.concatenate([*passed, *elements(after), _limited(signals).astype(float)])

    x = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start), jnp.zeros(5)])
    law = linearize_function(sampled, x)
    motion = sampled_motion(case, law.value[:commands])
    by_state, by_command = jnp.split(motion.slope[:own], [own], axis=1)
    z, after = jnp.split(law.slope[: -len(SATURABLE_COMMANDS)], [count])
    moved = by_command @ z[:commands]
    moved = moved.at[:, :own].add(by_state)
    A, B = jnp.split(jnp.concatenate([moved, after]), [x.size - 5], axis=1)
    C, D = jnp.split(z, [x.size - 5], axis=1)
    # a surface that the command does not move at once stands at its stop or moves as fast as it can: the trim is none
    # that the autopilot holds, as with a sideslip in it
    commanded, unmoved = jnp.asarray(airframe.actuators.is_commanded), jnp.all(by_command[:, :-1] == 0.0, axis=0)
    # what is added to the commands of surfaces and throttle passes the autopilot by
    to_controls = jnp.concatenate([by_command, jnp.zeros((after.shape[0], commands))])
    return ExcitedLoop(
        A=A,
        B=jnp.concatenate([to_controls, B], axis=1),
        C=C,
        D=jnp.concatenate([jnp.zeros((count, commands)), D], axis=1),
        limited=(law.value[-len(SATURABLE_COMMANDS) :] > 0.5).at[-1].max(jnp.any(commanded & unmoved)),
    )


def break_loop(loop: ExcitedLoop, at: int) -> tuple[Array, Array, Array]:
    """A, B (column) and C (row) of the loop transfer function at a breakpoint, all other loops closed.

    From the command that is passed on to minus the one that is computed: negative feedback.
    """
    B, C = loop.B[:, at : at + 1], loop.C[at : at + 1]
    return loop.A - B @ C, B, -C


def _limited(signals: AutopilotSignals) -> Bool[Array, "5"]:
    """Values of `SATURABLE_COMMANDS`."""
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


FREQUENCY_MIN = 1e-3
"""Lowest frequency looked at, rad/s; the highest is that of Nyquist."""
FREQUENCY_COUNT = 240
"""Number of frequencies, 44 a decade at 100 samples per second: the response between them is interpolated."""
NEUTRAL_POLE_TOLERANCE = 1e-6
"""How far outside the unit circle a pole may lie: altitude, which nothing holds, has its pole on it, and rounding moves
poles by less than this. A pole there doubles its motion in 2 h."""

_BISECTIONS = 30
_AT_THE_ENDS = 5.0 * DEG_RAD
_STATIC_SLOPE = 0.01
"""Greatest slope of log |L| over log omega of a response that has reached its static value: that of a first-order lag
five degrees from the real axis. An integrator has -1."""
_BALANCINGS = 6


class Margins(eqx.Module):
    """Margins of one loop.

    Attributes
    ----------
    gain_up, gain_down
        Factors by which the gain can rise and fall to a boundary of stability, a pole on the unit circle; inf and 0
        where none was found.
    gain_up_searched, gain_down_searched
        Factors up and down to which such a boundary was looked for: beyond them it would lie below the lowest
        frequency. inf and 0 where the response at that frequency shows that there is none below.
    phase
        Least phase margin over all gain crossovers, either way, rad; inf where there is none.
    delay
        Least added delay that destabilizes, s: phase lag that is left over the frequency, over all gain crossovers.
        Exact for whole sampling periods.
    disk
        Radius alpha of the symmetric disk margin, 0 to 2: gain from (2 - alpha)/(2 + alpha) to the reciprocal and phase
        up to 2 atan(alpha/2), at the same time.
    gain_up_at, gain_down_at, crossover
        Where the gain margins and the phase margin are, rad/s; nan where there is none.
    """

    gain_up: Scalar
    gain_down: Scalar
    gain_up_searched: Scalar
    gain_down_searched: Scalar
    phase: Scalar
    delay: Scalar
    disk: Scalar
    gain_up_at: Scalar
    gain_down_at: Scalar
    crossover: Scalar


class LoopAnalysis(eqx.Module):
    """What is found about the loops of one trim point.

    Attributes
    ----------
    A
        Of the closed loop, from sample to sample.
    limited
        Which of `SATURABLE_COMMANDS` stand at a limit.
    margins
        At each of `breakpoints`, leaves of shape (breakpoint,).
    actuators_disk
        Disk margin of all actuators at once, each with a factor of its own.
    """

    A: Float[Array, "state state"]
    limited: Bool[Array, "5"]
    margins: Margins
    actuators_disk: Scalar


class LoopResponse(eqx.Module):
    """Frequency response of the loop broken at each breakpoint, the others closed.

    Attributes
    ----------
    omega
        rad/s.
    open
        Loop transfer function L, negative feedback.
    difference
        S - T.
    actuators_difference
        Largest structured gain of S - T with all actuators broken at once.
    """

    omega: Float[Array, " frequency"]
    open: Complex[Array, "frequency breakpoint"]
    difference: Complex[Array, "frequency breakpoint"]
    actuators_difference: Float[Array, " frequency"]


def analyse_loops(case: LoopCase, memory: StateFields) -> tuple[LoopAnalysis, LoopResponse]:
    """Margins at every breakpoint of the whole autopilot at a trim point; arguments as of `excited_loop`."""
    loop = excited_loop(case, memory)
    response = loop_response(loop, case.step, frequencies(case.step))
    margins, actuators_disk = loop_margins(response)
    return LoopAnalysis(loop.A, loop.limited, margins, actuators_disk), response


def frequencies(step: ScalarLike, count: int = FREQUENCY_COUNT) -> Float[Array, " frequency"]:
    """Frequencies, equal steps of their logarithm from `FREQUENCY_MIN` to that of Nyquist, rad/s."""
    return jnp.exp(jnp.linspace(jnp.log(FREQUENCY_MIN), jnp.log(jnp.pi / step), count))


def loop_response(loop: ExcitedLoop, step: ScalarLike, omega: Float[Array, " frequency"]) -> LoopResponse:
    """Frequency response of a sampled loop at its breakpoints.

    Parameters
    ----------
    loop
        As `excited_loop` makes it.
    step
        Sampling period, s.
    omega
        rad/s, up to pi / step.
    """
    unit, B = jnp.eye(loop.A.shape[0]), loop.B.astype(complex)

    def closed(w: Scalar) -> Complex[Array, "breakpoint breakpoint"]:
        return loop.C @ jnp.linalg.solve(jnp.exp(1j * w * step) * unit - loop.A, B) + loop.D

    T_zw = jax.vmap(closed)(omega)
    own = jnp.diagonal(T_zw, axis1=1, axis2=2)
    of = _actuators(own.shape[1])
    together = jax.vmap(lambda T: _structured_gain(jnp.eye(of.stop) + 2 * T))(T_zw[:, of, of])
    return LoopResponse(omega, -own / (1 + own), 1 + 2 * own, together)


def loop_margins(response: LoopResponse) -> tuple[Margins, Scalar]:
    """Margins at each breakpoint (leaves of shape (breakpoint,)) and the disk margin of all actuators at once.

    They mean something only if the closed loop is stable: see `largest_pole`.
    """

    def one(open_loop: Complex[Array, " frequency"], difference: Complex[Array, " frequency"]) -> Margins:
        return margins_of(response.omega, open_loop, difference)

    each = jax.vmap(one, in_axes=1)(response.open, response.difference)
    together = 2 / _peak(jnp.log(response.actuators_difference))
    return each, jnp.minimum(together, jnp.min(each.disk[_actuators(each.disk.size)]))


def margins_of(
    omega: Float[Array, " frequency"], open_loop: Complex[Array, " frequency"], difference: Complex[Array, " frequency"]
) -> Margins:
    """Margins of one loop from its response.

    Between the frequencies the logarithm of the response is a cubic through four of them. A resonance narrower
    than their distance is not resolved; with a damping ratio of 0.05 its margins are off by 5 percent. An end of the
    frequencies is a boundary of stability only where the response ends on the negative real axis: that of Nyquist,
    where it is real, and the lowest one if the response has its static value there.

    Parameters
    ----------
    omega
        Equal steps of the logarithm, rad/s, the last that of Nyquist (or so high that nothing happens there).
    open_loop, difference
        Loop transfer function L of negative feedback, and S - T.
    """
    size = jnp.log(jnp.abs(open_loop))
    angle = jnp.unwrap(jnp.angle(-open_loop))  # 0: on the negative real axis
    first = jnp.clip(jnp.arange(omega.size - 1) - 1, 0, omega.size - 4)
    begin = jnp.arange(omega.size - 1) - first
    rows = first[:, None] + jnp.arange(4)[None, :]
    sizes, angles = size[rows], angle[rows]
    turns = 2 * jnp.pi * jnp.round(angle[:-1] / (2 * jnp.pi))
    angles = angles - turns[:, None]
    logs = jnp.log(omega)[rows]

    crosses, at = _crossings(sizes, begin)
    lag = jnp.mod(_cubic(angles, at), 2 * jnp.pi)
    frequency = jnp.exp(_cubic(logs, at))
    either = jnp.minimum(lag, 2 * jnp.pi - lag)
    phase, crossover = _least(either, frequency, crosses)
    delay, _ = _least(lag / frequency, frequency, crosses)

    turned, at = _crossings(angles, begin)
    # A static response ends on the real axis, where a real pole passes 1; that of an integrator goes to infinity, even
    # along the negative axis, without a boundary. At the Nyquist frequency, a pole at -1, every response is real.
    slope = (size[1] - size[0]) / (jnp.log(omega[1]) - jnp.log(omega[0]))
    real = jnp.abs(jnp.sin(jnp.angle(open_loop[0]))) < jnp.sin(_AT_THE_ENDS)
    static = (jnp.abs(slope) < _STATIC_SLOPE) & real
    ends = jnp.array([0, -1])
    on_axis = (jnp.abs(jnp.angle(-open_loop[ends])) < _AT_THE_ENDS) & jnp.stack([static, jnp.asarray(True)])
    searched = jnp.exp(-size[0])
    gains = jnp.concatenate([_cubic(sizes, at), size[ends]])
    frequency = jnp.concatenate([jnp.exp(_cubic(logs, at)), omega[ends]])
    turned = jnp.concatenate([turned, on_axis])
    up, up_at = _least(-gains, frequency, turned & (gains <= 0))
    down, down_at = _least(gains, frequency, turned & (gains > 0))
    # |S - T| at the crossovers themselves, where a resonance narrower than the grid is still seen
    at_crossovers = 2 * jnp.stack([jnp.tan(jnp.minimum(phase, jnp.pi) / 2), jnp.tanh(up / 2), jnp.tanh(down / 2)])
    at_crossovers = jnp.where(at_crossovers >= 0, at_crossovers, jnp.inf)
    return Margins(
        gain_up=jnp.exp(up),
        gain_down=jnp.exp(-down),
        gain_up_searched=jnp.where(static | (size[0] >= 0), jnp.inf, searched),
        gain_down_searched=jnp.where(static | (size[0] <= 0), 0.0, searched),
        phase=phase,
        delay=delay,
        disk=jnp.minimum(2 / _peak(jnp.log(jnp.abs(difference))), jnp.min(at_crossovers)),
        gain_up_at=up_at,
        gain_down_at=down_at,
        crossover=crossover,
    )


def largest_pole(A: np.ndarray) -> np.ndarray:
    """Pole of each sampled system (..., state, state) that lies farthest out, imaginary part not negative."""
    poles = np.linalg.eigvals(A)
    found = np.take_along_axis(poles, np.abs(poles).argmax(axis=-1)[..., None], axis=-1)[..., 0]
    return found.real + 1j * np.abs(found.imag)


def _actuators(breakpoints: int) -> slice:
    """Those of the actuators among so many breakpoints."""
    return slice(0, breakpoints - len(INNER_BREAKPOINTS))


def _least(values: Float[Array, " n"], at: Float[Array, " n"], among: Bool[Array, " n"]) -> tuple[Scalar, Scalar]:
    """Least of some values and where it is; inf and nan of none."""
    k = jnp.argmin(jnp.where(among, values, jnp.inf))
    return jnp.where(among[k], values[k], jnp.inf), jnp.where(among[k], at[k], jnp.nan)


def _cubic(values: Float[Array, "interval 4"], at: Float[Array, " interval"]) -> Float[Array, " interval"]:
    """Cubic through values at 0, 1, 2, 3."""
    t = at
    weights = [
        -(t - 1) * (t - 2) * (t - 3) / 6,
        t * (t - 2) * (t - 3) / 2,
        -t * (t - 1) * (t - 3) / 2,
        t * (t - 1) * (t - 2) / 6,
    ]
    return jnp.sum(values * jnp.stack(weights, axis=1), axis=1)


def _crossings(values: Float[Array, "interval 4"], begin: Array) -> tuple[Array, Float[Array, " interval"]]:
    """Whether the cubics pass 0 in the unit interval from `begin`, and where."""
    low = begin.astype(values.dtype)
    sign = jnp.where(_cubic(values, low) > 0, 1.0, -1.0)
    crosses = sign * _cubic(values, low + 1) <= 0

    def halved(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        left, right = ends
        middle = (left + right) / 2
        before = sign * _cubic(values, middle) > 0
        return jnp.where(before, middle, left), jnp.where(before, right, middle)

    left, right = jax.lax.fori_loop(0, _BISECTIONS, halved, (low, low + 1))
    return crosses, (left + right) / 2


def _peak(logs: Float[Array, " frequency"]) -> Scalar:
    """Largest value of what has these logarithms, by a parabola through the largest three."""
    k = jnp.argmax(logs)
    inside = (k > 0) & (k < logs.size - 1)
    before, here, after = logs[jnp.maximum(k - 1, 0)], logs[k], logs[jnp.minimum(k + 1, logs.size - 1)]
    curvature = jnp.minimum(before - 2 * here + after, -1e-300)
    return jnp.exp(jnp.where(inside, here - (after - before) ** 2 / (8 * curvature), here))


def _structured_gain(M: Complex[Array, "n n"]) -> Scalar:
    """Upper bound of the structured singular value for independent factors.

    It is the largest singular value of D M D^-1; D is diagonal and balances the off-diagonal rows and columns (E. E.
    Osborne, *J. ACM* 7, 1960).
    """
    sizes = jnp.abs(M) ** 2 * (1 - jnp.eye(M.shape[0])) + 1e-300

    def balanced(_: int, d: Float[Array, " n"]) -> Float[Array, " n"]:
        scaled = d[:, None] * sizes / d[None, :]
        return d * jnp.sqrt(jnp.sum(scaled, axis=0) / jnp.sum(scaled, axis=1)) ** 0.5

    d = jnp.sqrt(jax.lax.fori_loop(0, _BALANCINGS, balanced, jnp.ones(M.shape[0])))
    scaled = d[:, None] * M / d[None, :]
    return jnp.minimum(jnp.linalg.norm(scaled, ord=2), jnp.linalg.norm(M, ord=2))
