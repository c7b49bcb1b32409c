"""Excitation in the closed loop: signals in compiled flights, and their place before or after the control law."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft import Controls
from anser.numerics.arrays import cast_to_precision
from anser.numerics.multisine_phases import multisine_phases
from anser.parts import PathCommand
from anser.parts.excitation import build_excitation

SIGNALS = (
    anser.doublet(2.0),
    anser.three_two_one_one(-1.5, width_s=0.5),
    anser.sine_sweep(1.0, (0.2, 2.0), 6.0),
    anser.sine_sweep(1.0, (0.5, 0.5), 6.0),
    anser.multisine(1.0, (0.2, 2.0), 5.0, channel=1, channels=2),
    2.0 * anser.step_input(1.0) - anser.doublet(0.5, start_s=2.0),
)


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: signal.description)
def test_a_compiled_signal_has_the_values_of_the_signal_itself(signal):
    times = np.arange(800) * 0.01
    compiled = jax.jit(jax.vmap(signal.signal.at))(jnp.asarray(times))
    np.testing.assert_allclose(compiled, signal(times), rtol=0, atol=1e-12)
    single = jax.jit(jax.vmap(cast_to_precision(signal.signal, jnp.float32).at))(jnp.asarray(times, jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, signal(times), rtol=0, atol=2e-5)


def zero_command(**changes):
    zero = jnp.zeros(())
    return PathCommand(**dict.fromkeys(("V", "gamma", "chi", "V_dot", "gamma_dot", "chi_dot"), zero) | changes)


def test_signals_are_added_to_controls_and_commands_in_their_units():
    step = anser.step_input(3.0)
    names = ("rudder", "throttle", "airspeed", "course", "alpha", "yaw_rate", "rudder")
    excitation = build_excitation([(name, step if name != "throttle" else 0.1 * step) for name in names])
    assert excitation is not None
    controls = excitation.excite_controls(
        Controls(jnp.ones(3), jnp.asarray(0.5)), ("elevator", "aileron", "rudder"), 2.0
    )
    np.testing.assert_allclose(controls.surfaces, [1.0, 1.0, 1.0 + 2.0 * np.radians(3.0)], rtol=1e-15)
    np.testing.assert_allclose(controls.throttle, 0.8, rtol=1e-15)
    command = excitation.excite_command(zero_command(V=jnp.asarray(100.0)), 2.0)
    np.testing.assert_allclose([command.V, command.gamma, command.chi], [103.0, 0.0, np.radians(3.0)], rtol=1e-15)
    np.testing.assert_allclose(command.excitation.attitude, [0.0, np.radians(3.0), 0.0], rtol=1e-15)
    np.testing.assert_allclose(command.excitation.rates_b, [0.0, 0.0, np.radians(3.0)], rtol=1e-15)
    before = excitation.excite_command(zero_command(), 0.5)
    assert not any(np.any(leaf) for leaf in jax.tree.leaves(before))


def test_an_excitation_of_surfaces_leaves_any_command_as_it_is():
    excitation = build_excitation([("elevator", anser.doublet(1.0))])
    command = object()
    assert excitation.excite_command(command, 0.0) is command
    assert build_excitation([]) is None
    with pytest.raises(ValueError, match="arrived object as the command, for airspeed; expected a PathCommand"):
        build_excitation([("airspeed", anser.doublet(1.0))]).excite_command(command, 0.0)


@pytest.mark.parametrize(
    ("harmonics", "zero_phases", "schroeder", "reference"),
    [
        (range(2, 30, 3), 2.967, 1.341, 1.277),
        (range(3, 31, 3), 2.024, 1.217, 1.112),
        (range(4, 29, 3), 2.849, 1.371, 1.126),
        (range(2, 31), 3.444, 1.248, 1.149),
    ],
)
def test_peak_factors_are_at_most_those_of_the_reference(harmonics, zero_phases, schroeder, reference):
    """T = 20 s, dt = 0.02 s; reference: values computed with an optimizer from the phases of Schroeder (issue 45)."""
    k = np.array(harmonics)
    n = np.arange(1, k.size + 1)

    def peak_factor(phases):
        u = np.sum(np.cos(2.0 * np.pi * np.arange(1000)[:, None] / 1000 * k + phases), axis=1)
        return np.ptp(u) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(u**2)))

    assert peak_factor(np.zeros(k.size)) == pytest.approx(zero_phases, abs=6e-4)
    assert peak_factor(-np.pi * n * (n - 1) / k.size) == pytest.approx(schroeder, abs=6e-4)
    phases = multisine_phases(tuple(k.tolist()), (1.0,) * k.size)
    assert peak_factor(np.array(phases)) <= reference
    multisine_phases.cache_clear()
    assert multisine_phases(tuple(k.tolist()), (1.0,) * k.size) == phases  # the same in every process


def test_the_spectrum_of_a_multisine_is_the_requested_one():
    signals = [anser.multisine(2.0, (0.1, 1.5), 20.0, 0.0, channel=j, channels=2, power_exponent=-1.0) for j in (0, 1)]
    time = np.arange(1000) * 0.02
    spectra = [np.abs(np.fft.rfft(signal(time)))[:40] for signal in signals]
    first, second = (np.flatnonzero(spectrum > 1e-9 * spectrum.max()) for spectrum in spectra)
    np.testing.assert_array_equal(first, np.arange(2, 31, 2))
    np.testing.assert_array_equal(second, np.arange(3, 31, 2))
    power = spectra[0][first] ** 2
    np.testing.assert_allclose(power / power[0], first[0] / first, rtol=1e-9)
    assert abs(np.dot(signals[0](time), signals[1](time))) < 1e-9
    assert abs(signals[0](time)[0]) < 0.01


@pytest.fixture(scope="module")
def level():
    f16 = anser.aircraft("f16")
    return f16, f16.trim(150.0, 1000.0)


@pytest.mark.long
def test_the_recorded_command_contains_the_excitation(level):
    f16, trim = level
    flown = anser.simulate(
        f16,
        trim,
        controller="inversion",
        excitation={"elevator": anser.doublet(1.5), "path_angle_deg": anser.step_input(2.0, start_s=2.2)},
        duration_s=2.5,
    ).dataset
    jump = np.diff(flown["elevator_command_deg"].values)[[99, 199]]
    # at an edge the autopilot's part has not changed yet, but for the rate of the motion within a sample
    np.testing.assert_allclose(jump, [1.5, -3.0], atol=0.1)
    commanded = flown["path_angle_command_deg"].values - float(flown["path_angle_command_deg"][0])
    np.testing.assert_allclose(commanded[[219, 220, 250]], [0.0, 2.0, 2.0], atol=1e-9)
    assert "elevator: doublet of 1.5" in flown.attrs["excitation"]
    assert np.abs(flown["pitch_rate_deg_s"].values).max() > 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"excitation": {"elevator": anser.doublet(1.0)}}, "arrived without a controller"),
        ({"excitation": {"flap": anser.doublet(1.0)}, "controller": "inversion"}, "arrived 'flap'; expected inputs"),
        (
            {"excitation": {"bank_m_s": anser.doublet(1.0)}, "controller": "inversion"},
            "arrived 'bank_m_s'; expected inputs among .*, throttle, airspeed_m_s, .*, bank_deg, .*, yaw_rate_deg_s",
        ),
        (
            {"excitation": {"elevator": anser.multisine(1.0, (10.0, 60.0), 0.5)}, "controller": "inversion"},
            r"excitation\['elevator'\]: arrived a frequency of 60 Hz; expected at most 50 Hz",
        ),
        ({"excitation": {"elevator": 1.0}, "controller": "inversion"}, "arrived float; expected a signal"),
        ({"excitation": anser.doublet(1.0), "controller": "inversion"}, "expected signals by input"),
    ],
)
def test_an_excitation_that_does_not_fit_is_refused(level, arguments, message):
    f16, trim = level
    with pytest.raises(ValueError, match=message):
        anser.simulate(f16, trim, duration_s=1.0, **arguments)


def test_commands_inside_the_loops_need_the_autopilot_of_the_package(level):
    class Still(anser.parts.AbstractController):
        def init(self, state, attitude):
            return state.surfaces

        def control(self, controller_state, belief, command, step):
            return Controls(controller_state, jnp.asarray(0.2)), None, controller_state

    f16, trim = level
    with pytest.raises(
        ValueError, match="arrived 'bank_deg' with Still; expected an input of the aircraft or the path"
    ):
        anser.simulate(f16, trim, duration_s=1.0, controller=Still(), excitation={"bank_deg": anser.doublet(1.0)})
    flown = anser.simulate(f16, trim, duration_s=1.5, controller=Still(), excitation={"rudder": anser.doublet(1.0)})
    np.testing.assert_allclose(flown.dataset["rudder_command_deg"].values[[50, 120]], [0.0, 1.0], atol=1e-12)
