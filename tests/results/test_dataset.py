"""Conversion of a history to a dataset: complete, labelled, angles within one turn, positions on the ellipsoid."""

import numpy as np
import pymap3d
import pytest

from anser.results import to_dataset
from anser.results.dataset import surface_names
from anser.variables import CATALOGUE, DERIVED_KEYS, STANDARD_SURFACES


def test_every_variable_of_the_catalogue_is_labelled(time_s, history, names, attributes):
    dataset = to_dataset(time_s, history, names, attributes)
    assert list(dataset.data_vars) == [variable.name for variable in CATALOGUE]
    assert list(dataset["aircraft"].values) == list(names)
    assert dataset.attrs == attributes | {
        "surfaces": "elevator aileron rudder",
        "qnh_hpa": pytest.approx(1013.25, rel=1e-12),
    }
    assert dataset["time"].attrs["units"] == "s"
    for variable in CATALOGUE:
        variable_data = dataset[variable.name]
        assert variable_data.dims == ("time", "aircraft")
        assert variable_data.dtype == np.dtype(variable.dtype)
        assert (variable_data.attrs["units"], variable_data.attrs["frame"]) == (variable.unit, variable.frame)
        assert (variable_data.attrs["long_name"], variable_data.attrs["symbol"]) == (
            variable.long_name,
            variable.symbol,
        )
    assert dataset["phase"].attrs["flag_meanings"] == "approach frozen hold"
    assert list(dataset["phase"].attrs["flag_values"]) == [0, 1, 2]


def test_values_equal_history_times_factor(time_s, history, names, attributes):
    dataset = to_dataset(time_s, history, names, attributes)
    for variable in CATALOGUE:
        if variable.key not in DERIVED_KEYS:
            # The history's angles lie within +-3 rad, so that none is wrapped and the product is the very same.
            np.testing.assert_array_equal(dataset[variable.name], history[variable.key] * variable.factor)


@pytest.mark.parametrize(
    ("angle", "degrees"),
    [
        (3.5, np.degrees(3.5) - 360.0),
        (-9.0, np.degrees(-9.0) + 360.0),
        (13.0, np.degrees(13.0) - 720.0),
        (-np.pi, 180.0),
        (np.pi, 180.0),
        (0.1, 5.7295779513),
    ],
)
def test_angles_are_wrapped_to_one_turn(time_s, history, names, attributes, angle, degrees):
    history["course"][5, 1] = angle
    # Reducing an angle of a few turns in double precision costs some 1e-13 deg; 1e-9 covers the typed digits.
    assert to_dataset(time_s, history, names, attributes)["course_deg"][5, 1] == pytest.approx(degrees, abs=1e-9)


def test_rates_are_not_wrapped(time_s, history, names, attributes):
    history["roll_rate"][0, 0] = 5.0
    roll_rate = to_dataset(time_s, history, names, attributes)["roll_rate_deg_s"][0, 0]
    assert roll_rate == pytest.approx(286.4788975654116)


def test_positions_agree_with_pymap3d_near_the_reference(time_s, history, names, attributes):
    for key in ("north", "east", "altitude"):
        history[key] = history[key] * 1000.0
    dataset = to_dataset(time_s, history, names, attributes)
    latitude, longitude, _ = pymap3d.ned2geodetic(
        history["north"], history["east"], -history["altitude"], 47.5, 179.99, 0.0
    )
    # The flat Earth of theory section 1 wraps a plane around the ellipsoid. Over 3 km and 3 km of altitude it errs by
    # h d/R, 3000 * 3000 / 6.4e6 = 1.4 m, and by the convergence of the meridians, d^2 tan(lat) / R = 1.5 m, together
    # below 4 m: 4e-5 deg of latitude, 6e-5 deg of longitude at 47.5 deg.
    assert np.max(np.abs(dataset["latitude_deg"].values - latitude)) < 4e-5
    difference = (dataset["longitude_deg"].values - longitude + 180.0) % 360.0 - 180.0
    assert np.max(np.abs(difference)) < 6e-5
    # The record crosses the antimeridian: both signs occur, none beyond the turn.
    assert dataset["longitude_deg"].max() > 179.0
    assert dataset["longitude_deg"].min() < -179.0


def test_an_unknown_key_is_refused(time_s, history, names, attributes):
    history["altitud"] = history["altitude"]
    with pytest.raises(ValueError, match=r"unknown keys \['altitud'\]"):
        to_dataset(time_s, history, names, attributes)


def test_a_missing_key_is_refused(time_s, history, names, attributes):
    del history["thrust"]
    with pytest.raises(ValueError, match=r"missing keys \['thrust'\]"):
        to_dataset(time_s, history, names, attributes)


def test_latitude_cannot_be_recorded(time_s, history, names, attributes):
    history["latitude"] = history["north"]
    with pytest.raises(ValueError, match="latitude"):
        to_dataset(time_s, history, names, attributes)


def test_a_wrong_shape_is_refused(time_s, history, names, attributes):
    history["thrust"] = history["thrust"].T
    with pytest.raises(ValueError, match="thrust has shape"):
        to_dataset(time_s, history, names, attributes)


def test_a_wrong_number_type_is_refused(time_s, history, names, attributes):
    history["phase"] = history["phase"] * 1.0
    with pytest.raises(TypeError, match="phase holds float64"):
        to_dataset(time_s, history, names, attributes)


def test_time_must_increase(time_s, history, names, attributes):
    time_s[3] = time_s[2]
    with pytest.raises(ValueError, match="increasing"):
        to_dataset(time_s, history, names, attributes)


def test_a_repeated_name_is_refused(time_s, history, attributes):
    with pytest.raises(ValueError, match="each once"):
        to_dataset(time_s, history, ("anna", "bert", "anna"), attributes)


def test_a_missing_reference_is_refused(time_s, history, names, attributes):
    del attributes["reference_longitude_deg"]
    with pytest.raises(ValueError, match="reference_longitude_deg"):
        to_dataset(time_s, history, names, attributes)


def test_attributes_are_text_or_numbers(time_s, history, names, attributes):
    with pytest.raises(TypeError, match="wind"):
        to_dataset(time_s, history, names, attributes | {"wind": np.zeros((2, 2)).astype(object)})


ELEVONS = ("left_elevon", "right_elevon")


def elevons_only(history):
    """The history with two elevons instead of the standard surfaces."""
    remaining = {
        key: values for key, values in history.items() if key.removesuffix("_command") not in STANDARD_SURFACES
    }
    return remaining | {
        f"{name}{suffix}": history[f"{old}{suffix}"]
        for name, old in zip(ELEVONS, ("elevator", "aileron"), strict=True)
        for suffix in ("", "_command")
    }


def test_a_fleet_may_have_other_surfaces(time_s, history, names, attributes):
    dataset = to_dataset(time_s, elevons_only(history), names, attributes, [ELEVONS] * 3)
    assert surface_names(dataset) == ELEVONS
    assert "rudder_deg" not in dataset
    np.testing.assert_array_equal(dataset["left_elevon_deg"], np.degrees(history["elevator"]))
    assert dataset["right_elevon_command_deg"].attrs["long_name"] == "Right elevon command"
    assert "comment" not in dataset["left_elevon_deg"].attrs
    order = list(dataset.data_vars)
    assert order.index("left_elevon_deg") == order.index("load_factor") + 1


def test_the_recorded_surfaces_must_match_the_fleet(time_s, history, names, attributes):
    changed = elevons_only(history)
    del changed["right_elevon_command"]
    with pytest.raises(ValueError, match=r"missing keys \['right_elevon_command'\]"):
        to_dataset(time_s, changed, names, attributes, [ELEVONS] * 3)
    with pytest.raises(ValueError, match=r"unknown keys \['left_elevon', .*missing keys \['aileron'"):
        to_dataset(time_s, elevons_only(history), names, attributes)


def test_surfaces_that_may_be_missing_are_marked(time_s, history, names, attributes):
    mixed = history | elevons_only(history)
    dataset = to_dataset(time_s, mixed, names, attributes, [("elevator", *ELEVONS), STANDARD_SURFACES, ("elevator",)])
    assert surface_names(dataset) == ("elevator", *ELEVONS, "aileron", "rudder")
    assert "comment" not in dataset["elevator_deg"].attrs
    for name in (*ELEVONS, "aileron", "rudder"):
        assert dataset[f"{name}_command_deg"].attrs["comment"] == "NaN for an aircraft without this surface"


def test_surfaces_must_be_listed_for_each_aircraft(time_s, history, names, attributes):
    with pytest.raises(ValueError, match="surfaces are those of 1 aircraft; there are 3"):
        to_dataset(time_s, history, names, attributes, [STANDARD_SURFACES])


def test_an_older_dataset_has_the_standard_surfaces(time_s, history, names, attributes):
    dataset = to_dataset(time_s, history, names, attributes)
    del dataset.attrs["surfaces"]
    assert surface_names(dataset) == STANDARD_SURFACES
