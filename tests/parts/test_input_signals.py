"""Input signals of flight tests: shapes in time, energy by octave, orthogonality, and refusals."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import anser
from anser.parts.input_signals import parse_signal

TIME = np.arange(0.0, 12.0, 0.01)


def test_a_doublet_has_two_pulses_of_opposite_sign():
    values = anser.doublet(2.0, start_s=1.0, width_s=0.5)(TIME)
    assert np.all(values[TIME < 0.995] == 0.0)
    assert np.all(values[(TIME > 0.995) & (TIME < 1.495)] == 2.0)
    assert np.all(values[(TIME > 1.495) & (TIME < 1.995)] == -2.0)
    assert np.all(values[TIME > 1.995] == 0.0)


def test_a_3211_lasts_seven_units_with_alternating_sign():
    values = anser.three_two_one_one(1.5, start_s=1.0, width_s=0.5)(np.array([1.2, 2.4, 2.6, 3.4, 3.7, 4.2, 4.6]))
    assert values.tolist() == [1.5, 1.5, -1.5, -1.5, 1.5, -1.5, 0.0]


def test_signals_are_added_and_scaled():
    total = 2.0 * anser.step_input(1.0, start_s=2.0) + anser.doublet(0.5, start_s=4.0)
    assert total([1.0, 3.0, 4.5, 5.5, 7.0]).tolist() == [0.0, 2.0, 2.5, 1.5, 2.0]
    assert "step of 1 at 2 s" in total.description
    assert "doublet of 0.5" in total.description


def test_a_sweep_passes_the_geometric_mean_at_half_time():
    values = anser.sine_sweep(1.0, (0.25, 4.0), duration_s=10.0, start_s=1.0)(TIME)
    crossings = TIME[1:][np.diff(np.signbit(values).astype(int)) != 0]
    frequency = 0.5 / np.diff(crossings)
    middle = np.interp(6.0, 0.5 * (crossings[1:] + crossings[:-1]), frequency)
    assert middle == pytest.approx(1.0, rel=0.05)  # a period of the sweep there changes the frequency by 3 %
    assert np.abs(values).max() == pytest.approx(1.0, abs=1e-3)


def test_multisines_of_several_channels_are_orthogonal_and_of_low_peak_factor():
    t = np.arange(0.0, 20.0, 0.01)
    signals = [anser.multisine(3.0, (0.1, 2.0), 20.0, start_s=0.0, channel=k, channels=3)(t) for k in range(3)]
    norms = [np.sqrt(np.mean(values**2)) for values in signals]
    for k in range(3):
        assert np.abs(signals[k]).max() == pytest.approx(3.0, rel=1e-2)
        assert 3.0 / (np.sqrt(2.0) * norms[k]) < 1.6  # relative peak factor; of equal phases, 3.6
        assert abs(signals[k][0]) < 0.1
        for j in range(k):
            # harmonics of one period are orthogonal over it
            assert abs(np.mean(signals[k] * signals[j])) < 1e-12 * norms[k] * norms[j] + 1e-12


@pytest.mark.parametrize("power_exponent", [0.0, -1.0])
def test_a_multisine_of_many_harmonics_has_the_phases_of_schroeder_at_once(power_exponent):
    begin = time.process_time()
    signal = anser.multisine(2.0, (0.1, 10.0), 20.0, 0.0, power_exponent=power_exponent)
    assert time.process_time() - begin < 1.0  # with optimized phases, 10 s
    values = signal(np.arange(0.0, 20.0, 1.0 / 1024.0))
    assert np.abs(values).max() == pytest.approx(2.0, rel=2e-3)
    assert abs(values[0]) < 0.1
    assert np.ptp(values) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(values**2))) < 1.4  # of equal phases, 20


@given(st.floats(0.1, 50.0), st.floats(0.0, 5.0), st.floats(0.1, 3.0))
def test_doublet_and_3211_leave_no_mean_of_their_first_pulses(amplitude, start, width):
    t = start + width * (np.arange(2000) + 0.5) / 1000
    assert abs(np.sum(anser.doublet(amplitude, start, width)(t))) < 1e-6 * amplitude * t.size


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: anser.doublet(np.nan), "amplitude: arrived nan"),
        (lambda: anser.doublet(1.0, width_s=0.0), "width_s: arrived 0"),
        (lambda: anser.sine_sweep(1.0, (1.0, 2.0), 10.0, start_s=np.nan), "start_s: arrived nan"),
        (lambda: anser.multisine(1.0, (0.1, 1.0), 10.0, start_s=np.inf), "start_s: arrived inf"),
        (lambda: anser.doublet(1.0, start_s=-1.0), "start_s: arrived -1.0; expected 0 or later"),
        (lambda: anser.step_input(1.0, start_s=-1.0), "start_s: arrived -1.0; expected 0 or later"),
        (lambda: anser.sine_sweep(1.0, (0.1, 1.0), 10.0, start_s=-1.0), "start_s: arrived -1.0; expected 0 or later"),
        (lambda: anser.sine_sweep(1.0, (2.0, 1.0), 10.0), "frequencies_hz: arrived 2 and 1"),
        (lambda: anser.multisine(1.0, (0.01, 0.02), 5.0), "a range with a harmonic of 0.2 Hz"),
        (lambda: anser.multisine(1.0, (0.1, 1.0), 10.0, channel=2, channels=2), "channel: arrived 2 of 2"),
        (lambda: parse_signal("dublet:1"), "arrived 'dublet:1'"),
        (lambda: parse_signal("doublet"), "expected step:AMPLITUDE"),
        (lambda: parse_signal("doublet:1:2:3:4"), "arrived 'doublet:1:2:3:4'"),
    ],
)
def test_wrong_numbers_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_signal_as_text_has_amplitude_start_and_width():
    assert parse_signal("doublet:2:3:0.5")([3.2, 3.7]).tolist() == [2.0, -2.0]
    assert parse_signal("3211:-1")([1.1]).tolist() == [-1.0]
