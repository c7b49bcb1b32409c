"""CZML and KML, read by czml3 and fastkml against their schemas and compared with the flight through pymap3d."""

import json
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta

import czml3
import numpy as np
import pymap3d
import pytest
from fastkml import kml as fastkml
from fastkml import validator
from fastkml.features import Placemark
from fastkml.utils import find_all

from anser.report.exports.geographic import to_czml, to_kml
from anser.report.exports.tables import thin_record

START = datetime(2024, 5, 1, 10, 0, tzinfo=UTC)
# Written to 1e-9 deg, 1e-4 m.
POSITION_TOLERANCE_M = 2e-4


def _ecef(dataset, k):
    aircraft = dataset.isel(aircraft=k)
    columns = (aircraft[name].values for name in ("latitude_deg", "longitude_deg", "altitude_m"))
    return np.stack(pymap3d.geodetic2ecef(*columns), axis=-1)


def _axes_enu(dataset, k):
    """Forward and up axes of an aircraft in East, North, up, from the recorded angles."""
    roll, pitch, yaw = (np.radians(dataset[f"{name}_deg"].values[:, k]) for name in ("roll", "pitch", "yaw"))
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    forward = np.stack([cp * sy, cp * cy, sp], axis=-1)
    up = np.stack([-(cr * sp * sy - sr * cy), -(cr * sp * cy + sr * sy), cr * cp], axis=-1)
    return forward, up


def _seconds(text):
    return (datetime.fromisoformat(text) - START).total_seconds()


def test_czml_follows_the_schema_and_contains_positions_and_attitudes(flown):
    dataset, summary = flown
    text = to_czml(dataset, summary, START)
    packets = {packet.id: packet for packet in map(czml3.Packet.model_validate, json.loads(text))}
    assert next(iter(packets)) == "document"
    assert len(packets) == 1 + 2 + 3 + 3
    raw = {packet["id"]: packet for packet in json.loads(text)}
    begin, end = raw["document"]["clock"]["interval"].split("/")
    assert (_seconds(begin), _seconds(end)) == (0.0, 5.9)
    for k in range(3):
        packet = packets[f"aircraft-{k}"]
        assert packet.label.text == dataset["aircraft"].values[k]
        time, longitude, latitude, height = np.reshape(packet.position.cartographicDegrees.values, (-1, 4)).T
        np.testing.assert_allclose(time, dataset["time"].values, atol=1e-6)
        exported = np.stack(pymap3d.geodetic2ecef(latitude, longitude, height), axis=-1)
        np.testing.assert_allclose(exported, _ecef(dataset, k), atol=POSITION_TOLERANCE_M)

        samples = np.reshape(packet.orientation.unitQuaternion.values, (-1, 5))
        np.testing.assert_allclose(samples[:, 0], time)
        x, y, z, w = samples[:, 1:].T
        assert np.all(np.sum(samples[1:, 1:] * samples[:-1, 1:], axis=1) > 0.9)  # no jump to the other sign
        # First and third columns of the rotation matrix of (x, y, z, w).
        axes = (
            (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
            (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
        )
        for axis, expected in zip(axes, _axes_enu(dataset, k), strict=True):
            enu = np.stack(pymap3d.ecef2enuv(*axis, latitude, longitude), axis=-1)
            np.testing.assert_allclose(enu, expected, atol=5e-8)  # eight decimals of a quaternion


def test_czml_contains_each_goal_once_and_each_rendezvous_until_the_arrival(flown):
    dataset, summary = flown
    raw = {packet["id"]: packet for packet in json.loads(to_czml(dataset, summary, START))}
    assert [raw[f"goal-{k}"]["name"] for k in range(2)] == ["boat", "buoy"]
    rendezvous = raw["rendezvous-2"]
    assert _seconds(rendezvous["availability"].split("/")[1]) == pytest.approx(4.0)
    assert rendezvous["polyline"]["positions"]["references"] == ["goal-0#position", "rendezvous-2#position"]
    time, longitude, latitude, height = np.reshape(rendezvous["position"]["cartographicDegrees"], (-1, 4)).T
    # Against the plane that touches the ellipsoid, in which meridians converge: N E tan(latitude) / R = 4 mm.
    north, east, _ = pymap3d.geodetic2ned(latitude, longitude, 0.0, 47.5, 179.95, 0.0)
    sample_count = time.size
    np.testing.assert_allclose(north, dataset["rendezvous_north_m"].values[:sample_count, 2], atol=5e-3)
    np.testing.assert_allclose(east, dataset["rendezvous_east_m"].values[:sample_count, 2], atol=5e-3)
    np.testing.assert_allclose(height, 300.0)


def test_the_rendezvous_of_a_thinned_record_is_seen_up_to_the_arrival(flown):
    dataset, summary = flown
    thinned = thin_record(dataset, 2.5)
    later = thinned["time"].values[np.searchsorted(thinned["time"].values, 4.0)]
    raw = {packet["id"]: packet for packet in json.loads(to_czml(thinned, summary, START))}
    assert later > 4.0
    assert _seconds(raw["rendezvous-2"]["availability"].split("/")[1]) == pytest.approx(later)


def test_names_are_escaped_in_czml(flown):
    dataset, summary = flown
    aircraft = [table | {"goal": "<img src=x onerror=alert(1)>"} for table in summary["aircraft"]]
    raw = {packet["id"]: packet for packet in json.loads(to_czml(dataset, summary | {"aircraft": aircraft}, START))}
    assert "&lt;img" in raw["aircraft-0"]["description"]
    assert "<img" not in raw["aircraft-0"]["description"]


def test_kml_follows_the_schema_and_contains_times_positions_and_attitudes(flown, tmp_path):
    dataset, summary = flown
    path = tmp_path / "flight.kml"
    path.write_bytes(to_kml(dataset, summary, START))
    assert validator.validate(file_to_validate=path)
    document = fastkml.KML.parse(path, strict=True)
    marks = list(find_all(document, of_type=Placemark))
    assert [mark.name for mark in marks[:3]] == list(dataset["aircraft"].values)
    assert [mark.name for mark in marks[6:]] == ["boat", "buoy"]
    for k, mark in enumerate(marks[:3]):
        items = mark.kml_geometry.track_items
        assert len(items) == dataset.sizes["time"]
        times = [(item.when.dt - START) / timedelta(seconds=1) for item in items]
        np.testing.assert_allclose(times, dataset["time"].values, atol=1e-6)
        coordinates = np.array([(item.coord.x, item.coord.y, item.coord.z) for item in items]).T
        exported = np.stack(pymap3d.geodetic2ecef(coordinates[1], coordinates[0], coordinates[2]), axis=-1)
        np.testing.assert_allclose(exported, _ecef(dataset, k), atol=POSITION_TOLERANCE_M)
        angles = [(item.angle.heading, item.angle.tilt, item.angle.roll) for item in items]
        heading, tilt, roll = np.array(angles).T
        assert heading.min() >= 0.0
        assert heading.max() <= 360.0
        np.testing.assert_allclose(np.mod(heading - dataset["yaw_deg"].values[:, k] + 180, 360), 180.0, atol=1e-5)
        # Google Earth turns clockwise about the axis to the right and the axis ahead.
        np.testing.assert_allclose(tilt, -dataset["pitch_deg"].values[:, k], atol=1e-5)
        np.testing.assert_allclose(roll, -dataset["roll_deg"].values[:, k], atol=1e-5)


def test_text_is_escaped_in_kml(flown):
    dataset, summary = flown
    odd = dataset.assign_attrs(description="<script>chips</script> \x07 & \N{SNOWMAN}")
    root = ET.fromstring(to_kml(odd, summary, START))
    # Google Earth reads a description as HTML once XML is done with it.
    described = root.findtext("{*}Document/{*}description")
    assert described == "&lt;script&gt;chips&lt;/script&gt; \N{REPLACEMENT CHARACTER} &amp; \N{SNOWMAN}"


def test_exports_omit_values_that_are_not_finite(flown):
    dataset, summary = flown
    lost = dataset.copy(deep=True)
    lost["quaternion_2"][30:, 1] = np.nan
    lost["latitude_deg"][:, 2] = np.nan
    raw = {packet["id"]: packet for packet in json.loads(to_czml(lost, summary, START))}
    assert "aircraft-2" not in raw
    assert len(raw["aircraft-1"]["position"]["cartographicDegrees"]) == 30 * 4
    assert len(ET.fromstring(to_kml(lost, summary, START)).findall("{*}Document/{*}Folder/{*}Placemark")) == 2 + 3 + 2


def test_thinning_keeps_recorded_times_and_both_ends(flown):
    dataset, _ = flown
    assert list(thin_record(dataset, 2.0)["time"].values.round(6)) == [0.0, 2.0, 4.0, 5.9]
    assert list(thin_record(dataset, 1.04)["time"].values.round(6)) == [0.0, 1.0, 2.1, 3.1, 4.2, 5.2, 5.9]
    assert thin_record(dataset, 0.001).sizes["time"] == dataset.sizes["time"]
    assert thin_record(dataset, 1e-12).sizes["time"] == dataset.sizes["time"]
    assert list(thin_record(dataset, 100.0)["time"].values.round(6)) == [0.0, 5.9]
    assert thin_record(dataset.isel(time=[0]), 0.5).sizes["time"] == 1


def test_a_goal_that_is_taken_over_is_one_track_and_the_takers_former_goal_another(flown):
    dataset, summary = flown
    goal_names = [aircraft["goal"] for aircraft in summary["aircraft"]]
    assigned = [
        {"name": str(name), "goal": goal} for name, goal in zip(dataset["aircraft"].values, goal_names, strict=True)
    ]
    fleet = [dict(aircraft) for aircraft in summary["aircraft"]]
    # the second aircraft leaves its goal for that of the first at 3 s
    fleet[1]["goal"] = fleet[0]["goal"]
    events = [
        {"kind": "goal-taken-over", "whom": fleet[1]["name"], "time_s": 3.0, "goal": fleet[0]["goal"]},
        # nobody takes over its goal after it has left
        {"kind": "goal-taken-over", "whom": fleet[1]["name"], "time_s": 4.0},
    ]
    taken = dataset.copy()
    taken.attrs["scenario"] = json.dumps({"aircraft": assigned})
    summary = summary | {"aircraft": fleet, "events": events}
    raw = {packet["id"]: packet for packet in json.loads(to_czml(taken, summary, START))}
    goals = {packet["name"]: packet for key, packet in raw.items() if key.startswith("goal-")}
    assert set(goals) == set(goal_names)
    times = {name: packet["position"]["cartographicDegrees"][::4] for name, packet in goals.items()}
    np.testing.assert_allclose(times[goal_names[0]], dataset["time"].values, atol=1e-6)
    assert 2.8 < max(times[goal_names[1]]) < 3.0
    lines = [raw[key]["polyline"]["positions"]["references"][0] for key in ("rendezvous-1", "rendezvous-1-1")]
    assert lines == [f"{goals[goal]['id']}#position" for goal in (goal_names[1], goal_names[0])]
    folders = ET.fromstring(to_kml(taken, summary, START)).findall("{*}Document/{*}Folder")
    assert [len(folder.findall("{*}Placemark")) for folder in folders] == [3, 4, len(set(goal_names))]
