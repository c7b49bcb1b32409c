"""Open-loop flights of the F-16 against the textbook's equations in plain NumPy, with other state variables and units.

The library's textbook variant flies in the standard atmosphere; the rounded constants of the textbook's program
(atmosphere, gravity, mass, inertia ratios, 57.3 deg/rad) are in `anser.verification.textbook`. Both sides take
Runge-Kutta steps of 0.01 s with constant controls; the remaining difference is the truncation error in quaternion and
Euler angles, at most 4e-9 of the range of a quantity.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft import AircraftState, Controls
from anser.aircraft.actuators import Deflections
from anser.aircraft.engines import EnginePower
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.aircraft_files import load_f16
from anser.environment import standard_environment
from anser.simulation.vehicle import advance
from anser.spatial import euler_from_quaternion, flow_angles, quaternion_from_euler
from support import stevens_lewis as textbook
from support.textbook import textbook_aircraft, textbook_environment

FOOT, DEG = 0.3048, np.pi / 180.0
STEP, DURATION = 0.01, 10.0
TIMES = STEP * np.arange(round(DURATION / STEP))
TOLERANCE = 1e-7  # of the span of each quantity over the flight; the issue of this test was 1e-6


def pulse(start, end):
    return ((start - 1e-9 <= TIMES) & (end - 1e-9 > TIMES)).astype(float)


FLIGHTS = {
    # speed (ft/s), altitude (ft), path angle (rad), turn rate (rad/s); centre of gravity; change of a control
    "elevator doublet": ((500.0, 3000.0, 0.0, 0.0), 0.30, "elevator", 3.0 * (pulse(1, 2) - pulse(2, 3))),
    "aileron pulse in a turn": ((650.0, 16000.0, 0.0, 0.05), 0.27, "aileron", 6.0 * pulse(1, 2)),
    "slow rudder doublet": ((330.0, 1000.0, 0.0, 0.0), 0.32, "rudder", 5.0 * (pulse(1, 2.5) - pulse(2.5, 4))),
    # into the afterburner and back to idle
    "throttle steps in a climb": ((600.0, 26e3, 0.05, 0.0), 0.30, "throttle", 0.5 * pulse(1, 5) - 0.3 * pulse(5, 10)),
}


def si_state(y):
    direction = [np.cos(y[1]) * np.cos(y[2]), np.sin(y[2]), np.sin(y[1]) * np.cos(y[2])]
    return AircraftState(
        position_n=jnp.array([y[9], y[10], -y[11]]) * FOOT,
        velocity_b=y[0] * FOOT * jnp.array(direction),
        quaternion=quaternion_from_euler(*y[3:6]),
        rates_b=jnp.array(y[6:9]),
        actuators=Deflections(jnp.array(y[13:]) * DEG),
        engine=EnginePower(jnp.asarray(y[12])),
    )


@jax.jit
def flown(airframe, environment, start, commands):
    """States after each step in the textbook's order and units."""

    def step(state, command):
        new_state = advance(airframe, environment, 0.0, state, Controls(command[1:] * DEG, command[0]), STEP)
        V, alpha, beta = flow_angles(new_state.velocity_b)
        north, east, down = new_state.position_n / FOOT
        euler = euler_from_quaternion(new_state.quaternion)
        textbook_state = [
            V / FOOT,
            alpha,
            beta,
            *euler,
            *new_state.rates_b,
            north,
            east,
            -down,
            new_state.power,
            *new_state.surfaces / DEG,
        ]
        return new_state, jnp.stack(textbook_state)

    return jax.lax.scan(step, start, commands)[1]


@functools.cache
def textbook_flight(constants, name):
    """Commands and states from the textbook's equations, starting from a trim by the same equations."""
    condition, x_cg, control, change = FLIGHTS[name]
    aircraft = constants(x_cg)
    start, trimmed = textbook.trim(aircraft, *condition)
    history = [trimmed._replace(**{control: getattr(trimmed, control) + step}) for step in change]
    return np.array(history), textbook.fly(aircraft, start, history, STEP)


def departures(constants, name, airframe, environment):
    """Greatest departure of each quantity relative to its range."""
    commands, expected = textbook_flight(constants, name)
    computed = np.asarray(flown(airframe, environment, si_state(expected[0]), jnp.array(commands)))
    # what does not move, as a control that is held, is compared with a span of 1e-3
    return np.abs(computed - expected[1:]).max(axis=0) / np.maximum(np.ptp(expected, axis=0), 1e-3)


@pytest.mark.parametrize("name", FLIGHTS)
def test_the_flight_follows_the_equations_of_the_textbook(name):
    airframe = load_f16("textbook", FLIGHTS[name][1])
    assert departures(textbook.exact_constants, name, airframe, standard_environment()).max() < TOLERANCE
    moved = np.ptp(textbook_flight(textbook.exact_constants, name)[1], axis=0)
    assert moved[textbook.STATES.index("VT")] > 1.0
    assert moved[textbook.STATES.index("alpha")] > 0.1 * DEG


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
def test_the_flight_with_rounded_constants_follows_the_textbook(name):
    airframe = textbook_aircraft(FLIGHTS[name][1])
    assert departures(textbook.rounded_constants, name, airframe, textbook_environment()).max() < TOLERANCE


def coefficient_changed(name):
    factors = jnp.asarray(1.0 + 1e-4 * np.array([name == coefficient for coefficient in F16_COEFFICIENTS]))
    return lambda airframe: airframe.with_coefficients_scaled(factors)


def number_changed(where):
    return lambda airframe: eqx.tree_at(where, airframe, replace_fn=lambda leaf: leaf * (1.0 + 1e-4))


CHANGES = {
    **{name: coefficient_changed(name) for name in F16_COEFFICIENTS},
    "mass": number_changed(lambda a: a.mass_properties.mass),
    "inertia": number_changed(lambda a: a.mass_properties.inertia_b),
    "engine momentum": number_changed(lambda a: a.mass_properties.spin_momentum_b),
    "actuator lag": number_changed(lambda a: a.actuators.time_constant),
    "rate limit": number_changed(lambda a: a.actuators.rate_limit),
    "thrust": number_changed(lambda a: a.engine.thrust_tables.cells[0]),
    "centre of gravity": number_changed(lambda a: a.x_cg),
    "span": number_changed(lambda a: a.span),
    "chord": number_changed(lambda a: a.mean_chord),
    "area": number_changed(lambda a: a.wing_area),
}


@pytest.mark.long
@pytest.mark.parametrize("name", CHANGES)
def test_a_change_of_any_number_by_1e_4_is_detected(name):
    worst = []
    for flight, (_, x_cg, *_) in FLIGHTS.items():
        airframe = CHANGES[name](load_f16("textbook", x_cg))
        worst.append(departures(textbook.exact_constants, flight, airframe, standard_environment()).max())
    assert max(worst) > 3.0 * TOLERANCE, max(worst)
