"""Commands by name: the change, the deviation from a line over ground, the position."""

import jax.numpy as jnp
import numpy as np
import pytest

from anser.control import NamedCommands
from support.law_cases import FLAT, belief_of, instant_of


def guidance(follows=1.0, with_position=False):
    return NamedCommands(
        initial_commands={"trueBaseCourseCommand": jnp.asarray(0.5), "lateralDeviationError": jnp.asarray(0.0)},
        change={"lateralDeviationError": jnp.asarray(-600.0)},
        change_time=jnp.asarray(20.0),
        follows_line=jnp.asarray(follows),
        with_position=with_position,
    )


def test_commands_change_at_the_change_time():
    for time_s, expected in ((19.99, 0.0), (20.0, -600.0), (30.0, -600.0)):
        commands, _, _ = guidance(0.0).command(jnp.zeros(()), belief_of(), None, instant_of(time_s))
        assert float(commands["lateralDeviationError"]) == expected
        assert float(commands["trueBaseCourseCommand"]) == 0.5


def test_the_deviation_is_the_cross_track_distance_since_the_change():
    """Level flight with heading and course 0.8 rad: sin(0.3) of the distance is to the right of the line of 0.5 rad."""
    belief, memory = belief_of((0.0, 0.0, 0.8), (170.0, 0.0, 0.0), environment=FLAT), jnp.zeros(())
    for k in range(1900, 2100):
        commands, _, memory = guidance().command(memory, belief, None, instant_of(0.01 * k, FLAT))
        if k == 2000:
            assert float(commands["lateralDeviationError"]) == -600.0
    assert float(commands["lateralDeviationError"]) == pytest.approx(-600.0 + 0.99 * 170.0 * np.sin(0.3), rel=1e-12)
    _, _, deviation = guidance(0.0).command(jnp.asarray(3.0), belief, None, instant_of(30.0, FLAT))
    assert float(deviation) == 3.0


def test_the_position_is_correct_across_the_date_line():
    """80 km east of 3.14 rad east."""
    commands, _, _ = guidance(with_position=True).command(jnp.zeros(()), belief_of(), None, instant_of(0.0))
    east = 3.14 + 80_000 / (6_385_000 * np.cos(0.6))
    assert float(commands["geLongitude"]) == pytest.approx(east - 2 * np.pi, abs=1e-4)
    assert float(commands["geLatitude"]) == pytest.approx(0.6 + 1000 / 6.36e6, abs=1e-6)


def test_a_flat_earth_has_no_geodetic_position():
    with pytest.raises(TypeError, match="RotatingEarth"):
        guidance(with_position=True).command(jnp.zeros(()), belief_of(environment=FLAT), None, instant_of(0.0, FLAT))


def test_a_change_of_an_unknown_command_is_refused():
    with pytest.raises(ValueError, match="change: arrived 'mach'; expected names of initial_commands: altitudeMsl"):
        NamedCommands(initial_commands={"altitudeMslCommand": 1000.0}, change={"mach": 0.1})
