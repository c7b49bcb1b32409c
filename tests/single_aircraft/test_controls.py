"""Controls over time from numbers, arrays, tables and signals, and the refusals."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import anser
from anser.single_aircraft.controls import sample_inputs, sample_times

REFERENCE = {"elevator": -2.0, "aileron": 0.0, "throttle": 0.2}
TIME = np.arange(5) * 0.25


def sampled(inputs, **options):
    return sample_inputs(inputs, REFERENCE, TIME, **options)


def test_inputs_that_are_left_out_keep_their_reference():
    assert sampled({}).tolist() == [[-2.0, 0.0, 0.2]] * 5


def test_numbers_are_absolute_and_signals_are_increments():
    values = sampled({"elevator": -1.0, "aileron": anser.step_input(3.0, start_s=0.5)})
    assert values[:, 0].tolist() == [-1.0] * 5
    assert values[:, 1].tolist() == [0.0, 0.0, 3.0, 3.0, 3.0]
    assert sampled({"elevator": -1.0}, increments=True)[:, 0].tolist() == [-3.0] * 5


def test_arrays_and_pairs_of_times_and_values():
    rows = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert sampled({"aileron": rows})[:, 1].tolist() == rows.tolist()
    assert sampled({"aileron": ([0.0, 1.0], [0.0, 4.0])})[:, 1].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_courses_are_interpolated_along_the_shorter_turn():
    reference = {"course_deg": 170.0, "path_angle_deg": 0.0}
    pair = ([0.0, 1.0], [170.0, -170.0])
    values = sample_inputs({"course_deg": pair, "path_angle_deg": pair}, reference, TIME)
    np.testing.assert_allclose(values, [[170, 170], [175, 85], [180, 0], [185, -85], [190, -170]])
    increments = sample_inputs({"course_deg": ([0.0, 1.0], [0.0, 200.0])}, reference, TIME, increments=True)
    np.testing.assert_allclose(increments[:, 0], [170.0, 220.0, 270.0, 320.0, 370.0])


def test_tables_of_all_kinds_give_the_same_controls(tmp_path):
    frame = pd.DataFrame({"time_s": [0.0, 1.0], "elevator_deg": [-2.0, 2.0], "throttle": [0.1, 0.3]})
    path = tmp_path / "stick.csv"
    frame.to_csv(path, index=False)
    dataset = xr.Dataset(
        {"elevator_deg": ("time", [-2.0, 2.0]), "throttle": ("time", [0.1, 0.3])}, {"time": [0.0, 1.0]}
    )
    expected = np.column_stack([np.linspace(-2.0, 2.0, 5), np.zeros(5), np.linspace(0.1, 0.3, 5)])
    for table in (frame, path, str(path), dataset):
        np.testing.assert_allclose(sampled(table), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"elevater": 1.0}, "arrived 'elevater'; expected inputs among elevator, aileron, throttle"),
        ({"heading_deg": 1.0}, "arrived 'heading_deg'; expected inputs"),
        ({"elevator": "up"}, r"controls\['elevator'\]: arrived str 'up'"),
        ({"elevator": np.zeros(4)}, "arrived 4 values; expected one for each of the 5 samples"),
        ({"elevator": np.nan}, "arrived values that are not finite"),
        (
            {"elevator": anser.doublet(1.0) + anser.multisine(1.0, (0.5, 3.0), 2.0)},
            r"controls\['elevator'\]: arrived a frequency of 3 Hz; expected at most 2 Hz, half the rate",
        ),
        ({"elevator": anser.sine_sweep(1.0, (0.5, 3.0), 2.0)}, "arrived a frequency of 3 Hz; expected at most 2 Hz"),
        ({"elevator": ([0.0, 0.0], [1.0, 2.0])}, "expected rows of equal length, with rising times"),
        ({"elevator": (0.0, 1.0, 2.0)}, "arrived a tuple of 3"),
        ("missing.csv", "missing.csv cannot be read as CSV"),
        (pd.DataFrame({"elevator": [0.0]}), "expected a column time_s"),
        (7, "arrived int; expected a mapping by input"),
    ],
)
def test_wrong_controls_are_refused_with_their_name(inputs, message):
    with pytest.raises(ValueError, match=message):
        sampled(inputs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,elevator\n", "stick.csv: arrived a table without rows"),
        ("time_s,elevator\n0,1\n1,nan\n", "stick.csv: arrived nan in the column 'elevator', row 2; expected a finite"),
        ("time_s,elevator\n0,1\n1,up\n", "stick.csv: arrived up in the column 'elevator', row 2; expected a finite"),
        ("time_s,elevator\n0,1\n2,1\n1,1\n", r"stick.csv: arrived time_s = 1 in row 3, after 2; expected rising"),
        ("time_s,elevater\n0,1\n", "stick.csv: arrived 'elevater'; expected inputs"),
        ("time_s,throttle\n0,50\n", "stick.csv, column 'throttle': arrived 50 to 50"),
    ],
)
def test_wrong_files_are_refused_with_file_and_row(tmp_path, text, message):
    (tmp_path / "stick.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        sampled(tmp_path / "stick.csv")


@pytest.mark.parametrize(("duration", "step"), [(0.0, 0.01), (1.0, -0.01), (np.inf, 0.01), (1e9, 0.01), (0.001, 0.01)])
def test_wrong_durations_are_refused(duration, step):
    with pytest.raises(ValueError, match=r"(duration|step)_s: arrived"):
        sample_times(duration, step)
