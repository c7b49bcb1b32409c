"""A fleet of different aircraft: textbook F-16, S-119 F-16 and a light propeller aircraft."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.aircraft_files import load_airframe
from anser.control import FollowPlan, GuidanceSettings, InversionAutopilot, default_limits, published_gains
from anser.environment import standard_environment
from anser.numerics.arrays import tree_signature
from anser.parts import make_rendezvous
from anser.planning import straight_goal
from anser.planning.holds.hold_around_goal import HoldAroundGoal
from anser.sensing import IdealSensors, TrackingEstimator
from anser.simulation import Mission, SummaryRecorder, Vehicle, assemble, fly, start_flight
from anser.steady import trim_target
from support.light_aircraft import light_aircraft
from support.straight_lines import StraightLines

pytestmark = pytest.mark.long


STEP, SECONDS, ARRIVAL = 0.01, 50.0, 40.0
ENVIRONMENT = standard_environment()


def vehicle(airframe, speed, speed_min, goal_n, radius):
    limits = eqx.tree_at(
        lambda x: (x.speed_min, x.speed_max), default_limits(), (jnp.asarray(speed_min), jnp.asarray(1.5 * speed))
    )
    settings = GuidanceSettings(*map(jnp.asarray, (0.2, 20.0, radius, 1.0, 5.0)))
    gains = published_gains()
    return Vehicle(
        airframe=airframe,
        sensors=IdealSensors(),
        estimator=TrackingEstimator(),
        guidance=FollowPlan(settings),
        controller=InversionAutopilot(gains, limits),
        mission=Mission(
            goal=straight_goal(goal_n, jnp.array([2.0, 1.0, 0.0])),
            airborne=jnp.asarray(False),
            rendezvous=make_rendezvous(jnp.array([0.0, 0.0, -400.0])),
            hold=HoldAroundGoal(settings, limits, gains.velocity, jnp.asarray(speed)),
        ),
    )


def fleet(order):
    """Flight of the three aircraft from the south to separate goals in the north; `order` is the order of the fleet."""
    aircraft_by_name = {
        "light": (light_aircraft(), 55.0, 35.0, 500.0),
        "textbook": (load_airframe("f16", "textbook"), 150.0, 90.0, 3000.0),
        "s119": (load_airframe("f16", "s119"), 160.0, 90.0, 3000.0),
    }
    aircraft = []
    for name in order:
        airframe, speed, speed_min, radius = aircraft_by_name[name]
        east = 2000.0 * list(aircraft_by_name).index(name)
        member = vehicle(airframe, speed, speed_min, jnp.array([speed * ARRIVAL, east, 0.0]), radius)
        aircraft.append((member, trim_target(speed, 400.0), jnp.array([0.0, east, -400.0])))
    planner = StraightLines(jnp.asarray(ARRIVAL), jnp.zeros(3))
    return assemble(ENVIRONMENT, aircraft, planner, STEP, 100)


@eqx.filter_jit(compiler_options={"xla_backend_optimization_level": 0})
def flown(flight):
    state, _ = start_flight(flight)
    state, (summary, _), _ = fly(
        flight, state, jnp.asarray(0, dtype=jnp.int32), round(SECONDS / STEP), SummaryRecorder()
    )
    return state, summary


@pytest.fixture(scope="module")
def mixed():
    order = ("textbook", "light", "s119")
    flight = fleet(order)
    return order, flight, flown(flight)


def test_two_aircraft_groups_form_a_fleet_of_three(mixed):
    _, flight, _ = mixed
    assert flight.members == ((0, 2), (1,))
    assert flight.count == 3
    first_vehicle, second_vehicle = (flight.aircraft(k)[0] for k in (0, 1))
    assert tree_signature(first_vehicle) != tree_signature(second_vehicle)
    masses = [float(flight.aircraft(k)[0].airframe.mass_properties.mass) for k in range(3)]
    np.testing.assert_allclose(masses, [9295.44, 1247.4, 9298.6], rtol=2e-3)


def test_every_aircraft_meets_its_rendezvous_at_its_own_speed(mixed):
    _, _, (_, summary) = mixed
    np.testing.assert_array_equal(summary.last_status, 0)
    np.testing.assert_allclose(summary.pass_time, ARRIVAL, atol=1.0)
    # The lines ask for a jump of a few m/s and 1 m/s sideways at the start; position feedback works it off in 5 s.
    assert np.all(np.asarray(summary.pass_distance) < 10.0)
    means = np.asarray(summary.speeds_until_pass.integral / summary.pass_time)
    np.testing.assert_allclose(means, [150.0, 55.0, 160.0], rtol=0.05)
    assert float(summary.separation_min) < 2100.0
    assert np.all(np.asarray(summary.clearance_min) > 390.0)


def test_results_are_independent_of_the_order_of_the_fleet(mixed):
    order, _, (_, summary) = mixed
    reordered = ("light", "s119", "textbook")
    _, reordered_history = flown(fleet(reordered))
    positions = [reordered.index(name) for name in order]
    for nominal, two in zip(
        (summary.pass_time, summary.pass_distance, summary.clearance_min, *jax.tree.leaves(summary.speeds_until_pass)),
        (
            reordered_history.pass_time,
            reordered_history.pass_distance,
            reordered_history.clearance_min,
            *jax.tree.leaves(reordered_history.speeds_until_pass),
        ),
        strict=True,
    ):
        np.testing.assert_allclose(nominal, np.asarray(two)[positions], rtol=1e-9)
