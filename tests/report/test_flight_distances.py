"""Zero-effort miss on paths with a known miss."""

import numpy as np
import xarray as xr

from anser.report.flight_histories import draw_miss, zero_effort_miss_m
from anser.report.flight_sheet import FigureFormat, FlightSheet


def _passing_flight(time, height_offset):
    """An aircraft flying North at 100 m/s past a rendezvous that moves East at 10 m/s, closest at 20 s."""
    zero = np.zeros_like(time)
    columns = {
        "north_m": 100.0 * (time - 20.0),
        "east_m": 10.0 * time + zero,
        "altitude_m": zero + 500.0,
        "rendezvous_north_m": zero,
        "rendezvous_east_m": 10.0 * time,
        "rendezvous_altitude_m": zero + 500.0 + height_offset,
        "velocity_north_m_s": zero + 100.0,
        "velocity_east_m_s": zero + 10.0,
        "velocity_down_m_s": zero,
        "goal_velocity_north_m_s": zero,
        "goal_velocity_east_m_s": zero + 10.0,
        "goal_velocity_down_m_s": zero,
    }
    return xr.Dataset(
        {name: (("time", "aircraft"), values[:, None]) for name, values in columns.items()}, {"time": time}
    )


def test_a_straight_flight_has_the_lateral_distance_as_miss_until_the_closest_approach():
    time = np.array([0.0, 5.0, 19.9, 20.0, 21.0])
    np.testing.assert_allclose(zero_effort_miss_m(_passing_flight(time, 7.0))[:4, 0], 7.0, rtol=1e-12)
    np.testing.assert_allclose(zero_effort_miss_m(_passing_flight(time, 7.0))[4, 0], np.hypot(100.0, 7.0), rtol=1e-12)


def test_an_aircraft_at_rest_relative_to_the_goal_has_its_distance_as_miss():
    still = _passing_flight(np.array([10.0]), 0.0)
    still["goal_velocity_north_m_s"] = still["velocity_north_m_s"]
    np.testing.assert_allclose(zero_effort_miss_m(still), 1000.0, rtol=1e-12)


def test_on_a_round_earth_the_aircraft_moves_on_the_local_map():
    """The recorded velocity is the true one; a position on the map far from its origin moves 1 % faster here."""
    time = np.linspace(0.0, 15.0, 31)
    round_earth = _passing_flight(time, 7.0).assign_attrs(earth_model="wgs84")
    round_earth["velocity_north_m_s"] = round_earth["velocity_north_m_s"] / 1.01
    np.testing.assert_allclose(zero_effort_miss_m(round_earth), 7.0, rtol=1e-9)


def test_the_zero_effort_miss_at_the_arrival_is_the_miss_of_the_summary(flight):
    dataset, summary = flight
    velocities = {
        f"velocity_{axis}_m_s": (
            ("time", "aircraft"),
            sign * np.gradient(dataset[name].values, dataset["time"], axis=0),
        )
        for axis, name, sign in (("north", "north_m", 1), ("east", "east_m", 1), ("down", "altitude_m", -1))
    }
    goals = {
        f"goal_velocity_{axis}_m_s": (
            ("time", "aircraft"),
            np.gradient(dataset[f"goal_{axis}_m"], dataset["time"], axis=0),
        )
        for axis in ("north", "east")
    }
    flown = dataset.assign(velocities | goals)
    arrival = int(np.searchsorted(dataset["time"].values, 80.0)) - 1
    miss = zero_effort_miss_m(flown)[arrival]
    # two samples before the closest approach: half the acceleration times the square of 0.05 s
    np.testing.assert_allclose(miss, [aircraft["miss_m"] for aircraft in summary["aircraft"]], atol=0.05)


def test_the_required_miss_is_a_line(flight):
    required = flight[0].assign_attrs(scenario='{"requirements": {"miss_max_m": 3.0}}')
    axes = draw_miss(FlightSheet(required.isel(time=slice(None, None, 20)), FigureFormat())).axes[0]
    assert [text.get_text() for text in axes.texts] == ["required: 3 m"]
    assert [3.0, 3.0] in [list(line.get_ydata()) for line in axes.lines]
    assert axes.get_yscale() == "log"
