"""Flights in float32: what of a step is float64 all the same, and that no part of it brings more."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax._src import source_info_util

import anser
from anser.numerics.arrays import cast_to_precision
from anser.parts import AircraftPlan, Instant
from anser.planning import TimedPath
from anser.planning.holds.hold_paths import HoldCircle, PlannedHolds
from anser.scenario import build_flight
from anser.simulation.closed_loop import act, perceive
from anser.simulation.precision import cast_flight
from anser.simulation.start import trimmed_fleet

PLACES = Path(__file__).parents[2]
THREE = "scenarios/three-aircraft.toml"
DRAWN = {"numerics/randomness.py"}
"""Random numbers are drawn in float64, so that they are the same, and converted."""
GUSTS = {"environment/gust_filters.py"}
"""What a short span adds to turbulence is the root of a covariance, all of which float32 would cancel."""


def float64_in(jaxpr, within="?"):
    """Files of the package with equations that have a float64 result."""
    found = set()
    for equation in jaxpr.eqns:
        frames = source_info_util.user_frames(equation.source_info.traceback)
        files = [frame.file_name.split("/anser/")[-1] for frame in frames if "/src/anser/" in frame.file_name]
        file = files[0] if files else within
        inner = [one for value in equation.params.values() for one in _jaxprs(value)]
        for one in inner:
            found |= float64_in(one, file)
        # a choice between two plain numbers is weakly typed: it becomes what it meets
        results = [out.aval for out in equation.outvars]
        if not inner and any(getattr(one, "dtype", None) == np.float64 and not one.weak_type for one in results):
            found.add(file)
    return found


def _jaxprs(value):
    values = value if isinstance(value, tuple | list) else [value]
    return [getattr(one, "jaxpr", one) for one in values if hasattr(one, "jaxpr") or hasattr(one, "eqns")]


def certified_plan():
    """Shapes of the plan of one aircraft by the certified planner, with a hold."""
    path = TimedPath(np.zeros(9), np.zeros((9, 3, 3)), np.zeros((9, 3, 3)))
    zero, code, place = np.zeros(()), np.zeros((), np.int32), np.zeros(3)
    hold = PlannedHolds(path, HoldCircle(zero, zero, zero), place, place, zero, place, np.zeros(0), np.array(True))
    return AircraftPlan(path, zero, code, zero, zero, code, hold=hold)


def published_plan(flight, fleet):
    """Shapes of the plan of one aircraft by the published planner."""
    state = jax.eval_shape(flight.planner.first, jnp.zeros(()), fleet.reports, fleet.performance)
    return of_one(jax.eval_shape(flight.planner.plans, state))


def of_one(rows):
    return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), rows)


def float64_of_a_step(path):
    """Where one step of the aircraft of a scenario, flown in float32, is float64."""
    scenario = anser.load(PLACES / path)
    flight = build_flight(scenario)
    fleet = jax.eval_shape(trimmed_fleet, flight)
    plan = published_plan(flight, fleet) if scenario.fleet.planner == "published" else certified_plan()
    flown, found = cast_flight(flight, "float32"), set()
    for kind, states in zip(flown.groups, cast_to_precision(fleet.vehicles, np.float32), strict=True):

        def step(vehicle, state, number, plan):
            instant = Instant(flown.environment, number, flown.timing.step, flown.randomness)
            return act(vehicle, state, perceive(vehicle, state, instant), instant, plan, flown.timing.freeze)

        number = jnp.asarray(0, dtype=jnp.int32)
        vehicle, state, plan = kind.vehicles.at(0), of_one(states), cast_to_precision(plan, np.float32)
        found |= float64_in(jax.make_jaxpr(step)(vehicle, state, number, plan).jaxpr)
    return found


def test_nothing_of_a_step_in_float32_is_float64():
    assert float64_of_a_step(THREE) == set()


@pytest.mark.long
@pytest.mark.parametrize(
    ("path", "float64"),
    [
        ("studies/short-approach.toml", DRAWN | GUSTS),
        ("scenarios/uncertain-world.toml", DRAWN | GUSTS),
        ("scenarios/mixed-fleet.toml", set()),
        ("scenarios/three-uavs.toml", set()),
    ],
)
def test_what_is_drawn_and_the_roots_of_turbulence_alone_are_float64(path, float64):
    # what draws is told by whoever asked first: JAX keeps what it has traced
    assert float64_of_a_step(path) - {"sensing/interface.py"} == float64
