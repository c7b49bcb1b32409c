"""Records from flights and users' tables: units, gaps, irregular samples, and one message for each defect."""

import numpy as np
import pandas as pd
import pytest

from anser.identification.records import flight_record, read_columns
from anser.units import DEG_RAD
from support.manoeuvres import clean_record, flight


def table(**changes):
    record = clean_record("doublet")
    columns = {"time_s": record.time_s, **{str(name): values.values for name, values in record.dataset.items()}}
    return pd.DataFrame(columns | changes)


def test_a_flight_a_table_and_a_file_give_the_same_record(tmp_path):
    expected = clean_record("doublet")
    table().to_csv(tmp_path / "flight.csv", index=False)
    flight("doublet").save(tmp_path / "run")
    for recording in (table(), tmp_path / "flight.csv"):
        record = flight_record(recording)
        assert record.step_s == pytest.approx(0.02)
        for key in ("alpha", "pitch_rate", "elevator", "specific_force_z"):
            np.testing.assert_allclose(record[key], expected[key], rtol=0.0, atol=1e-12)
    for recording in (tmp_path / "run", tmp_path / "run" / "flight.nc", flight("doublet").dataset):
        np.testing.assert_array_equal(flight_record(recording)["alpha"], expected["alpha"])


def test_columns_are_mapped_with_units_and_signs(tmp_path):
    record = clean_record("doublet")
    frame = pd.DataFrame(
        {
            "t": record.time_s * 1e3,
            "AOA": record["alpha"],
            "Q": record["pitch_rate"] / DEG_RAD,
            "NZ": -record["specific_force_z"] / 9.80665,
            "VT": record["airspeed"] * 3600.0 / 1852.0,
            "power": record["power"] / 100.0,
        }
    )
    (tmp_path / "map.toml").write_text(
        'time_s = { column = "t", unit = "ms" }\nalpha_deg = { column = "AOA", unit = "rad" }\npitch_rate_deg_s = "Q"\n'
        'specific_force_z_m_s2 = { column = "NZ", unit = "g", factor = -1 }\n'
        'airspeed_m_s = { column = "VT", unit = "kt" }\npower_percent = { column = "power", unit = "1" }\n'
    )
    mapped = flight_record(frame, read_columns(tmp_path / "map.toml"))
    for key in ("alpha", "pitch_rate", "specific_force_z", "airspeed", "power"):
        np.testing.assert_allclose(mapped[key], record[key], rtol=1e-12, atol=1e-12)


def test_gaps_and_irregular_samples_are_interpolated_with_a_note():
    random = np.random.default_rng(0)
    frame = table()
    kept = np.sort(random.permutation(np.arange(1, len(frame) - 1))[: int(0.8 * len(frame))])
    record = flight_record(frame.iloc[[0, *kept, len(frame) - 1]])
    assert "resampled at 50 Hz" in record.notes[0]
    expected = np.interp(record.time_s, frame["time_s"], frame["alpha_deg"]) * DEG_RAD
    # cubic interpolation over up to 0.2 s of the short period (2 rad/s, 2 deg): 5/384 (0.2)^4 16 x 2 deg = 7e-4 deg,
    # and linear interpolation of the truth at 0.02 s
    np.testing.assert_allclose(record["alpha"], expected, rtol=0.0, atol=1e-3 * DEG_RAD)
    missing = frame["alpha_deg"].to_numpy().copy()
    missing[100:105] = np.nan
    record = flight_record(table(alpha_deg=missing))
    assert record.notes == ("5 missing values of alpha_deg are interpolated.",)
    # the elevator reverses within the gap: the angular acceleration of 0.4 rad/s^2 changes sign over 0.12 s
    np.testing.assert_allclose(record["alpha"], frame["alpha_deg"] * DEG_RAD, rtol=0.0, atol=4e-3 * DEG_RAD)


def test_angles_over_a_full_turn_are_continuous():
    record = clean_record("doublet")
    yaw = 179.0 + 0.5 * record.time_s
    assert np.abs(np.diff(flight_record(table(yaw_deg=(yaw + 180.0) % 360.0 - 180.0))["yaw"])).max() < 0.001


def refused(recording, *columns, **options):
    with pytest.raises(ValueError, match=r"arrived .*; expected") as raised:
        flight_record(recording, *columns, **options)
    return str(raised.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,alpha_deg,alpha_deg\n0,1,99\n", "the column alpha_deg twice"),
        ("time_s,alpha_deg\n", "no row of numbers"),
        ("time_s,alpha_deg\n0,1,2,3\n1,2,3,4\n", "a row with more cells than the heading"),
        ("\0\xff" * 1000, "cannot be read as CSV"),
        ("time_s," + "x" * 200_000 + "\n0,1\n", "field larger than field limit"),
    ],
)
def test_each_defect_of_a_csv_file_has_a_message(tmp_path, text, message):
    (tmp_path / "flight.csv").write_text(text, encoding="latin-1")
    said = refused(tmp_path / "flight.csv")
    assert message in said
    assert len(said) < 500


def test_a_column_of_a_map_must_be_a_text():
    for entry in ({"column": ["alpha_deg"]}, {"column": "alpha_deg", "unit": ["deg"]}):
        assert "expected a column, or a table of column, unit and factor" in refused(table(), {"alpha_deg": entry})


def test_each_defect_of_a_recording_has_a_message(tmp_path):
    time = table()["time_s"].to_numpy()
    hole = np.where((time > 3.0) & (time < 4.0), np.nan, table()["alpha_deg"])
    messages = {
        "a gap of 1.02 s after 3 s": table()[(time <= 3.0) | (time > 4.0)],
        "alpha_deg with 49 missing values (NaN), over 1 s from 3 s": table(alpha_deg=hole),
        "1.98 s after 2 s (row 102)": table(time_s=np.where(time > 2.0, time - 0.04, time)),
        "2 times without a value": table(time_s=np.where(np.arange(time.size) < 2, np.nan, time)),
        "10 samples": table().head(10),
        "the column alpha_deg twice": table().assign(**{" alpha_deg": 0.0}),
        "text in the column 'alpha_deg'": table(alpha_deg="high"),
        "the columns beta_deg; expected a column time_s": table()[["beta_deg"]],
        "expected names of the catalogue": pd.DataFrame({"time_s": time, "AOA": 0.0 * time}),
        "dates or durations in the column 'time_s'": table(time_s=pd.to_datetime(time, unit="s")),
        "a dataset without the coordinate time": flight("doublet").dataset.drop_vars("time"),
        "no file": tmp_path / "absent.csv",
        "dict": {},
    }
    for text, recording in messages.items():
        assert text in refused(recording)


def test_each_defect_of_a_map_has_a_message():
    messages = {
        "'incidence'": {"incidence": "alpha_deg"},
        "the column 'AOA'": {"alpha_deg": "AOA"},
        "the unit 'm/s'; expected one of rad, deg": {"alpha_deg": {"column": "alpha_deg", "unit": "m/s"}},
        "the factor nan; expected a finite number": {"alpha_deg": {"column": "alpha_deg", "factor": float("nan")}},
        "a table of column, unit and factor": {"alpha_deg": {"column": "alpha_deg", "scale": 2.0}},
    }
    for text, columns in messages.items():
        assert text in refused(table(), columns)


def test_a_fleet_needs_the_name_of_an_aircraft():
    fleet = flight("doublet").dataset.expand_dims(aircraft=["a", "b"]).transpose("time", "aircraft")
    assert "2 aircraft; expected one of a, b" in refused(fleet)
    assert "'c'; expected one of a, b" in refused(fleet, aircraft_name="c")
    np.testing.assert_array_equal(flight_record(fleet, aircraft_name="b")["alpha"], clean_record("doublet")["alpha"])
    selected = fleet.sel(aircraft="b")
    assert flight_record(selected).attributes["aircraft_name"] == "b"
    assert "'a'; expected b" in refused(selected, aircraft_name="a")


def test_a_record_names_the_channel_that_it_lacks():
    record = flight_record(table()[["time_s", "alpha_deg"]])
    with pytest.raises(ValueError, match=r"arrived without pitch_rate_deg_s; expected it beside .*alpha_deg"):
        record["pitch_rate"]
    with pytest.raises(ValueError, match=r"window: arrived 3 to 3\.1 s"):
        record.window(3.0, 3.1)


def test_noise_has_the_given_deviation():
    record = clean_record("multisine")
    noisy = record.with_noise({"alpha_deg": 0.1}, seed=3)
    # 1,101 samples: the deviation has a standard error of 2 %
    assert np.std(noisy["alpha"] - record["alpha"]) == pytest.approx(0.1 * DEG_RAD, rel=0.08)
    np.testing.assert_array_equal(noisy["beta"], record["beta"])
    with pytest.raises(ValueError, match="'AOA'"):
        record.with_noise({"AOA": 0.1})
