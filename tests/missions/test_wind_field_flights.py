"""Flights in wind fields from files: plans with the bound of what the layers leave out, refusals, ends of the field."""

import collections
import functools
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.quiver import Quiver

import anser
from anser.config.errors import ScenarioError
from anser.environments import make
from anser.environments.cases import FlightRange
from anser.missions import NoPlanError
from anser.numerics.arrays import stack_objects
from anser.planning.demand import demand
from anser.report.flight_sheet import FigureFormat, FlightSheet
from anser.report.flight_tracks import _draw_wind
from anser.scenario import Scenario, validate
from anser.scenario.build import build_flight
from anser.scenario.cautions import find_cautions
from anser.simulation import STATUS_MESSAGES
from anser.simulation.closed_loop import OUTSIDE_WIND
from support.wind_files import era5_file, metric_file


@functools.cache
def field(amplitude_m_s: float, *, half_m: float = 20e3, north_max_m: float | None = None, end_s: float = 0.0) -> str:
    """Write a field with a shear of 0.005 1/s and waves of 9 km, and return its path."""

    def velocity(t: Any, n: Any, e: Any, h: Any) -> tuple[Any, Any, Any]:
        return 4.0 + 0.005 * h + amplitude_m_s * np.sin(n / 1500.0), amplitude_m_s * np.cos(e / 1500.0), 0.0 * h

    return str(
        metric_file(
            Path(tempfile.mkdtemp()) / "field.nc",
            velocity,
            north=np.linspace(-half_m, half_m if north_max_m is None else north_max_m, 41),
            east=np.linspace(-half_m, half_m, 41),
            altitude=np.linspace(0.0, 3000.0, 7),
            times_s=np.array([0.0, end_s]) if end_s else None,
        )
    )


def scenario(wind: dict[str, Any], planner: str = "certified", duration_s: float = 90.0) -> Scenario:
    """Return a flight of one aircraft to the north-east, 8 km in less than a minute."""
    start = {"north_m": -6000.0, "east_m": -3000.0, "altitude_m": 1200.0, "speed_m_s": 150.0, "course_deg": 30.0}
    aircraft = {"name": "a", "goal": "boat", "start": start, "rendezvous": {"stand_off_up_m": 1000.0}}
    return validate(
        {
            "format": 2,
            "name": "field",
            "timing": {"duration_s": duration_s},
            "fleet": {"speed_m_s": 150.0, "planner": planner},
            "wind": wind,
            "aircraft": [aircraft],
            "goal": [{"name": "boat", "kind": "surface", "north_m": 1000.0, "east_m": 1000.0}],
        }
    )


@pytest.mark.long
def test_a_short_duration_gives_no_caution_in_the_unread_wind_of_a_field() -> None:
    # 8 km take 53 s in still air, as which the checks count a field
    cautions = find_cautions(scenario({"field": field(1.5)}, duration_s=50.0))
    assert not any("timing.duration_s" in caution for caution in cautions)


@pytest.mark.long
def test_the_certificate_of_a_plan_holds_in_the_wind_of_the_field() -> None:
    planned = anser.plan(scenario({"field": field(1.5)}))
    bounds = jax.tree.map(lambda leaf: np.asarray(leaf)[0], planned.plan.certificate.bounds)
    path, wind = jax.tree.map(lambda leaf: leaf[0], planned.plan.paths), planned.flight.environment.wind
    gravity = planned.flight.environment.gravity

    def sampled(time: Any) -> tuple[Any, Any]:
        point = path.at(time)
        wind_n = wind.at(point.position_n, time)
        difference_n = wind_n - planned.airspace.wind.at(point.position_n, time)
        return demand(point.velocity_n - wind_n, point.acceleration_n, gravity), difference_n

    flown, difference_n = jax.jit(jax.vmap(sampled))(jnp.linspace(0.0, planned.arrival_s, 2000))
    difference_m_s = np.linalg.norm(np.asarray(difference_n), axis=1)
    assert 0.5 < np.max(difference_m_s) <= bounds.wind_error_max < 4.0 * np.max(difference_m_s)
    assert bounds.speed_min <= np.min(flown.speed)
    assert np.max(flown.speed) <= bounds.speed_max
    assert np.max(np.abs(flown.bank)) <= bounds.bank_max
    assert np.max(flown.normal) <= bounds.load_factor_max * gravity
    assert -bounds.deceleration_max <= np.min(flown.along)
    assert np.max(flown.along) <= bounds.acceleration_max
    assert any(f"at most {bounds.wind_error_max:.1f} m/s, which the cert" in note for note in planned.notes())


@pytest.mark.long
def test_a_difference_that_eats_the_limits_is_a_reason_for_a_missing_plan() -> None:
    planned = anser.plan(scenario({"field": field(25.0)}))
    with pytest.raises(NoPlanError, match=r"the wind field differs by up to [\d.]+ m/s from the layers of wind"):
        _ = planned.plan
    assert planned.refusals[0].keys == ("wind.field",)


@pytest.mark.long
def test_starts_goals_and_durations_beyond_the_field_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"rendezvous.*arrived 1000 m.*from -20000 to 500 m.*wind.outside"
    ) as caught:
        anser.plan(scenario({"field": field(1.0, north_max_m=500.0)}))
    assert len(caught.value.problems) == 1
    with pytest.raises(ScenarioError, match=r"timing.duration_s: arrived 90.*at most 60 s, where the wind field ends"):
        anser.plan(scenario({"field": field(1.0, end_s=60.0)}))
    held = anser.plan(scenario({"field": field(1.0, north_max_m=500.0, end_s=60.0), "outside": "hold"}))
    assert not held.refusals


@pytest.mark.long
def test_a_flight_that_leaves_the_field_ends_with_a_status() -> None:
    # the published planner does not know the end of the field, which lies between rendezvous and hold
    task = scenario({"field": field(1.0, north_max_m=1600.0)}, "published")
    flown = anser.run(task)
    (entry,) = flown.summary["aircraft"]
    assert STATUS_MESSAGES[OUTSIDE_WIND] in entry["status"]
    north_m = flown.dataset.north_m.values[:, 0]
    assert np.nanmax(north_m) < 1600.0
    assert north_m[-1] == north_m[-2]
    # the map draws the wind that the aircraft met
    sheet = FlightSheet(flown.dataset, FigureFormat())
    figure, axes = plt.subplots()
    greatest_m_s = _draw_wind(axes, sheet, 1.0, 5.0)
    arrows = next(part for part in axes.collections if isinstance(part, Quiver))
    positions_n = np.stack([arrows.Y, arrows.X, np.full_like(arrows.X, -1100.0)], axis=1)
    wind = anser.plan(task).flight.environment.wind
    expected_n = np.asarray(jax.vmap(lambda p: wind.at(p, 0.0))(jnp.asarray(positions_n)))
    # 100 m of altitude make 0.5 m/s of shear
    np.testing.assert_allclose(np.stack([arrows.V, arrows.U], axis=1), expected_n[:, :2], atol=0.6)
    assert greatest_m_s == pytest.approx(np.max(np.hypot(arrows.U, arrows.V)))
    plt.close(figure)


LEVEL = {"airspeed_m_s": 150.0, "altitude_m": 1000.0, "alpha_deg": 4.0, "pitch_deg": 4.0, "throttle": 0.2}


@pytest.mark.long
def test_open_loop_flights_end_where_the_field_ends() -> None:
    wind = {"field": field(1.0, north_max_m=500.0)}
    flight = anser.simulate("f16", LEVEL, duration_s=6.0, step_s=0.02, wind=wind)
    assert flight.dataset.attrs["end"].startswith("the wind field of the file ended at 3.")
    assert float(flight.dataset.north_m[-1]) <= 500.0


@pytest.mark.long
def test_open_loop_flights_go_on_where_the_wind_is_held() -> None:
    wind = {"field": field(1.0, north_max_m=500.0), "outside": "hold"}
    held = anser.simulate("f16", LEVEL, duration_s=6.0, step_s=0.02, wind=wind)
    assert held.dataset.attrs["end"] == "flown to the end"


@pytest.mark.long
@pytest.mark.parametrize("start", [LEVEL, [LEVEL, {**LEVEL, "altitude_m": 2000.0}]])
def test_a_simulator_stops_at_the_end_of_the_field(start: Any) -> None:
    simulator = anser.Simulator("f16", start, step_s=0.05, wind={"field": field(1.0, north_max_m=500.0)})
    with pytest.raises(ValueError, match=r"leaves the wind field of the file at 3\.\d+ s, 5\d\d m north, .*outside"):
        collections.deque((simulator.step() for _ in range(200)), maxlen=0)
    assert np.all(simulator.state["north_m"] <= 500.0)
    assert 3.0 < simulator.time_s < 4.0


@pytest.mark.long
def test_an_episode_of_an_environment_fails_where_the_field_ends() -> None:
    flown = FlightRange((140.0, 160.0), (1200.0, 2000.0))
    environment = make("VelocityCommand", "velocity", cases=4, flown=flown, wind={"field": field(1.0, half_m=500.0)})
    state = environment.reset(jax.random.key(0))[1]
    step = jax.jit(environment.step_env)
    terminated = []
    while state.time < 100 and not any(terminated):
        _, state, _, is_terminated, _ = step(jax.random.key(1), state, jnp.zeros(3), environment.default_params)
        terminated.append(bool(is_terminated))
    position_n = environment.situation(state).truth.state.position_n
    assert terminated[-1]
    assert 500.0 < np.max(np.abs(np.asarray(position_n)[:2])) < 700.0


def test_flights_of_all_members_share_the_data_of_the_field(tmp_path: Path) -> None:
    path = str(era5_file(tmp_path / "era5.nc", members=2))
    flights = []
    for member in (0, 1):
        flown = scenario({"field": path, "member": member}, "published")
        flights.append(build_flight(flown.replace("earth", {"latitude_deg": 45.0, "longitude_deg": 9.0})))
    stacked = stack_objects(flights)
    assert stacked.shared.environment.wind.columns is not None
    assert stacked.batched.environment.wind.columns is None
    np.testing.assert_array_equal(stacked.batched.environment.wind.member, [0, 1])
    at, single = jnp.array([500.0, -800.0, -1500.0]), [flight.environment.wind for flight in flights]
    winds_n = jax.jit(lambda s: s.map(lambda flight: flight.environment.wind.at(at, 60.0)))(stacked)
    wind_at = jax.jit(lambda wind: wind.at(at, 60.0))
    np.testing.assert_allclose(winds_n, [wind_at(wind) for wind in single], rtol=1e-12)
    assert not np.allclose(winds_n[0], winds_n[1])
