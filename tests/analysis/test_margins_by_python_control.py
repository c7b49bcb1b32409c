"""Margins of the autopilot's loops compared with python-control's margins on another grid: F-16 and Aerosonde."""

import functools

import equinox as eqx
import jax
import numpy as np
import pytest

import control
from anser.aircraft_files import load_airframe
from anser.analysis.loop_margins import (
    FREQUENCY_MIN,
    Margins,
    breakpoints,
    excited_loop,
    frequencies,
    loop_margins,
    loop_response,
    loop_state_fields,
)
from anser.analysis.trim_points import survey_gains
from anser.control import default_limits
from anser.environment import standard_environment
from anser.simulation.response import LoopCase
from support.broken_loop import break_loop
from support.trims import target_deg, trim

pytestmark = pytest.mark.long

STEP, ENVIRONMENT = 0.01, standard_environment()
CASES = {
    "f16 level": ("f16", target_deg(150.0, 1000.0)),
    "f16 turning": ("f16", target_deg(200.0, 5000.0, turn_deg_s=3.0)),
    "aerosonde": ("aerosonde", target_deg(30.0, 500.0)),
}
LOOPS = ("elevator", "aileron", "rudder", "throttle", "P", "Q", "R", "mu", "alpha")
GAIN_DB, PHASE_DEG = 1e-3, 1e-3


@functools.cache
def analysed(case: str) -> tuple[Margins, dict[str, control.StateSpace]]:
    """Margins at the breakpoints, and each loop transfer function as a system of python-control."""
    name, target = CASES[case]
    airframe = load_airframe(name)
    point = trim(airframe, ENVIRONMENT, target)
    assert bool(point.converged)
    trims = jax.tree.map(lambda leaf: leaf[None], point)
    gains, derived_gains = survey_gains(airframe, ENVIRONMENT, trims, STEP, "model")
    if derived_gains is not None:
        gains = jax.tree.map(lambda leaf: leaf[0], derived_gains)
    limits = eqx.tree_at(
        lambda flight_limits: (
            flight_limits.speed_min,
            flight_limits.speed_max,
            flight_limits.alpha_min,
            flight_limits.alpha_max,
        ),
        default_limits(),
        (0.5 * target.speed, 2.0 * target.speed, *airframe.alpha_range),
    )
    loop_case = LoopCase(airframe, ENVIRONMENT, gains, limits, point, STEP)
    loop = eqx.filter_jit(excited_loop)(loop_case, loop_state_fields(gains, airframe))
    assert not np.asarray(loop.limited).any()
    assert breakpoints(airframe) == LOOPS
    margins, _ = eqx.filter_jit(loop_margins)(loop, STEP, eqx.filter_jit(loop_response)(loop, STEP, frequencies(STEP)))
    systems = [control.ss(*map(np.asarray, break_loop(loop, k)), 0, STEP) for k in range(len(LOOPS))]
    return margins, dict(zip(LOOPS, systems, strict=True))


def decibels(gain):
    with np.errstate(divide="ignore"):
        return 20 * np.log10(gain)


@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("case", CASES)
def test_margins_equal_those_of_python_control(case, name):
    margins, systems = analysed(case)
    computed = {field: float(values[LOOPS.index(name)]) for field, values in vars(margins).items()}
    system = systems[name]
    omega = np.geomspace(1.0001 * FREQUENCY_MIN, 0.99999 * np.pi / STEP, 5000)
    data = control.FrequencyResponseData(system(np.exp(1j * omega * STEP)), omega, smooth=True)
    gains, phases, _, _, crossovers, _ = control.stability_margins(data, returnall=True)
    # Ends of the frequency range, omitted by python-control: response at the Nyquist frequency, and static response.
    nyquist_value = system(-1.0).real
    end_gains = [-1 / nyquist_value] if nyquist_value < 0 else []
    if computed["gain_down_at"] == pytest.approx(FREQUENCY_MIN):
        lowest_value = system(np.exp(1j * FREQUENCY_MIN * STEP))
        assert abs(np.angle(-lowest_value)) < np.radians(5.0)
        end_gains.append(1 / abs(lowest_value))
    boundaries = np.array([*gains, *end_gains])
    up, down = boundaries[boundaries > 1].min(initial=np.inf), boundaries[boundaries < 1].max(initial=0.0)
    lag = np.mod(np.radians(phases), 2 * np.pi)
    phase = np.minimum(lag, 2 * np.pi - lag).min(initial=np.inf)
    assert decibels(computed["gain_up"]) == pytest.approx(decibels(up), abs=GAIN_DB)
    assert decibels(computed["gain_down"]) == pytest.approx(decibels(down), abs=GAIN_DB)
    assert np.degrees(computed["phase"]) == pytest.approx(np.degrees(phase), abs=PHASE_DEG)
    assert computed["delay"] == pytest.approx((lag / crossovers).min(initial=np.inf), rel=1e-5)
    # a parabola through the peak's three frequencies: measured 6e-5
    alpha = control.disk_margins(system, np.append(omega, np.pi / STEP), skew=0.0)[0]
    assert computed["disk"] == pytest.approx(alpha, rel=2e-4)
