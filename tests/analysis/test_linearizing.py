"""`anser.linearize`: trim point, linear model and its forms; conditions without a linear model."""

import builtins
import dataclasses
import json

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft_files import load_airframe
from anser.analysis import modes_of
from anser.analysis.step_flights import step_case
from anser.analysis.trim_points import ConditionError
from anser.control import published_gains
from support.plain_files import read_alone

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def level():
    return anser.linearize(speed_m_s=153.0, altitude_m=0.0, x_cg_over_c=0.3)


@pytest.fixture(scope="module")
def rates_loop():
    return anser.linearize(speed_m_s=153.0, altitude_m=0.0, x_cg_over_c=0.3, loop="rates", step_s=0.02)


def test_the_printed_result_lists_the_modes(level):
    lines = repr(level).splitlines()
    assert lines[0].startswith("f16 at 153 m/s and 0 m, open loop: 11 states, 4 inputs")
    assert [line.strip().split("  ")[0] for line in lines[2:]] == [mode.name for mode in level.modes]
    assert len(repr(level)) < 1200
    assert level._repr_html_().count("<tr>") == 1 + len(level.modes)


def test_the_model_is_that_of_the_trimmed_aircraft(level):
    assert level.condition["x_cg_over_c"] == pytest.approx(0.3)
    states = dict(zip(level.model.states, np.asarray(level.model.x), strict=True))
    assert states["V"] == pytest.approx(153.0)
    assert states["alpha"] == pytest.approx(float(level.trim.alpha))
    assert {"short period", "phugoid", "Dutch roll", "roll", "spiral"} <= {mode.name for mode in level.modes}
    np.testing.assert_array_equal(level.dataset.A, level.model.A)
    assert level.dataset.attrs["loop"] == "open"
    # an airframe object is equivalent to its name
    by_airframe = anser.linearize(load_airframe("f16", "textbook", 0.3), speed_m_s=153.0, altitude_m=0.0)
    assert by_airframe.condition["aircraft"] == "custom"
    np.testing.assert_array_equal(by_airframe.model.A, level.model.A)


def test_state_space_has_the_matrices_and_names(level, rates_loop):
    system = level.state_space()
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(system, name), getattr(level.model, name))
    assert system.state_labels == list(level.model.states)
    assert system.input_labels == ["throttle", "elevator", "aileron", "rudder"]
    assert system.dt == 0
    of_file = dataclasses.replace(level, condition={**level.condition, "aircraft": "./my-uav.toml"})
    assert of_file.state_space().name == "__my_uav_toml"  # python-control allows no dots
    sampled = rates_loop.state_space()
    assert sampled.dt == 0.02
    assert sampled.input_labels == ["P_command", "Q_command", "R_command"]
    poles = np.sort_complex([value for mode in level.modes for value in mode.eigenvalues])
    # Three poles at or near 0: their rounding error is 1e-9.
    np.testing.assert_allclose(np.sort_complex(system.poles()), poles, atol=1e-8)


def test_the_message_without_python_control_names_the_package(level, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **options):
        if name == "control":
            raise ImportError(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r'pip install "anser\[control\]"'):
        level.state_space()


def test_files_are_new_and_complete(level, tmp_path):
    level.write(tmp_path / "model.nc")
    level.write(tmp_path / "model.json")
    assert read_alone(tmp_path / "model.nc").identical(level.dataset)
    assert json.loads((tmp_path / "model.json").read_text()) == json.loads(json.dumps(level.document()))
    for name in ("model.nc", "model.json"):
        content = (tmp_path / name).read_bytes()
        with pytest.raises(FileExistsError):
            level.write(tmp_path / name)
        assert (tmp_path / name).read_bytes() == content
    with pytest.raises(ValueError, match=r"ends with .nc or .json"):
        level.write(tmp_path / "model.csv")


def test_a_sampled_loop_has_the_poles_of_its_integrators(rates_loop):
    assert rates_loop.condition["loop"] == "rates"
    assert rates_loop.condition["actuators"] == 1
    assert float(rates_loop.model.step) == 0.02
    rates_loop.dataset, rates_loop.document()
    # (1 + K_D) s^2 + K_P s + K_I: the sampling hardly changes the integral's pole
    integrals = [mode for mode in rates_loop.modes if mode.name in ("P_integral", "Q_integral", "R_integral")]
    assert len(integrals) == 3
    for mode in integrals:
        assert mode.eigenvalue == pytest.approx(np.roots([2.0, 10.0, 0.25]).max(), rel=0.01)


def test_loops_of_another_aircraft_have_its_own_gains_and_limits():
    """The Aerosonde at 25 m/s flies far below the F-16's least airspeed of 90 m/s."""
    small = anser.linearize("aerosonde", speed_m_s=25.0, altitude_m=500.0, loop="velocity")
    gains = step_case(load_airframe("aerosonde"), 25.0, 500.0, "model").gains
    flown = anser.linearize("aerosonde", speed_m_s=25.0, altitude_m=500.0, loop="velocity", gains=gains)
    np.testing.assert_array_equal(small.model.A, flown.model.A)


def test_incremental_inversion_adds_the_state_of_the_sensors():
    gains = eqx.tree_at(lambda g: g.sensor_bandwidth, published_gains(), jnp.asarray(20.0))
    result = anser.linearize(speed_m_s=153.0, altitude_m=0.0, loop="rates", gains=gains)
    assert result.model.states[-12:] == (
        *("X_residual", "Y_residual", "Z_residual", "P_dot_residual", "Q_dot_residual", "R_dot_residual"),
        *("P_last", "Q_last", "R_last", "P_dot_last", "Q_dot_last", "R_dot_last"),
    )
    # The last measurement is stored for a step: P_last(k+1) = P(k), the P of the state before the step.
    state_index = result.model.states.index("P_last")
    np.testing.assert_allclose(result.model.A[state_index], np.eye(len(result.model.states))[6], atol=1e-12)
    # Forces beyond the model fade with the filter, exp(-20 * 0.01), and have no effect in this loop.
    force = result.model.states.index("X_residual")
    assert float(result.model.A[force, force]) == pytest.approx(np.exp(-0.2))
    # With a perfect model the poles of the loop are unchanged: -4.975 in theory.
    distances = sorted(abs(value - complex(-4.9)) for mode in result.modes for value in mode.eigenvalues)[:3]
    assert max(distances) < 0.06


def test_conditions_without_a_model_are_refused():
    with pytest.raises(ConditionError, match=r"path angle rate 17.2 deg/s[^@]*engine power: 105"):
        anser.linearize(speed_m_s=153.0, altitude_m=0.0, x_cg_over_c=0.3, path_rate_deg_s=17.19)
    # 200 m/s at 5.7 deg/s takes 64 deg of bank, beyond the autopilot's limit; the speed limit is 240 m/s
    with pytest.raises(
        ConditionError, match=r"velocity loop does not hold this flight: the mu that it asks for is -3.8"
    ):
        anser.linearize(speed_m_s=200.0, altitude_m=1000.0, turn_rate_deg_s=5.73, loop="velocity")
    with pytest.raises(ConditionError, match=r"280.0 m/s; the autopilot flies 90 to 240 m/s"):
        anser.linearize(speed_m_s=280.0, altitude_m=1000.0, loop="velocity")
    with pytest.raises(ValueError, match=r"x_cg_over_c: arrived 0.3 with an airframe of your own"):
        anser.linearize(load_airframe(), speed_m_s=153.0, altitude_m=0.0, x_cg_over_c=0.3)
    with pytest.raises(ConditionError, match=r"pitch rate 17.2 deg/s[^@]*engine power: 105.1[^@]*fastest pull-up"):
        anser.linearize(speed_m_s=153.0, altitude_m=0.0, x_cg_over_c=0.3, pitch_rate_deg_s=17.19)
    with pytest.raises(ValueError, match="variant"):
        anser.linearize(variant="none", speed_m_s=153.0, altitude_m=0.0)


def test_a_vertical_attitude_is_refused():
    """An aircraft with four times the thrust climbs with its nose at 90 deg."""
    f16 = load_airframe()
    strong = eqx.tree_at(lambda a: a.engine.thrust_tables.cells[0], f16, 4 * f16.engine.thrust_tables.cells[0])
    level = anser.linearize(strong, speed_m_s=200.0, altitude_m=1000.0, path_angle_deg=70.0)
    nose = 70.0 + float(jnp.rad2deg(level.trim.alpha))
    assert modes_of(level.model)
    with pytest.raises(ConditionError, match="within 1 deg of the vertical"):
        anser.linearize(strong, speed_m_s=200.0, altitude_m=1000.0, path_angle_deg=70.0 + 90.0 - nose)
