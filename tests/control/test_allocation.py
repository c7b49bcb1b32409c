"""Allocation: surfaces whose moment is the wanted one (theory section 5, item 1)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from control_cases import AIRFRAME, DEGREE, setting_of, vectors
from hypothesis import given, settings

from anser.aircraft import moment_for_acceleration
from anser.control import allocate

modest = settings(deadline=None, max_examples=60)
LOWER, UPPER = np.asarray(AIRFRAME.actuators.lower), np.asarray(AIRFRAME.actuators.upper)

# V, alpha, beta, mu, gamma, chi; rates; surfaces; power, altitude; no wind
conditions = vectors(
    (90.0, 240.0),
    (-8 * DEGREE, 30 * DEGREE),
    (-10 * DEGREE, 10 * DEGREE),
    *((-1.0, 1.0),) * 3,
    *((-0.8, 0.8),) * 3,
    *((-24 * DEGREE, 24 * DEGREE), (-20 * DEGREE, 20 * DEGREE), (-28 * DEGREE, 28 * DEGREE)),
    (0.0, 100.0),
    (100.0, 9000.0),
    *((0.0, 0.0),) * 3,
)
inside = vectors((-23.9 * DEGREE, 23.9 * DEGREE), (-21 * DEGREE, 21 * DEGREE), (-29 * DEGREE, 29 * DEGREE))


def _moment(setting, surfaces):
    forces = AIRFRAME.aerodynamics(setting.now.air_data, setting.state.rates_b, surfaces)
    return forces.moment_b + setting.now.propulsive.moment_b


@jax.jit
def allocated(x, target):
    """Moment of `target` surfaces, what allocation makes of it from the present ones, and their moment."""
    setting = setting_of(x)
    wanted_b = _moment(setting, target)
    demand = allocate(AIRFRAME, setting.now, setting.state.rates_b, setting.state.surfaces, wanted_b)
    scale = setting.now.air_data.qbar * AIRFRAME.wing_area * jnp.stack([AIRFRAME.span, AIRFRAME.mean_chord, AIRFRAME.span])
    return demand, (_moment(setting, demand.surfaces) - wanted_b) / scale


@modest
@given(conditions, inside)
def test_the_wanted_moment_is_reached_across_the_elevator_breakpoints(x, target):
    """From any present deflection to any other: Cm0 has breakpoints at -12, 0 and 12 deg of elevator."""
    demand, error = allocated(x, target)
    # the second Newton step lands on the right piece of the table but for jumps over two breakpoints
    assert np.abs(error).max() < 2e-3
    within = np.all((np.asarray(demand.surfaces) >= LOWER) & (np.asarray(demand.surfaces) <= UPPER))
    assert within == (not np.any(demand.saturated))
