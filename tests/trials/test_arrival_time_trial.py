"""The trial of arrival times: its tasks, and the straight line as the reference of arrivals."""

import jax.numpy as jnp
import numpy as np

from anser.numerics.arrays import stack_rows
from support.aircraft_tasks import aircraft_task
from trials.arrival_times import RULES, random_scenario, straight_times


def test_random_tasks_are_valid_and_of_every_kind():
    tasks = [random_scenario(seed) for seed in range(48)]
    assert {(scenario.arrival.rule, len(scenario.aircraft)) for scenario, _ in tasks} == {
        (rule, size) for rule in RULES for size in (1, 3)
    }
    assert {kind for _, kind in tasks} == {"level", "climb", "descent"}
    assert {scenario.goal_of(scenario.aircraft[0]).speed_m_s > 0.0 for scenario, _ in tasks} == {False, True}
    level = [scenario.aircraft for scenario, kind in tasks if kind == "level"]
    rises = np.array(
        [aircraft.rendezvous.stand_off_up_m - aircraft.start.altitude_m for fleet in level for aircraft in fleet]
    )
    assert np.any(rises == 0.0)
    assert np.any((rises != 0.0) & (np.abs(rises) < 1.0))


def test_the_straight_line_meets_a_moving_goal_in_the_wind():
    scenario = next(s for s, _ in map(random_scenario, range(48)) if s.wind.speed_m_s > 5.0 and len(s.aircraft) == 3)
    goals = (9000.0, 100.0, -1700.0), (-6000.0, 4000.0, -1500.0), (300.0, -8000.0, -2000.0)
    tasks = stack_rows([aircraft_task(goal, (10.0, -4.0, 1.0)) for goal in goals])
    times = straight_times(scenario, tasks)
    north, east, up = scenario.wind.velocity_m_s(0.0)
    drift = times[:, None] * np.array([north, east, -up])
    line = np.asarray(tasks.rendezvous_n + jnp.asarray(times)[:, None] * tasks.goal_velocity_n - tasks.position_n)
    np.testing.assert_allclose(np.linalg.norm(line - drift, axis=1), 150.0 * times)
