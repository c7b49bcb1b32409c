"""A fleet of two classes: a light aircraft with two elevons, and the F-16 behind it in the fleet's order."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from anser.aircraft_files import load_airframe
from anser.control import FollowPlan, GuidanceSettings, InversionAutopilot, default_limits, published_gains
from anser.environment import standard_environment
from anser.parts import make_rendezvous
from anser.planning import straight_goal
from anser.planning.holds.hold_around_goal import HoldAroundGoal
from anser.results import summarize, to_dataset
from anser.sensing import IdealSensors, TrackingEstimator
from anser.simulation import Mission, Vehicle, assemble, fly, start_flight
from anser.steady import trim_target
from support.made_scenario import made_scenario
from support.other_surfaces import elevon_aircraft
from support.straight_lines import StraightLines

STEP, STEPS, ARRIVAL = 0.01, 300, 40.0
NAMES = ("light", "fighter")


def _vehicle(airframe, speed, goal_n):
    limits = eqx.tree_at(
        lambda x: (x.speed_min, x.speed_max), default_limits(), (jnp.asarray(0.6 * speed), jnp.asarray(1.5 * speed))
    )
    settings = GuidanceSettings(*map(jnp.asarray, (0.2, 20.0, 20.0 * speed, 1.0, 5.0)))
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


def mixed_flight():
    """Flight of the fleet with two aircraft groups."""
    aircraft = []
    for k, (airframe, speed) in enumerate(((elevon_aircraft(), 55.0), (load_airframe("f16", "textbook"), 150.0))):
        vehicle = _vehicle(airframe, speed, jnp.array([speed * ARRIVAL, 2000.0 * k, 0.0]))
        aircraft.append((vehicle, trim_target(speed, 400.0), jnp.array([0.0, 2000.0 * k, -400.0])))
    return assemble(standard_environment(), aircraft, StraightLines(jnp.asarray(ARRIVAL), jnp.zeros(3)), STEP, 100)


@eqx.filter_jit
def _fly(flight):
    state, _ = start_flight(flight)
    return fly(flight, state, jnp.asarray(0, dtype=jnp.int32), STEPS)[2]


def fly_mixed():
    """Three seconds: the flight, times, history, dataset and summary."""
    flight = mixed_flight()
    history = {key: np.asarray(values) for key, values in _fly(flight).items()}
    time = STEP * np.arange(STEPS)
    summary = summarize(time, history, made_scenario(NAMES, ("boat", "buoy")), 1.0, surfaces=flight.surfaces)
    origin = {"reference_latitude_deg": 47.5, "reference_longitude_deg": 9.0, "title": "mixed"}
    return flight, time, history, to_dataset(time, history, NAMES, origin, flight.surfaces), summary
