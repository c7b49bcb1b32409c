"""When one aircraft can be at its rendezvous: what is ruled out at once, and where all ways are tried."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from certified_cases import GRAVITY, LAYERED, STEADY, number

from anser.planning.certified import arrivals
from anser.planning.certified.choices import ALONE, DEEP, PLAIN
from anser.planning.certified.request import Airspace, KeepOuts, Separation, Traveller
from anser.planning.certified.search import stacked
from anser.planning.limits import PathLimits
from anser.planning.rendezvous import make_rendezvous

NOWHERE = KeepOuts(jnp.zeros((0, 2)), jnp.zeros((0, 2)), *(jnp.zeros(0),) * 3)
SPEED_MAX, CLIMB_MAX = 200.0, 40.0


def traveller(goal, moving=(0.0, 0.0, 0.0)):
    """At 2,000 m above the origin, flying north at 150 m/s; the rendezvous 300 m above a goal."""
    return Traveller(
        position_n=jnp.array([0.0, 0.0, -2000.0]),
        air_velocity_n=jnp.array([150.0, 0.0, 0.0]),
        air_acceleration_n=jnp.zeros(3),
        goal_position_n=jnp.asarray(goal, dtype=float),
        goal_velocity_n=jnp.asarray(moving, dtype=float),
        rendezvous=make_rendezvous(jnp.array([0.0, 0.0, -300.0])),
        speed=number(150.0),
        side=jnp.asarray(0),
        limits=PathLimits(*(number(x) for x in (100.0, SPEED_MAX, 0.9, CLIMB_MAX, 200.0))),
        roll_rate_max=number(0.5),
        active=number(1.0),
    )


def airspace(wind):
    return Airspace(wind, number(GRAVITY), Separation(number(0.0), number(0.0)), NOWHERE)


def earliest(goal, moving, wind):
    """First of many durations that is conceivable, s."""
    durations = np.linspace(1.0, 400.0, 7981)
    one, nobody = stacked([traveller(goal, moving)]), np.zeros(durations.size, dtype=int)
    good = arrivals.conceivable(one, airspace(wind), nobody, durations)
    assert np.all(np.diff(good.astype(int)) >= 0)
    return durations[np.argmax(good)]


def test_a_way_is_too_long_where_not_even_tail_wind_and_greatest_speed_will_do():
    wind = float(np.hypot(*np.asarray(STEADY.velocity_n)[:2]))
    level = (24_000.0, 10_000.0, -1700.0)  # the rendezvous is 26 km away
    np.testing.assert_allclose(earliest(level, (0.0, 0.0, 0.0), STEADY), 26_000.0 / (SPEED_MAX + wind), rtol=0.01)
    # A goal that comes nearer by 26 m/s: as much sooner.
    coming = earliest(level, (-24.0, -10.0, 0.0), STEADY)
    np.testing.assert_allclose(coming, 26_000.0 / (SPEED_MAX + wind + 26.0), rtol=0.01)
    # Of a layered wind the strongest layer within reach counts.
    layer = float(np.max(np.linalg.norm(np.asarray(LAYERED.velocities_n), axis=1)))
    assert 26_000.0 / (SPEED_MAX + 1.05 * layer) < earliest(level, (0.0, 0.0, 0.0), LAYERED) < 26_000.0 / SPEED_MAX


def test_a_way_is_too_steep_where_the_climb_takes_longer():
    steep = earliest((500.0, 0.0, -5700.0), (0.0, 0.0, 0.0), STEADY)
    assert 4000.0 / (CLIMB_MAX + 1.03 * 11.2) < steep <= 4000.0 / CLIMB_MAX


def test_limits_that_do_not_exist_rule_nothing_out():
    one = stacked([traveller((5000.0, 0.0, -1700.0))])
    free = eqx.tree_at(lambda t: (t.limits.speed_max, t.limits.climb_rate_max), one, (jnp.array([jnp.inf]),) * 2)
    assert arrivals.conceivable(free, airspace(STEADY), np.array([0]), np.array([1.0])).all()


def test_a_rendezvous_inside_a_closed_volume_is_no_way_while_it_is_there():
    """A cell of 2 km radius passes over a rendezvous 10 km away, from the south at 50 m/s; the goal moves with 10 m/s."""
    durations = np.linspace(80.0, 400.0, 641)
    one, nobody = stacked([traveller((10_000.0, 0.0, -1000.0), (10.0, 0.0, 0.0))]), np.zeros(durations.size, dtype=int)

    def open_below(bottom):
        volumes = KeepOuts(
            jnp.array([[0.0, 0.0]]), jnp.array([[50.0, 0.0]]), *(jnp.array([x]) for x in (2000.0, bottom, 5000.0))
        )
        there = eqx.tree_at(lambda a: a.keep_outs, airspace(STEADY), volumes)
        return arrivals.conceivable(one, there, nobody, durations)

    # It gains 40 m/s on a rendezvous 10 km ahead: over it from 200 to 300 s.
    np.testing.assert_array_equal(open_below(0.0), (durations <= 200.0) | (durations >= 300.0))
    assert np.all(open_below(1300.0))  # the rendezvous is at 1,300 m


@pytest.fixture
def asked(monkeypatch):
    """Times open by plain paths, and by all, in place of the planner's answers; what was asked is kept."""
    calls = []

    def answer(travellers, airspace, durations, ticks, choices):
        calls.append((choices, np.asarray(durations)))
        plain = (durations > 60.0) & (durations < 70.0)
        every = plain | ((durations > 44.0) & (durations < 80.0))
        deep = ((durations >= 80.0) & (durations < 84.0)) | ((durations > 91.0) & (durations < 93.0))
        return {PLAIN: plain, ALONE: every, DEEP: deep}[choices]

    monkeypatch.setattr(arrivals, "_reachable_at", answer)
    return calls


def test_all_ways_are_tried_near_what_plain_ones_reach_and_on_from_there(asked):
    one = stacked([traveller((5000.0, 0.0, -1700.0))])
    grid = np.arange(20.0, 120.0, 2.0)[None, :]
    inside = arrivals._open_times(one, airspace(STEADY), np.array([0]), grid, "none")
    np.testing.assert_array_equal(inside, (grid > 44.0) & (grid < 80.0))
    looked = np.concatenate([durations for choices, durations in asked if choices is ALONE])
    assert looked.min() >= 46.0 - 2.0 * arrivals._NEAR
    assert looked.max() <= 78.0 + 2.0 * arrivals._NEAR


def test_edges_are_refined_and_windows_looked_into(asked):
    one = stacked([traveller((5000.0, 0.0, -1700.0))])
    ((first, last),) = arrivals.arrival_sets(one, airspace(STEADY), 300.0)[0]
    assert 44.0 < first < 44.1
    assert 79.9 < last < 80.0
    windows = np.array([[70.0, 100.0]])
    ((first, last),) = arrivals.arrival_sets(one, airspace(STEADY), 300.0, windows)[0]
    assert first == 70.0
    assert 79.9 < last < 80.0
    assert arrivals.arrival_sets(one, airspace(STEADY), 300.0, np.array([[93.5, 95.0]])) == [[]]
    # What shapes do not reach is looked at again, with free motions.
    ((first, last),) = arrivals.arrival_sets(one, airspace(STEADY), 300.0, np.array([[90.0, 95.0]]))[0]
    assert 91.0 < first < last < 93.0


def test_free_motions_widen_the_times_where_asked_for(asked):
    one = stacked([traveller((5000.0, 0.0, -1700.0))])
    ((first, last),) = arrivals.arrival_sets(one, airspace(STEADY), 300.0, deeply=True)[0]
    assert 44.0 < first < 44.1
    assert 83.9 < last < 84.0
    looked = np.concatenate([durations for choices, durations in asked if choices is DEEP])
    assert 44.0 / 1.08**3 < looked.min() < looked.max() < 84.0 * 1.08**4  # a few steps beside what is open
