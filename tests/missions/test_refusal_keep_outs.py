"""Refusals by keep-outs name the keep-out that alone stands in the way, or all that do together."""

import jax.numpy as jnp
import numpy as np
import pytest

from anser.environment import SteadyWind
from anser.missions import refusal
from anser.numerics.arrays import stack_rows
from anser.planning.certified.search import FleetTask
from anser.planning.certified.task import ArrivalRequest, KeepOuts
from support.aircraft_tasks import aircraft_task, airspace


def task_with_keep_outs():
    air = airspace(SteadyWind(jnp.zeros(3)))
    volumes = KeepOuts(
        jnp.zeros((3, 2)), jnp.zeros((3, 2)), jnp.array([800.0, 900.0, 0.0]), jnp.zeros(3), jnp.full(3, 9000.0)
    )
    air = refusal.eqx.tree_at(lambda a: a.keep_outs, air, volumes, is_leaf=lambda leaf: leaf is None)
    return FleetTask(stack_rows([aircraft_task((8000.0, 0.0, 0.0))]), air, ArrivalRequest("together", 200.0))


@pytest.mark.parametrize(
    ("has_path", "text", "keys"),
    [
        (
            lambda radii: radii[1] < 700.0,
            ': the keep-out "ash" stands in the way; with a radius',
            ["keep_out[1].radius_m"],
        ),
        (
            lambda radii: radii[0] < 700.0 and radii[1] < 700.0,
            ': the keep-outs "cell" and "ash" stand in the way; with radii',
            ["keep_out[0].radius_m", "keep_out[1].radius_m"],
        ),
    ],
)
def test_a_keep_out_that_stands_in_the_way_is_named(monkeypatch, has_path, text, keys):
    monkeypatch.setattr(
        refusal, "reachable", lambda tasks, air, *_: np.array([has_path(np.asarray(air.keep_outs.radius))])
    )
    sentence, named = refusal._binding_constraint(0, task_with_keep_outs(), 90.0, ["cell", "ash"])
    assert sentence.startswith(text)
    assert sentence.endswith("% smaller, a path exists")
    assert list(named) == keys
