"""Flights in float32: the remaining float64 parts of a step."""

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
from anser.simulation.closed_loop import guide_and_move, perceive
from anser.simulation.flight import cast_flight
from anser.simulation.start import trimmed_fleet

REPOSITORY = Path(__file__).parents[2]
THREE = "scenarios/three-aircraft.toml"
RANDOM_FILES = {"numerics/randomness.py"}
"""Random numbers are generated in float64, to be independent of the precision, and converted."""
GUST_FILES = {"environment/gust_filters.py"}
"""The turbulence of a short step is the root of a covariance that would cancel completely in float32."""


def float64_in(jaxpr, within="?"):
    """Files of the package with equations with a float64 result."""
    float64_files = set()
    for equation in jaxpr.eqns:
        frames = source_info_util.user_frames(equation.source_info.traceback)
        files = [frame.file_name.split("/anser/")[-1] for frame in frames if "/src/anser/" in frame.file_name]
        file = files[0] if files else within
        subgraphs = [item for value in equation.params.values() for item in _jaxprs(value)]
        for item in subgraphs:
            float64_files |= float64_in(item, file)
        # a choice between two plain numbers is weakly typed: it becomes what it meets
        results = [out.aval for out in equation.outvars]
        if not subgraphs and any(getattr(item, "dtype", None) == np.float64 and not item.weak_type for item in results):
            float64_files.add(file)
    return float64_files


def _jaxprs(value):
    values = value if isinstance(value, tuple | list) else [value]
    return [getattr(item, "jaxpr", item) for item in values if hasattr(item, "jaxpr") or hasattr(item, "eqns")]


def certified_plan():
    """Shapes of the certified planner's plan for one aircraft, with a hold."""
    path = TimedPath(np.zeros(9), np.zeros((9, 3, 3)), np.zeros((9, 3, 3)))
    zero, code, vector = np.zeros(()), np.zeros((), np.int32), np.zeros(3)
    hold = PlannedHolds(path, HoldCircle(zero, zero, zero), vector, vector, zero, vector, np.zeros(0), np.array(True))
    return AircraftPlan(path, zero, code, zero, zero, code, hold=hold)


def published_plan(flight, fleet):
    """Shapes of the published planner's plan for one aircraft."""
    state = jax.eval_shape(flight.planner.first_plan, jnp.zeros(()), fleet.reports, fleet.performance)
    return single_row(jax.eval_shape(flight.planner.plans, state))


def single_row(fleet_rows):
    return jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), fleet_rows)


def float64_of_a_step(path):
    """Files with float64 results in one float32 step of a scenario's aircraft."""
    scenario = anser.load(REPOSITORY / path)
    flight = build_flight(scenario)
    fleet = jax.eval_shape(trimmed_fleet, flight)
    plan = published_plan(flight, fleet) if scenario.fleet.planner == "published" else certified_plan()
    flown, files = cast_flight(flight, "float32"), set()
    for kind, states in zip(flown.groups, cast_to_precision(fleet.vehicles, np.float32), strict=True):

        def step(vehicle, state, number, plan):
            instant = Instant(flown.environment, number, flown.timing.step, flown.randomness)
            return guide_and_move(vehicle, state, perceive(vehicle, state, instant), instant, plan, flown.timing.freeze)

        number = jnp.asarray(0, dtype=jnp.int32)
        vehicle, state, plan = kind.vehicles.at(0), single_row(states), cast_to_precision(plan, np.float32)
        files |= float64_in(jax.make_jaxpr(step)(vehicle, state, number, plan).jaxpr)
    return files


@pytest.mark.long
def test_a_float32_step_has_no_float64_part():
    assert float64_of_a_step(THREE) == set()


@pytest.mark.long
@pytest.mark.parametrize(
    ("path", "float64"),
    [
        ("studies/short-approach.toml", RANDOM_FILES | GUST_FILES),
        ("scenarios/uncertain-world.toml", RANDOM_FILES | GUST_FILES),
        ("scenarios/mixed-fleet.toml", set()),
        ("scenarios/three-uavs.toml", set()),
    ],
)
def test_only_random_numbers_and_turbulence_roots_are_float64(path, float64):
    # what draws is told by whoever asked first: JAX keeps what it has traced
    assert float64_of_a_step(path) - {"sensing/interface.py"} == float64
