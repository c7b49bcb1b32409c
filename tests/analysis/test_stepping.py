"""The gallery of step responses: the published limits, the record, the condition, what is refused."""

import json

import numpy as np
import pytest

from anser.analysis import fly_steps, step_test
from anser.analysis.step_tests import CHANNEL_KEYS, PUBLISHED_STEPS, STEP_S, step_document
from anser.analysis.trim_points import ConditionError
from anser.variables import CATALOGUE

pytestmark = pytest.mark.long


BY_NAME = {variable.name: variable for variable in CATALOGUE}
NAMES = {variable.key: variable.name for variable in CATALOGUE}


@pytest.fixture(scope="module")
def gallery():
    return {flight.test.key: flight for flight in fly_steps(PUBLISHED_STEPS)}


def test_every_channel_of_every_loop_is_stepped_alone_and_with_the_others(gallery):
    for loop, channels in CHANNEL_KEYS.items():
        alone = [gallery[f"{loop}-{channel}"].test.commanded for channel in channels]
        assert [list(commanded) for commanded in alone] == [[channel] for channel in channels]
        together = gallery[f"{loop}-together"].test.commanded
        assert together == {channel: size for commanded in alone for channel, size in commanded.items()}


KEYS = [test.key for test in PUBLISHED_STEPS]


@pytest.mark.parametrize("key", KEYS)
def test_published_responses_keep_to_the_published_limits(gallery, key):
    assert gallery[key].shortfalls == ()


@pytest.mark.parametrize("key", KEYS)
def test_every_commanded_channel_rises_and_settles(gallery, key):
    """Overshoot and error at the end within the limits, whatever the sideslip; the figures are those of the record."""
    flight = gallery[key]
    document = flight.document()
    assert set(document["channels"]) | set(document["coupling"]) == set(CHANNEL_KEYS[flight.test.loop])
    for channel, of in document["channels"].items():
        assert 0.1 < of["rise_time_s"] < of["settling_time_s"] < flight.test.read_at_s
        assert of["overshoot_percent"] <= 10
        assert abs(of["final_error_percent"]) <= 1
        variable = next(v for v in CATALOGUE if v.key == CHANNEL_KEYS[flight.test.loop][channel])
        values = flight.dataset[variable.name].values[: round(flight.test.read_at_s / 0.01) + 1]
        beyond = np.max((values - values[0]) / of["size"]) - 1
        assert of["overshoot_percent"] == pytest.approx(100 * max(beyond, 0.0), abs=1e-9)  # rounding
    assert all(0 <= used <= 100 for used in document["surface_use_percent"].values())


def test_the_record_is_labelled_from_the_catalogue_and_begins_in_trim(gallery):
    for flight in gallery.values():
        dataset = flight.dataset
        for name, values in dataset.data_vars.items():
            assert values.attrs["units"] == BY_NAME[name].unit
            assert values.attrs["symbol"] == BY_NAME[name].symbol
        assert dataset["time"].values[[0, -1]] == pytest.approx([0, flight.test.duration_s], abs=1e-9)
        first = dataset.isel(time=0)
        # the trim is solved to 1e-12
        assert float(first["airspeed_m_s"]) == pytest.approx(150, abs=1e-9)
        for still in ("path_angle_deg", "course_deg", "bank_deg", "roll_rate_deg_s"):
            assert float(first[still]) == pytest.approx(0, abs=1e-9)
        name = dataset.attrs["commanded"][0]
        stem, unit = next((name.removesuffix(u), u) for u in ("_deg_s", "_m_s", "_deg") if name.endswith(u))
        size = next(iter(flight.test.commanded.values()))
        assert float(first[f"{stem}_command{unit}"] - first[name]) == pytest.approx(size, abs=1e-9)


@pytest.mark.parametrize("key", ["rates-r", "rates-together"])
def test_a_held_yaw_rate_ends_at_the_rudders_stop(gallery, key):
    """Why R is read early: up to the reading the rudder is free, half a second later it stands at its stop."""
    flight, stop_deg = gallery[key], 30  # theory section 4
    rudder = np.abs(flight.dataset["rudder_deg"].values)
    reading, soon = round(flight.test.read_at_s / STEP_S), round(1.5 / STEP_S)
    assert rudder[: reading + 1].max() < stop_deg - 3
    assert rudder[soon : soon + round(0.5 / STEP_S)].min() > stop_deg - 0.1


# Stepped alone: largest departure allowed of the other channels, deg/s, deg or m/s. Of rates inversion leaves 0.0094 of
# R from P; the outer loops are not infinitely faster than each other: a third to spare over what was measured, which is
# 0.06, 0, 0, 0.90 in attitude and 0.01, 0.11, 0, 0.22, 0.42 in velocity.
COUPLING = {
    "rates-p": {"q": 0.02, "r": 0.02},
    "rates-q": {"p": 0.02, "r": 0.02},
    "attitude-mu": {"beta": 0.1},
    "attitude-alpha": {"mu": 1e-3, "beta": 1e-3},
    "attitude-beta": {"mu": 1.5},
    "velocity-v": {"gamma": 0.05},
    "velocity-gamma": {"v": 0.2, "chi": 1e-3},
    "velocity-chi": {"v": 0.4, "gamma": 0.6},
}


@pytest.mark.parametrize("key", COUPLING)
def test_channels_disturb_each_other_little(gallery, key):
    dataset, channels = gallery[key].dataset, CHANNEL_KEYS[gallery[key].test.loop]
    for other, bound in COUPLING[key].items():
        values = dataset[NAMES[channels[other]]].values
        assert np.abs(values - values[0]).max() < bound, other


def test_surfaces_and_throttle_keep_to_their_stops(gallery):
    stops_deg = {"elevator_deg": 25, "aileron_deg": 21.5, "rudder_deg": 30}  # theory section 4
    for flight in gallery.values():
        for name, stop in stops_deg.items():
            assert np.abs(flight.dataset[name].values).max() <= stop + 1e-9  # rounding of the unit
        throttle = flight.dataset["throttle"].values
        if flight.test.loop == "velocity":
            assert np.all((throttle >= 0) & (throttle <= 1))
        else:
            np.testing.assert_array_equal(throttle, throttle[0])


def test_the_document_is_plain_json(gallery):
    flights = list(gallery.values())
    again = json.loads(json.dumps(step_document(flights), allow_nan=False))
    assert [step["key"] for step in again["steps"]] == KEYS
    assert again["speed_m_s"] == 150


def test_the_incremental_inversion_flies_them_too_and_is_another(gallery):
    tests = [test for test in PUBLISHED_STEPS if test.loop == "attitude"]
    for flight in fly_steps(tests, inversion="incremental"):
        assert flight.shortfalls == ()
        other = gallery[flight.test.key].dataset
        apart = max(
            float(np.abs(flight.dataset[name] - other[name]).max())
            for name in ("elevator_deg", "aileron_deg", "rudder_deg")
        )
        assert apart > 1e-3


def test_what_cannot_be_flown_is_said():
    test = step_test("velocity", {"v": 100.0})
    with pytest.raises(ConditionError, match=r"250 m/s .* 90 to 240 m/s"):
        fly_steps([test])
    with pytest.raises(ConditionError, match="slowest trimmable speed"):
        fly_steps([test], speed_m_s=30.0)


@pytest.mark.parametrize(
    ("loop", "sizes", "duration_s", "said"),
    [
        ("bank", {"mu": 5.0}, None, "loop: arrived 'bank'"),
        ("rates", {"mu": 5.0}, None, "channel: arrived 'mu'; expected one of p, q, r"),
        ("rates", {}, None, "channel: arrived none"),
        ("rates", {"p": 0.0}, None, "size: arrived 0 for p"),
        ("rates", {"p": float("nan")}, None, "size: arrived nan for p"),
        ("attitude", {"mu": 171.0}, None, "size: arrived 171 for mu; expected -170 to 170 deg"),
        ("rates", {"p": 5.0}, 0.0, "duration-s: arrived 0"),
    ],
)
def test_a_test_that_means_nothing_is_refused(loop, sizes, duration_s, said):
    with pytest.raises(ValueError, match=said):
        step_test(loop, sizes, duration_s)


def test_a_yaw_rate_is_flown_up_to_its_reading_only():
    assert step_test("rates", {"p": 5.0}).duration_s == 3.0
    assert step_test("rates", {"p": 5.0, "r": 5.0}).duration_s == 1.05
