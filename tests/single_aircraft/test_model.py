"""The model of an aircraft: description, trim, linear model, derivatives, and starts by name."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from support import stevens_lewis as textbook


@functools.cache
def f16():
    return anser.aircraft("f16")


@functools.cache
def level():
    return f16().trim(speed_m_s=150.0, altitude_m=1000.0)


def test_the_printed_form_tells_mass_stops_and_signs():
    text = repr(f16())
    assert "9295.44 kg" in text
    assert "-25 to 25 deg, 60 deg/s, lag 0.0495 s; positive: nose down" in text
    assert "positive: rolls left" in text
    assert "positive: nose left" in text
    assert "inputs: elevator, aileron, rudder in deg, throttle 0 to 1" in text


def test_the_package_of_airframes_is_the_function_too():
    import anser.aircraft.f16

    assert anser.aircraft("aerosonde").inputs[-1] == "throttle"
    with pytest.raises(ValueError, match="f17"):
        anser.aircraft("f17")


def test_an_aircraft_file_and_an_own_airframe_are_models(tmp_path):
    from anser.aircraft_files.sources import write_airframe_starter

    path = tmp_path / "mine.toml"
    write_airframe_starter(path)
    from_file = anser.aircraft(path)
    own = anser.aircraft(from_file.airframe)
    assert own.identity["aircraft"] == "custom"
    assert own.inputs == from_file.inputs


def test_a_model_has_its_variant_and_centre_of_gravity_already():
    assert anser.aircraft(f16()) is f16()
    for arguments, arrived in (({"variant": "s119"}, "variant 's119'"), ({"x_cg_over_c": 0.3}, "x_cg_over_c = 0.3")):
        with pytest.raises(ValueError, match=f"aircraft: arrived {arrived} with an AircraftModel, which has its own"):
            anser.aircraft(f16(), **arguments)


def test_a_linear_model_about_a_trim_is_that_of_its_condition():
    about_trim = f16().linearize(level())
    by_condition = f16().linearize(speed_m_s=150.0, altitude_m=1000.0)
    np.testing.assert_array_equal(about_trim.model.A, by_condition.model.A)
    assert about_trim.condition["variant"] == "textbook"
    for arguments in ((), (level(),)):
        with pytest.raises(ValueError, match=r"linearize: arrived (neither|both)"):
            f16().linearize(*arguments, **({"speed_m_s": 150.0, "altitude_m": 0.0} if arguments else {}))
    with pytest.raises(ValueError, match=r"trim: arrived a trim of another aircraft of the same mass"):
        anser.aircraft("f16", x_cg_over_c=0.25).linearize(level())


def test_a_start_by_name_is_the_trim_again():
    named = f16().start(level())
    assert set(named) == set(f16().start_names)
    first, again = (f16().state_vector(start) for start in (level(), named))
    np.testing.assert_allclose(again, first, rtol=0, atol=1e-9)
    np.testing.assert_allclose(f16().input_vector(named), f16().input_vector(level()), rtol=0, atol=1e-12)


def test_derivatives_are_those_of_the_textbook_in_numpy():
    rng = np.random.default_rng(3)
    aircraft, foot = textbook.exact_constants(0.30), textbook.FOOT_M
    for _ in range(20):
        y = np.concatenate(
            [
                rng.uniform([400.0, 0.0, -0.1, -1.0, -0.5, -3.0], [700.0, 0.3, 0.1, 1.0, 0.5, 3.0]),
                rng.uniform(-0.3, 0.3, 3),
                [0.0, 0.0, rng.uniform(1e3, 3e4), rng.uniform(5.0, 95.0)],
                rng.uniform(-10.0, 10.0, 3),
            ]
        )
        controls = textbook.Controls(rng.uniform(0.0, 1.0), *rng.uniform(-10.0, 10.0, 3))
        expected = textbook.with_actuators(aircraft, y, controls)
        V, alpha, beta = y[0] * foot, y[1], y[2]
        velocity = V * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        x = np.concatenate([[0.0, 0.0, y[11] * foot], velocity, y[3:6], y[6:9], np.radians(y[13:16]), [y[12]]])
        u = np.array([*np.radians(controls[1:]), controls.throttle])
        rates = np.asarray(_derivatives(x, u))
        assert rates[:3] == pytest.approx(expected[9:12] * foot, abs=1e-9)
        assert velocity @ rates[3:6] / V == pytest.approx(expected[0] * foot, abs=1e-9)
        assert rates[6:12] == pytest.approx(expected[3:9], abs=1e-9)
        assert np.degrees(rates[12:15]) == pytest.approx(expected[13:16], abs=1e-9)
        assert rates[15] == pytest.approx(expected[12], abs=1e-9)


@jax.jit
def _derivatives(x, u):
    return f16().derivatives(x, u)


def test_derivatives_are_zero_at_a_trim_and_have_finite_gradients_in_batches():
    x, u = f16().state_vector(level()), f16().input_vector(level())
    names = f16().state_names()
    rates = dict(zip(names, np.asarray(_derivatives(x, u)), strict=True))
    assert rates.pop("north_m") == pytest.approx(150.0, abs=1e-9)
    assert max(abs(value) for value in rates.values()) < 1e-8
    slopes = jax.jit(jax.vmap(jax.jacfwd(f16().derivatives), in_axes=(0, None)))(jnp.stack([x, x]), u)
    assert slopes.shape == (2, len(names), len(names))
    assert np.all(np.isfinite(slopes))


def test_derivatives_without_lag_have_the_rigid_body_alone():
    names = f16().state_names(lag=False)
    assert len(names) == 12
    x, u = f16().state_vector(level(), lag=False), f16().input_vector(level())
    rates = np.asarray(jax.jit(lambda x, u: f16().derivatives(x, u, lag=False))(x, u))
    np.testing.assert_allclose(rates, np.asarray(_derivatives(f16().state_vector(level()), u))[:12], atol=1e-8)


@pytest.mark.parametrize("name", ["f16", pytest.param("aerosonde", marks=pytest.mark.long)])
def test_derivatives_by_every_input_agree_with_differences(name):
    model = anser.aircraft(name)
    start = model.trim(*((150.0, 1000.0) if name == "f16" else (25.0, 300.0)))
    u = model.input_vector(start)
    for lag in (True, False):
        x = jnp.asarray(model.state_vector(start, lag=lag))
        rates = jax.jit(lambda u, x=x, lag=lag: model.derivatives(x, u, lag=lag))
        slopes = np.asarray(jax.jit(jax.jacfwd(rates))(jnp.asarray(u)))
        for k in range(u.size):
            h = 1e-5 * np.eye(u.size)[k]
            difference = (np.asarray(rates(u + h)) - np.asarray(rates(u - h))) / 2e-5
            np.testing.assert_allclose(slopes[:, k], difference, rtol=1e-5, atol=1e-5 * np.abs(slopes).max())
        assert np.abs(slopes[:, -1]).max() > 1.0  # the throttle acts, with and without the engine's lag


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: anser.aircraft(5), "aircraft: arrived int"),
        (lambda: f16().trim(float("nan"), 1000.0), "speed_m_s: arrived nan"),
        (lambda: f16().trim(-150.0, 1000.0), "expected a positive airspeed"),
        (lambda: f16().trim(150.0, 1000.0, 95.0), "path_angle_deg: arrived 95"),
        (lambda: f16().performance("0"), "altitude_m: arrived '0'"),
        (lambda: f16().derivatives(np.zeros(5), np.zeros(4)), r"arrived state of shape \(5,\); expected \(16,\)"),
        (lambda: f16().linearize("150"), "linearize: arrived str"),
    ],
)
def test_wrong_arguments_are_refused(act, message):
    with pytest.raises(ValueError, match=message):
        act()


def test_the_state_vector_of_a_trim_in_hot_air_is_that_of_its_start():
    f16 = anser.aircraft("f16")
    hot = f16.trim(150.0, 1000.0, atmosphere={"temperature_offset_k": 20.0})
    np.testing.assert_allclose(f16.state_vector(hot), f16.state_vector(f16.start(hot)), rtol=1e-14, atol=1e-14)
    assert np.all(np.isfinite(f16.input_vector(hot)))


def test_a_centre_of_gravity_is_a_part_of_the_identity():
    assert anser.aircraft("f16", x_cg_over_c=0.38).identity["x_cg_over_c"] == 0.38
    assert "x_cg_over_c" not in anser.aircraft("f16").identity
