"""Status of an aircraft in the closed loop: what ends the flight along its plan."""

import dataclasses
import types

import jax.numpy as jnp
import pytest

from anser.parts.perception import GOAL_DIVERGED, GOAL_NEVER_SEEN
from anser.planning.published.coordination import DIRECTION_UNATTAINABLE, GOAL_OUTRUNS, NO_BEND
from anser.simulation.closed_loop import (
    BREAKAWAY,
    FLYING,
    GOAL_LOST,
    GOAL_UNSEEN,
    LEFT_FLEET,
    _own_status,
    _vehicle_status,
    plan_status,
)
from anser.simulation.vehicle import no_faults

PLAN = types.SimpleNamespace(arrival_time=60.0)


def next_status(status, goal_status=None, leaving_time=jnp.inf):
    vehicle = types.SimpleNamespace(faults=dataclasses.replace(no_faults(), leaving_time=jnp.asarray(leaving_time)))
    uncertainty = None if goal_status is None else types.SimpleNamespace(goal_status=jnp.asarray(goal_status))
    belief, instant = types.SimpleNamespace(uncertainty=uncertainty), types.SimpleNamespace(time=50.0)
    return int(_vehicle_status(vehicle, jnp.asarray(status), belief, PLAN, instant, freeze=15.0))


@pytest.mark.parametrize("status", [FLYING, NO_BEND, DIRECTION_UNATTAINABLE])
def test_an_aircraft_on_a_path_to_its_rendezvous_loses_its_goal_or_leaves(status):
    assert next_status(status, GOAL_DIVERGED) == GOAL_LOST
    assert next_status(status, GOAL_NEVER_SEEN) == GOAL_UNSEEN
    assert next_status(status, leaving_time=50.0) == LEFT_FLEET
    assert next_status(status) == status


@pytest.mark.parametrize("status", [GOAL_OUTRUNS, BREAKAWAY, LEFT_FLEET])
def test_an_aircraft_off_its_plan_keeps_its_status(status):
    assert next_status(status, GOAL_DIVERGED, leaving_time=50.0) == status


def test_the_status_of_a_plan_is_that_of_the_next_plan_afterwards():
    own, recorded = jnp.asarray(FLYING), []
    for planned in (FLYING, GOAL_OUTRUNS, FLYING, DIRECTION_UNATTAINABLE, FLYING):
        status = plan_status(own, jnp.asarray(planned))
        recorded.append(int(status))
        own = _own_status(own, status, jnp.asarray(next_status(status)))
    assert recorded == [FLYING, GOAL_OUTRUNS, FLYING, DIRECTION_UNATTAINABLE, FLYING]
    lost = _own_status(own, own, jnp.asarray(next_status(own, GOAL_DIVERGED)))
    assert int(plan_status(lost, jnp.asarray(GOAL_OUTRUNS))) == GOAL_LOST
