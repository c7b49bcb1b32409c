"""Stability margins of sampled loops: gain, phase, delay and disk margins at signals of the autopilot.

A breakpoint is a signal z at which a loop is broken: a test input w is added, u = z + w. The response z = T_zw w gives

- the loop transfer function of negative feedback L = -T_zw / (1 + T_zw),
- the sensitivity S = 1 / (1 + L) = 1 + T_zw,
- the complementary sensitivity T = 1 - S, hence S - T = 1 + 2 T_zw.

Disk margin: P. Seiler, A. Packard, P. Gahinet, "An Introduction to Disk Margins", *IEEE Control Systems* 40(5), 2020,
with skew 0.
"""

import dataclasses
from collections.abc import Callable

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
from anser.compiling.options import compiled
from anser.control.autopilot import velocity_control
from anser.control.autopilot_state import AutopilotState
from anser.control.gains import AutopilotGains
from anser.control.limits import FlightLimits
from anser.control.onboard_model import onboard_model
from anser.environment.environment import Environment
from anser.numerics.roots import bracketed_secant
from anser.parts.paths import LoopExcitation, PathCommand
from anser.shapes import Flag, Integer, Scalar, ScalarLike
from anser.simulation.response import (
    LoopCase,
    believed_motion,
    exact_belief,
    loop_start,
    modelled_belief,
)
from anser.steady.trim import TrimPoint
from anser.units import DEG_RAD

INNER_BREAKPOINTS = ("throttle", "P", "Q", "R", "mu", "alpha")
"""Breakpoints besides the commands to the actuators: engine command, body-rate commands and attitude commands."""
SATURABLE_COMMANDS = ("thrust", "alpha or load factor", "bank", "body rates", "surfaces")
"""Commands of the autopilot that can be at a limit, which opens the loop; "surfaces": deflection or rate limit."""

StateFields = tuple[str, ...]


class ExcitedLoop(eqx.Module):
    """Closed loop about a trim point with test inputs w: dx(k+1) = A dx(k) + B dw(k), dz(k) = C dx(k) + D dw(k).

    At each breakpoint the autopilot computes z, and u = z + w is passed on.
    """

    # matrices; w and z in the order of `breakpoints`. The diagonal of D is 0: a test input acts on the signal z of its
    # own breakpoint only from the next sample on
    A: Float[Array, "state state"]
    B: Float[Array, "state breakpoint"]
    C: Float[Array, "breakpoint state"]
    D: Float[Array, "breakpoint breakpoint"]
    # for each of `SATURABLE_COMMANDS`, whether the command is at a limit; the autopilot then does not hold the trim
    limited: Bool[Array, "5"]


def breakpoints(airframe: AbstractAirframe) -> tuple[str, ...]:
    """Return the names of the signals at which the loop can be broken: surfaces, then `INNER_BREAKPOINTS`."""
    return airframe.actuators.names + INNER_BREAKPOINTS


def loop_state_fields(gains: AutopilotGains, airframe: AbstractAirframe) -> StateFields:
    """Return the fields of `AutopilotState` that take part in the closed loop; JAX must not trace the gains."""
    fields = [field for field, _ in state_fields_of("velocity", airframe)]
    if not bool(jnp.any(gains.attitude.integral != 0.0)):
        fields.remove("attitude_integral")
    return (*fields, *((SENSOR_STATE_FIELDS[0],) if bool(jnp.any(gains.sensor_bandwidth > 0.0)) else ()))


def excited_loop(case: LoopCase, fields: StateFields) -> ExcitedLoop:
    """Linearize the sampled closed loop about a trim point, with a test input at each breakpoint.

    The command is the steady flight of the trim point; in a steady turn, the commanded course turns with the aircraft.
    `fields` is the result of `loop_state_fields`. Raises TypeError if the Earth is not flat.
    """
    airframe, environment, trim = case.airframe, case.environment, case.trim
    require_flat_earth(environment)
    aircraft_size, controls_size = len(all_states(airframe)), len(airframe.actuators.names) + 1
    count = len(breakpoints(airframe))
    start, path = loop_start(case), believed_motion(exact_belief(airframe, environment, trim.state))
    command = PathCommand(path.V, path.gamma, path.chi, *path.path_rates)

    def elements(autopilot_state: AutopilotState) -> list[Array]:
        return [leaf for field in fields for leaf in jax.tree.leaves(getattr(autopilot_state, field))]

    def sampled(zw: Array) -> Array:
        state = state_at(environment, zw[:aircraft_size], trim.state)
        autopilot_state = eqx.tree_at(elements, start, split_like(zw[aircraft_size:-5], elements(start)))
        excitation = LoopExcitation(attitude=jnp.append(zw[-2:], 0.0), rates_b=zw[-5:-2])
        excited_command = dataclasses.replace(command, excitation=excitation)
        belief = modelled_belief(case, state)
        model = onboard_model(belief, case.limits, case.gains, autopilot_state, case.step)
        controls, signals, next_state = velocity_control(model, case.gains, autopilot_state, excited_command)
        passed = [controls.surfaces, controls.throttle[None], signals.rates_b, signals.attitude.angles[:2]]
        thrust, attitude = signals.thrust.saturated, signals.attitude
        outer_limits = [thrust, attitude.alpha_saturated, attitude.bank_saturated]
        is_limited = jnp.stack([*outer_limits, signals.rates_limited, signals.surfaces_limited])
        return jnp.concatenate([*passed, *elements(next_state), is_limited.astype(float)])

    x = jnp.concatenate([coordinates_of(environment, trim.state), *elements(start), jnp.zeros(5)])
    law = linearize_function(sampled, x)
    motion = sampled_motion(case, law.value[:controls_size])
    by_state, by_command = jnp.split(motion.slope[:aircraft_size], [aircraft_size], axis=1)
    z, autopilot_slope = jnp.split(law.slope[: -len(SATURABLE_COMMANDS)], [count])
    state_slope = by_command @ z[:controls_size]
    state_slope = state_slope.at[:, :aircraft_size].add(by_state)
    A, B = jnp.split(jnp.concatenate([state_slope, autopilot_slope]), [x.size - 5], axis=1)
    C, D = jnp.split(z, [x.size - 5], axis=1)
    # A surface that does not respond at once to its command is at a stop or at its rate limit; the autopilot then does
    # not hold the trim, for instance because of a sideslip.
    commanded, is_stuck = jnp.asarray(airframe.actuators.is_commanded), jnp.all(by_command[:, :-1] == 0.0, axis=0)
    # Test inputs at the commands to surfaces and throttle act downstream of the autopilot.
    to_controls = jnp.concatenate([by_command, jnp.zeros((autopilot_slope.shape[0], controls_size))])
    return ExcitedLoop(
        A=A,
        B=jnp.concatenate([to_controls, B], axis=1),
        C=C,
        D=jnp.concatenate([jnp.zeros((count, controls_size)), D], axis=1),
        limited=(law.value[-len(SATURABLE_COMMANDS) :] > 0.5).at[-1].max(jnp.any(commanded & is_stuck)),
    )


FREQUENCY_MIN = 1e-3
"""Lowest frequency, rad/s; the highest is the Nyquist frequency."""
FREQUENCY_COUNT = 240
"""Number of frequencies of a response; 44 per decade at 100 samples per second."""
NEUTRAL_POLE_TOLERANCE = 1e-6
"""Distance outside the unit circle up to which a pole counts as stable.

Altitude is not controlled and has a pole on the circle, which rounding moves by less. At this distance the amplitude of
a mode doubles in 2 h."""

_BISECTIONS = 30
_SECANT_STEPS = 14
_REAL_AXIS_TOLERANCE = 5.0 * DEG_RAD
_STATIC_SLOPE = 0.01
"""Greatest slope of log |L| over log omega at which a response counts as static.

A first-order lag has this slope at a phase of 5 deg; an integrator has -1."""
_BALANCING_STEPS = 6


class Margins(eqx.Module):
    """Gain, phase, delay and disk margins of a loop that is broken at one breakpoint."""

    # factors of gain increase and decrease up to the boundary of stability; inf and 0 if no boundary was found
    gain_up: Scalar
    gain_down: Scalar
    # greatest and least gain factor of the search: a boundary beyond would have a frequency below the lowest frequency.
    # inf and 0 if the response at the lowest frequency excludes such a boundary
    gain_up_searched: Scalar
    gain_down_searched: Scalar
    phase: Scalar  # least phase margin over the gain crossovers, in either direction, rad; inf: no crossover
    # least delay that makes the loop unstable, s: the least (phase lag up to -180 deg) / frequency among the gain
    # crossovers; exact for a whole number of sampling periods; inf: no crossover
    delay: Scalar
    # radius alpha of the symmetric disk margin, 0 to 2: the loop tolerates all complex factors in a disk that reaches
    # gains from (2 - alpha)/(2 + alpha) to the reciprocal and phases of 2 atan(alpha/2)
    disk: Scalar
    # frequencies of the gain margins and of the phase margin, rad/s; NaN: no margin
    gain_up_at: Scalar
    gain_down_at: Scalar
    crossover: Scalar


class LoopAnalysis(eqx.Module):
    """Sampled closed loop about a trim point: state matrix, commands at a limit, and margins at the breakpoints."""

    A: Float[Array, "state state"]
    limited: Bool[Array, "5"]  # for each of `SATURABLE_COMMANDS`, whether the command is at a limit
    margins: Margins  # margins at each of `breakpoints`, leaves of shape (breakpoint,)
    actuators_disk: Scalar  # disk margin if all actuators have independent complex factors at once


class LoopResponse(eqx.Module):
    """Frequency responses with the loop opened at one signal (breakpoint) at a time; all other loops stay closed."""

    omega: Float[Array, " frequency"]  # rad/s
    open: Complex[Array, "frequency breakpoint"]  # loop transfer function L of negative feedback
    difference: Complex[Array, "frequency breakpoint"]  # S - T, sensitivity minus complementary sensitivity
    # upper bound of the structured singular value of the matrix S - T with all actuators broken at once
    actuators_difference: Float[Array, " frequency"]


def analyse_loops(case: LoopCase, fields: StateFields) -> tuple[LoopAnalysis, LoopResponse]:
    """Return margins and frequency responses of the loop at every breakpoint; `fields`: see `loop_state_fields`."""
    loop = excited_loop(case, fields)
    response = loop_response(loop, case.step, frequencies(case.step))
    margins, actuators_disk = loop_margins(loop, case.step, response)
    return LoopAnalysis(loop.A, loop.limited, margins, actuators_disk), response


@compiled
def analyse_rows(
    fixed: tuple[AbstractAirframe, Environment, AutopilotGains, FlightLimits, Scalar, AbstractAirframe | None],
    rows: tuple[TrimPoint, AutopilotGains | None],
    fields: StateFields,
) -> tuple[LoopAnalysis, LoopResponse]:
    """Return margins and frequency responses at several trim points (leading axis), in one compiled batch.

    `fixed`: airframe, environment, gains, limits, sampling period (s), onboard model (None: the airframe). `rows`: trim
    points, and gains of each trim point (None: the gains in `fixed`). `fields`: see `loop_state_fields`.
    """
    airframe, environment, common_gains, limits, step, model = fixed

    def analyse_row(trim: TrimPoint, row_gains: AutopilotGains | None) -> tuple[LoopAnalysis, LoopResponse]:
        gains = common_gains if row_gains is None else row_gains
        return analyse_loops(LoopCase(airframe, environment, gains, limits, trim, step, model), fields)

    return jax.vmap(analyse_row)(*rows)


def frequencies(step: ScalarLike) -> Float[Array, " frequency"]:
    """Return frequencies (rad/s) in equal logarithmic steps from `FREQUENCY_MIN` to the Nyquist frequency pi / step."""
    return jnp.exp(jnp.linspace(jnp.log(FREQUENCY_MIN), jnp.log(jnp.pi / step), FREQUENCY_COUNT))


def loop_response(loop: ExcitedLoop, step: ScalarLike, omega: Float[Array, " frequency"]) -> LoopResponse:
    """Return the frequency responses of a sampled loop at its breakpoints, at `omega` (rad/s, at most pi / `step`)."""
    T_zw = jax.vmap(lambda w: _response_at(w, step, loop.A, loop.B, loop.C, loop.D))(omega)
    diagonal = jnp.diagonal(T_zw, axis1=1, axis2=2)
    actuators = _actuators(diagonal.shape[1])
    actuators_difference = jax.vmap(_structured_gain)(jnp.eye(actuators.stop)[None] + 2 * T_zw[:, actuators, actuators])
    return LoopResponse(omega, -diagonal / (1 + diagonal), 1 + 2 * diagonal, actuators_difference)


def _response_at(w: Scalar, step: ScalarLike, A: Array, B: Array, C: Array, D: Array) -> Complex[Array, "..."]:
    """Return the response C (exp(i w step) I - A)^-1 B + D of a sampled system at a frequency w (rad/s)."""
    return C @ jnp.linalg.solve(jnp.exp(1j * w * step) * jnp.eye(A.shape[0]) - A, B.astype(complex)) + D


def loop_margins(loop: ExcitedLoop, step: ScalarLike, response: LoopResponse) -> tuple[Margins, Scalar]:
    """Return the margins of the loop opened at each breakpoint, and the disk margin for changes at all actuators.

    Margins are meaningful only if the closed loop is stable (`largest_pole`). `response` must be the result of
    `loop_response` for the same loop and step (s).
    """

    def margins_at_breakpoint(open_loop: Array, difference: Array, b: Array, c: Array, d: Array) -> Margins:
        def loop_at(w: Scalar) -> Complex[Array, ""]:
            T_zw = _response_at(w, step, loop.A, b, c, d)
            return -T_zw / (1 + T_zw)

        return margins_of(response.omega, open_loop, difference, loop_at)

    margins = jax.vmap(margins_at_breakpoint, in_axes=(1, 1, 1, 0, 0))(
        response.open, response.difference, loop.B, loop.C, jnp.diagonal(loop.D)
    )
    actuators_disk = 2 / _peak(jnp.log(response.actuators_difference))
    return margins, jnp.minimum(actuators_disk, jnp.min(margins.disk[_actuators(margins.disk.size)]))


def margins_of(
    omega: Float[Array, " frequency"],
    open_loop: Complex[Array, " frequency"],
    difference: Complex[Array, " frequency"],
    loop_at: Callable[[Scalar], Complex[Array, ""]],
) -> Margins:
    """Return the margins of a loop from its frequency response.

    `omega` (rad/s) must rise in equal logarithmic steps, up to the Nyquist frequency or beyond the loop's dynamics.
    `open_loop` is the loop transfer function L of negative feedback, `difference` is S - T; `loop_at` returns L at any
    frequency (rad/s). A resonance narrower than the spacing of the frequencies can be missed.
    """
    logs, size = jnp.log(omega), jnp.log(jnp.abs(open_loop))
    angle = jnp.unwrap(jnp.angle(-open_loop))  # 0: on the negative real axis
    # Cubics through four frequencies choose the crossing with the least margin, which `loop_at` then refines.
    stencil_start = jnp.clip(jnp.arange(omega.size - 1) - 1, 0, omega.size - 4)
    interval_start = jnp.arange(omega.size - 1) - stencil_start
    stencil = stencil_start[:, None] + jnp.arange(4)[None, :]
    whole_turns = 2 * jnp.pi * jnp.round(angle[:-1] / (2 * jnp.pi))
    sizes, angles = size[stencil], angle[stencil] - whole_turns[:, None]

    has_crossover, position = _crossings(sizes, interval_start)
    lags = jnp.mod(_cubic(angles, position), 2 * jnp.pi)
    has_phase_crossing, position_on_axis = _crossings(angles, interval_start)
    gains = _cubic(sizes, position_on_axis)
    # the intervals with the least phase margin, delay, rise and fall of the gain
    candidates = jnp.stack(
        [has_crossover, has_crossover, has_phase_crossing & (gains <= 0), has_phase_crossing & (gains > 0)]
    )
    margins = jnp.stack(
        [jnp.minimum(lags, 2 * jnp.pi - lags), lags / jnp.exp(_cubic(logs[stencil], position)), -gains, gains]
    )
    interval = jnp.argmin(jnp.where(candidates, margins, jnp.inf), axis=1)
    exists = jnp.any(candidates, axis=1)

    def distance(log_frequency: Scalar, is_phase: Flag) -> Scalar:
        log_response = jnp.log(-loop_at(jnp.exp(log_frequency)))
        return jnp.where(is_phase, log_response.imag, log_response.real)

    def solve(k: Integer, is_phase: Flag) -> Scalar:
        low, high = (jnp.where(is_phase, angle[i] - whole_turns[k], size[i]) for i in (k, k + 1))
        return bracketed_secant(distance, is_phase, logs[k], logs[k + 1], low, high, _SECANT_STEPS).x

    is_phase = jnp.array([False, False, True, True])
    frequency = jnp.exp(jax.vmap(solve)(interval, is_phase))
    log_response = jnp.log(-jax.vmap(loop_at)(frequency))
    lag = jnp.mod(log_response.imag[:2], 2 * jnp.pi)
    phase = jnp.where(exists[0], jnp.minimum(lag[0], 2 * jnp.pi - lag[0]), jnp.inf)
    delay = jnp.where(exists[1], lag[1] / frequency[1], jnp.inf)

    # The responses at the first frequency (if static) and the last count as crossings on the negative real axis.
    # A static response ends on the real axis; there a real pole passes 1. An integrator's response goes to infinity,
    # even along the negative axis, without a boundary. At the Nyquist frequency (pole at -1) every response is real.
    slope = (size[1] - size[0]) / (logs[1] - logs[0])
    real = jnp.abs(jnp.sin(jnp.angle(open_loop[0]))) < jnp.sin(_REAL_AXIS_TOLERANCE)
    static = (jnp.abs(slope) < _STATIC_SLOPE) & real
    endpoints = jnp.array([0, -1])
    on_axis = jnp.abs(jnp.angle(-open_loop[endpoints])) < _REAL_AXIS_TOLERANCE
    on_axis &= jnp.stack([static, jnp.asarray(True)])
    searched = jnp.exp(-size[0])
    end_sizes = size[endpoints]
    up, up_at = _least_with_frequency(
        jnp.append(-end_sizes, -log_response.real[2]),
        jnp.append(omega[endpoints], frequency[2]),
        jnp.append(on_axis & (end_sizes <= 0), exists[2]),
    )
    down, down_at = _least_with_frequency(
        jnp.append(end_sizes, log_response.real[3]),
        jnp.append(omega[endpoints], frequency[3]),
        jnp.append(on_axis & (end_sizes > 0), exists[3]),
    )
    # |S - T| at the crossovers: resolves resonances narrower than the frequency grid
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
        crossover=jnp.where(exists[0], frequency[0], jnp.nan),
    )


def largest_pole(A: np.ndarray) -> np.ndarray:
    """Return the pole of largest modulus (imaginary part >= 0) of each sampled state matrix, (..., state, state)."""
    poles = np.linalg.eigvals(A)
    pole = np.take_along_axis(poles, np.abs(poles).argmax(axis=-1)[..., None], axis=-1)[..., 0]
    return pole.real + 1j * np.abs(pole.imag)


def _actuators(breakpoints: int) -> slice:
    """Return the slice of the surface actuators, the first of the breakpoints; `breakpoints` is their total number."""
    return slice(0, breakpoints - len(INNER_BREAKPOINTS))


def _least_with_frequency(
    values: Float[Array, " n"], frequency: Float[Array, " n"], is_candidate: Bool[Array, " n"]
) -> tuple[Scalar, Scalar]:
    """Return the least value among the candidates, and its frequency (rad/s); inf and NaN if no candidate exists."""
    k = jnp.argmin(jnp.where(is_candidate, values, jnp.inf))
    return jnp.where(is_candidate[k], values[k], jnp.inf), jnp.where(is_candidate[k], frequency[k], jnp.nan)


def _cubic(values: Float[Array, "interval 4"], position: Float[Array, " interval"]) -> Float[Array, " interval"]:
    """Return, for each interval, the cubic through the four values at 0, 1, 2, 3, evaluated at `position`."""
    t = position
    weights = [
        -(t - 1) * (t - 2) * (t - 3) / 6,
        t * (t - 2) * (t - 3) / 2,
        -t * (t - 1) * (t - 3) / 2,
        t * (t - 1) * (t - 2) / 6,
    ]
    return jnp.sum(values * jnp.stack(weights, axis=1), axis=1)


def _crossings(values: Float[Array, "interval 4"], interval_start: Array) -> tuple[Array, Float[Array, " interval"]]:
    """Return, for each cubic through `values` at 0 to 3, whether it crosses zero, and the position of the zero.

    The zero is searched from `interval_start` to `interval_start` + 1; the position has no meaning if no zero exists.
    """
    low = interval_start.astype(values.dtype)
    sign = jnp.where(_cubic(values, low) > 0, 1.0, -1.0)
    crosses = sign * _cubic(values, low + 1) <= 0

    def bisect(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low_end, high_end = bracket
        middle = (low_end + high_end) / 2
        is_low_side = sign * _cubic(values, middle) > 0
        return jnp.where(is_low_side, middle, low_end), jnp.where(is_low_side, high_end, middle)

    low_end, high_end = jax.lax.fori_loop(0, _BISECTIONS, bisect, (low, low + 1))
    return crosses, (low_end + high_end) / 2


def _peak(logs: Float[Array, " frequency"]) -> Scalar:
    """Return the peak of a function from samples of its logarithm; a parabola finds the peak between the samples."""
    k = jnp.argmax(logs)
    inside = (k > 0) & (k < logs.size - 1)
    previous, largest, following = logs[jnp.maximum(k - 1, 0)], logs[k], logs[jnp.minimum(k + 1, logs.size - 1)]
    curvature = jnp.minimum(previous - 2 * largest + following, -1e-300)
    return jnp.exp(jnp.where(inside, largest - (following - previous) ** 2 / (8 * curvature), largest))


def _structured_gain(M: Complex[Array, "n n"]) -> Scalar:
    """Return an upper bound of the structured singular value of M, for independent complex factors.

    The bound is the largest singular value of D M D^-1. For each k, the diagonal matrix D gives row k and column k
    about equal norms, without the diagonal (E. E. Osborne, *J. ACM* 7, 1960).
    """
    sizes = jnp.abs(M) ** 2 * (1 - jnp.eye(M.shape[0])) + 1e-300

    def balanced(_: int, d: Float[Array, " n"]) -> Float[Array, " n"]:
        scaled = d[:, None] * sizes / d[None, :]
        return d * jnp.sqrt(jnp.sum(scaled, axis=0) / jnp.sum(scaled, axis=1)) ** 0.5

    d = jnp.sqrt(jax.lax.fori_loop(0, _BALANCING_STEPS, balanced, jnp.ones(M.shape[0])))
    scaled = d[:, None] * M / d[None, :]
    return jnp.minimum(jnp.linalg.norm(scaled, ord=2), jnp.linalg.norm(M, ord=2))
