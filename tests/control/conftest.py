"""Shared flights of the control tests, compiled once for all files."""

import equinox as eqx
import jax
import pytest

from anser.steady import TrimPoint, solve_trim, trim_target
from support.autopilot_cases import ALTITUDE, ENVIRONMENT, turned_after_100_steps
from support.control_cases import AIRFRAME, DEGREE


@pytest.fixture(scope="session")
def trims() -> list[TrimPoint]:
    """Level flight at 150 m/s to the north, and to 170 deg."""
    solve = jax.jit(solve_trim)
    return [solve(AIRFRAME, ENVIRONMENT, trim_target(150.0, ALTITUDE, 0.0, chi)) for chi in (0.0, 170 * DEGREE)]


@pytest.fixture(scope="module")
def turn_outputs():
    """`turned_after_100_steps`, compiled; a second trace fails."""
    return eqx.filter_jit(eqx.debug.assert_max_traces(turned_after_100_steps, max_traces=1))
