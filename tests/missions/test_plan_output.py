"""Record of a certified plan: proven margins, padding aircraft, moving goals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from anser.missions.plan_output import record_certified
from anser.missions.refusal import UNPROVEN
from anser.numerics.arrays import stack_rows
from anser.planning import PathLimits, TimedPath
from anser.planning.certified.certified_plan import Certificate, CertifiedPlan
from anser.planning.certified.path_bounds import PathBounds
from anser.scenario import loads
from support.aircraft_tasks import aircraft_task
from support.certified_scenario import GOOD

END, BANK = 60.0, 0.5
BOAT = 'name = "buoy"\nkind = "surface"\nnorth_m = 300\neast_m = 2000\n'
TURNING = (
    'name = "buoy"\nkind = "surface"\nwaypoints = [{ time_s = 0, north_m = 0, east_m = 0, altitude_m = 0 }, '
    "{ time_s = 20, north_m = 0, east_m = 200, altitude_m = 0 }, "
    "{ time_s = 40, north_m = 400, east_m = 200, altitude_m = 0 }]\n"
)


def _line(start, velocity):
    times = np.linspace(0.0, END, 13)
    positions = np.asarray(start) + times[:, None] * np.asarray(velocity)
    knots = np.stack([positions, np.tile(velocity, (13, 1)), np.zeros((13, 3))], axis=1)
    return TimedPath(jnp.asarray(times), jnp.asarray(knots), jnp.zeros((13, 3, 3)))


def _record(valid=(True, True, True)):
    """Two aircraft, and a padding aircraft."""
    assert BOAT in GOOD
    lines = [
        _line((9000.0, 0.0, -1000.0), (-150.0, 0.0, 0.0)),
        _line((-8000.0, 100.0, -1500.0), (150.0, 0.0, 0.0)),
        _line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ]

    def repeat(value):
        return jnp.full(3, float(value))

    limits = {
        "speed_min": 90,
        "speed_max": 240,
        "bank_max": 1,
        "climb_rate_max": 80,
        "altitude_min": 100,
        "altitude_max": 15240,
        "load_factor_max": 5,
        "load_factor_min": 0.55,
    }
    bounds = {
        "speed_min": 149,
        "speed_max": 151,
        "bank_max": BANK,
        "load_factor_max": 1.5,
        "load_factor_min": 0.9,
        "climb_rate_max": 1,
        "altitude_min": 990,
        "altitude_max": 1510,
        "acceleration_max": 0.5,
        "deceleration_max": 0.25,
        "wind_error_max": 0,
    }
    ratio = jnp.array([[jnp.inf, 1.5, 0.1], [1.5, jnp.inf, 0.1], [0.1, 0.1, jnp.inf]])
    certificate = Certificate(
        bounds=PathBounds(
            **{key: repeat(value) for key, value in bounds.items()},
            cell_acceleration=jnp.zeros((3, 12)),
            cell_along=jnp.zeros((3, 12, 2)),
            cell_speeds=jnp.full((3, 12, 2), 150.0),
            cell_load_factors=jnp.ones((3, 12, 2)),
        ),
        excess=jnp.full((3, 9), -0.1),
        clearance_ratio=jnp.where(ratio < 1.0, 2.0, ratio),
        keep_out_clearance=jnp.zeros((3, 0)),
    )
    plan = CertifiedPlan(
        paths=jax.tree.map(lambda *leaves: jnp.stack(leaves), *lines),
        arrival_times=repeat(END),
        certificate=certificate,
        valid=jnp.array(valid),
        lengths=repeat(9000),
        total_turn=repeat(np.pi / 2),
        speeds=repeat(150),
    )
    path_limits = PathLimits(
        **{key: repeat(value) for key, value in limits.items()}, acceleration_max=repeat(8), deceleration_max=repeat(1)
    )
    tasks = eqx.tree_at(
        lambda t: (t.limits, t.active),
        stack_rows([aircraft_task((0.0, 0.0, 0.0))] * 3),
        (path_limits, jnp.array([1.0, 1.0, 0.0])),
    )
    return record_certified(loads(GOOD.replace(BOAT, TURNING)), plan, tasks, 9.81)


@pytest.fixture(scope="module")
def recorded():
    return _record()


def test_margins_are_proven(recorded):
    summary = recorded.summary
    assert [entry["name"] for entry in summary["aircraft"]] == ["alpha", "bravo"]
    assert summary["bounds"] == "proven"
    assert summary["planner"] == "certified"
    limits = {entry["name"]: entry for entry in summary["aircraft"][0]["limits"]}
    margins = {name: entry["margin"] for name, entry in limits.items()}
    # limits of the scenario less the bounds above; the accelerations are the planner's own
    assert margins == pytest.approx(
        {
            "airspeed_min_m_s": 59.0,
            "airspeed_max_m_s": 89.0,
            "bank_max_deg": 60.0 - np.degrees(BANK),
            "load_factor_max": 3.5,
            "load_factor_min": 0.4,  # of the autopilot's 0.5, for the scenario allows -1
            "climb_rate_max_m_s": 79.0,
            "altitude_min_m": 890.0,
            "altitude_max_m": 13730.0,
            "thrust_surplus_max_m_s2": 8.0 / 0.9 - 0.5,  # the reserve included
            "thrust_deficit_max_m_s2": 1.0 / 0.9 - 0.25,
        }
    )
    assert limits["airspeed_min_m_s"]["planned"] == pytest.approx(150.0, rel=1e-9)  # a straight line, to rounding
    assert summary["aircraft"][0]["path"] == "turns 90 deg"
    assert summary["separation"]["bound_ratio"] == 1.5


def test_the_closest_pair_is_recorded_by_separation_and_by_distance(recorded):
    # They pass each other at 17000/300 s, 100 m apart in the plane and 500 m in altitude: 150 m of which count as 500 m.
    separation, least_distance = recorded.summary["separation"], recorded.summary["least_distance"]
    assert least_distance["time_s"] == pytest.approx(17000 / 300, abs=1e-5)
    assert least_distance["value_m"] == pytest.approx(np.hypot(100.0, 500.0), abs=1e-6)
    assert separation["value_m"] == pytest.approx(500.0 * 500.0 / 150.0, abs=1e-6)
    assert separation["margin_m"] == pytest.approx(separation["value_m"] - 500.0)


def test_a_goal_with_waypoints_follows_the_scenario(recorded):
    goal = recorded.dataset.isel(aircraft=1)
    north, east = (goal[f"goal_{axis}_m"].sel(time=[10.0, 30.0, 50.0]).values for axis in ("north", "east"))
    np.testing.assert_allclose(north, [0.0, 200.0, 400.0], atol=1e-9)
    np.testing.assert_allclose(east, [100.0, 200.0, 200.0], atol=1e-9)


def test_a_path_without_proof_is_reported():
    summary = _record(valid=(True, False, False)).summary
    assert summary["problems"] == [f'aircraft "bravo": {UNPROVEN}']
    assert [entry["status"] for entry in summary["aircraft"]] == ["planned", UNPROVEN]
