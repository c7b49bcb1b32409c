"""User-defined parts through `anser.run`: every planner, by object, by aircraft, by name in a file; and the refusals."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft import Controls
from anser.config.errors import ScenarioError
from anser.missions.plans import plan_for_flight
from anser.numerics.randomness import flight_randomness
from anser.parts import AbstractController, AbstractPlanner, AbstractReference, AbstractSensors
from anser.scenario import validate
from anser.scenario.user_parts import UserParts, attach_parts
from anser.sensing import IdealSensors
from support.proportional_control import Proportional
from support.straight_lines import StraightLines

SINGLE, THREE = "scenarios/single-aircraft.toml", "scenarios/three-aircraft.toml"


class Biased(AbstractSensors):
    range_m: float = 2.0

    def read(self, state, truth, instant):
        reading, state = IdealSensors().read(state, truth, instant)
        return eqx.tree_at(lambda r: r.sight.range, reading, reading.sight.range + self.range_m), state


class Returns(AbstractController):
    result: object = eqx.field(static=True)

    def init(self, state, attitude):
        return jnp.zeros(2)

    def control(self, state, belief, command, step):
        return self.result(belief.state.surfaces, state)


def lines(arrival_s=60.0):
    return StraightLines(jnp.asarray(arrival_s), jnp.zeros(3))


def shortened(count):
    """The first aircraft of the three, to the end of the straight lines."""
    tables = tomllib.loads(Path(THREE).read_text(encoding="utf-8"))
    first = validate({**tables, **{key: tables[key][:count] for key in ("aircraft", "goal")}})
    return first.replace("timing.duration_s", 63.0)


def check_user_parts(flight, folder):
    """The names of the parts, the saved report, and the range of the biased sensors."""
    assert "StraightLines" in flight.dataset.attrs["user_parts"]
    assert "Biased" in flight.dataset.attrs["user_parts"]
    assert (flight.save(folder) / "report.html").stat().st_size > 10_000
    sight = np.asarray(flight.dataset.sight_range_m)[0, 0] - np.asarray(flight.dataset.clearance_m)[0, 0]
    assert sight == pytest.approx(2.0, abs=1e-6)


def test_plans_made_with_other_parts_than_the_flight_are_refused():
    parts = {"planner": lines(), "sensors": {"aircraft-1": Biased()}}
    planned = SimpleNamespace(scenario=attach_parts(shortened(1), UserParts(**parts)))
    for kinds, changes in (
        ("planner", {"planner": lines(61.0)}),
        ("planner", {"planner": None}),
        ("sensors", {"sensors": None}),
        ("sensors, planner", {"sensors": {"aircraft-1": Biased(3.0)}, "planner": None}),
    ):
        with pytest.raises(
            ValueError, match=rf"planned: arrived a plan made with other user-defined parts \({kinds}\)"
        ):
            anser.run(shortened(1), planned=planned, **(parts | changes))
    with pytest.raises(ValueError, match=r"other user-defined parts \(planner\)"):
        anser.run(shortened(1), planned=SimpleNamespace(scenario=shortened(1)), planner=lines())


def test_own_planner_controller_and_sensor_give_the_ordinary_results(tmp_path):
    flight = anser.run(shortened(1), planner=lines(), controller=Proportional(), sensors={"aircraft-1": Biased()})
    # proportional control holds the direction and the airspeed of the line, and a departure from the line remains
    assert flight.summary["aircraft"][0]["arrival_s"] == pytest.approx(60.0, abs=0.2)
    assert flight.summary["aircraft"][0]["miss_m"] < 10.0
    assert "Proportional" in flight.dataset.attrs["user_parts"]
    check_user_parts(flight, tmp_path / "run")


def test_a_plan_that_passes_its_goal_is_not_flyable():
    """The rendezvous is 300 m above the goal; these straight lines end 50 m above it."""
    planned = anser.plan(shortened(1), planner=StraightLines(jnp.asarray(60.0), jnp.asarray([0.0, 0.0, 250.0])))
    problem = planned.record().summary["problems"][-1]
    assert 'passes its goal "boat-north" at 50 m, at 60.0 s; nearer than 150 m it breaks off in flight' in problem


@pytest.mark.parametrize("count", [1, 3])
def test_the_recorded_plan_of_an_own_planner_has_the_winds_airspeeds(count):
    windy = shortened(count).replace("wind", {"speed_m_s": 20.0, "from_deg": 0.0})
    record = anser.plan(windy, planner=lines()).record()
    assert not record.summary["problems"]
    history = record.samples.history
    speeds = np.sqrt(
        history["velocity_down"] ** 2 + history["velocity_east"] ** 2 + (history["velocity_north"] + 20.0) ** 2
    )
    np.testing.assert_allclose(history["airspeed"], speeds, rtol=1e-9)


@pytest.mark.long
def test_a_plan_is_flown_with_further_parts(monkeypatch):
    randomness = flight_randomness(7, 3)
    planned = anser.plan(shortened(1), planner=lines(), randomness=randomness)
    further = attach_parts(shortened(1), UserParts(planner=lines(), controller=Proportional()))
    assert plan_for_flight(planned, further).flight.randomness is randomness
    monkeypatch.setattr("anser.missions.runs.plan", None)  # whoever plans fails
    flight = anser.run(shortened(1), planned=planned, planner=lines(), controller=Proportional())
    assert flight.summary["aircraft"][0]["miss_m"] < 10.0
    assert "Proportional" in flight.dataset.attrs["user_parts"]


# With other sensors for one of several aircraft these form two groups: twice the program.
@pytest.mark.long
@pytest.mark.parametrize("count", [1, 3])
def test_an_own_planner_and_sensor_give_the_ordinary_results(count, tmp_path):
    flight = anser.run(shortened(count), planner=lines(), sensors={"aircraft-1": Biased()})
    assert flight.summary["aircraft"][0]["arrival_s"] == pytest.approx(60.0, abs=0.1)
    check_user_parts(flight, tmp_path / "run")


@pytest.mark.long
@pytest.mark.parametrize("planner", ["published", "certified", "decentralised"])
def test_an_own_controller_flies_with_every_planner(planner):
    """The inversion itself as a user-defined controller: the flight is the same."""
    scenario = anser.load(THREE).replace("fleet.planner", planner)
    ordinary = anser.run(scenario)
    parts = dict(zip([aircraft.name for aircraft in scenario.aircraft], _controllers(scenario), strict=True))
    flight = anser.run(scenario, controller=parts)
    for name in ("north_m", "east_m", "altitude_m", "alpha_deg"):
        np.testing.assert_allclose(flight.dataset[name], ordinary.dataset[name], rtol=0, atol=1e-6)


def _controllers(scenario):
    from anser.scenario.build import build_flight

    flight = build_flight(scenario)
    return [flight.aircraft(k)[0].controller for k in range(flight.count)]


@pytest.mark.long
def test_user_parts_fly_in_a_sweep_and_in_a_campaign(tmp_path, monkeypatch):
    module = "import jax.numpy as jnp\nfrom support.straight_lines import StraightLines\n"
    (tmp_path / "my_lines.py").write_text(module + "lines = StraightLines(jnp.asarray(60.0), jnp.zeros(3))\n")
    monkeypatch.syspath_prepend(tmp_path)
    swept = anser.sweep(THREE, {"wind.speed_m_s": [0.0, 5.0]}, planner=lines())
    named = anser.run(THREE, planner="my_lines:lines")
    arrival = named.summary["aircraft"][0]["arrival_s"]
    assert float(swept["arrival_s"].isel(aircraft=0).values.ravel()[0]) == pytest.approx(arrival, abs=1e-6)
    study = tmp_path / "study.toml"
    study.write_text(
        f'format = 1\nname = "lines"\nscenario = "{Path(THREE).resolve()}"\n\n[sampling]\nmethod = "monte-carlo"\nflights = 2\n\n'
        '[[vary]]\npath = "wind.speed_m_s"\ndistribution = "uniform"\nlow = 0.0\nhigh = 5.0\n',
        encoding="utf-8",
    )
    campaign = anser.campaign(study, tmp_path / "out", processes=1, planner="my_lines:lines")
    assert campaign.dataset.sizes["flight"] == 2
    assert np.isfinite(campaign.dataset["arrival_s"].isel(aircraft=0)).all()


def test_a_scenario_file_names_its_parts(tmp_path):
    text = Path(SINGLE).read_text(encoding="utf-8")
    path = tmp_path / "own.toml"
    path.write_text(text + '\n[parts]\nplanner = "nowhere:lines"\n', encoding="utf-8")
    scenario = anser.load(path)  # reading imports nothing
    assert scenario.hash != anser.load(SINGLE).hash
    with pytest.raises(ScenarioError, match=r'parts.planner: arrived "nowhere:lines" \(No module named'):
        anser.run(scenario)
    path.write_text(text + '\n[parts]\nplaner = "nowhere:lines"\n', encoding="utf-8")
    with pytest.raises(ScenarioError, match="planner"):
        anser.load(path)


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (lambda u, s: u, r"Returns.control: arrived an array of shape \(3,\); expected \(controls, signals, state\)"),
        (lambda u, s: (Controls(u[:2], u[0]), None, s), r"surfaces of shape \(2,\)"),
        (lambda u, s: (Controls(u, u[0]), None, jnp.zeros(3)), "the state in the structure of init"),
        (lambda u, s: (Controls(u, u[0]), {"gain": u[0]}, s), "arrived the signals dict; expected None, or an object"),
        (lambda u, s: (Controls(u + s, u[0]), None, s), "expected a method that JAX can trace"),
    ],
)
def test_wrong_returns_are_refused_by_part_and_method(result, message):
    with pytest.raises(ScenarioError, match=message):
        anser.run(THREE, controller=Returns(result))


@pytest.mark.parametrize(
    ("modify", "message"),
    [
        (lambda r: r.state, "Reads.read: arrived AircraftState; expected an anser.parts.Reading first"),
        (lambda r: eqx.tree_at(lambda r: r.specific_force_b, r, jnp.zeros(2)), "specific_force_b = an array of shape"),
        (lambda r: eqx.tree_at(lambda r: r.state.rates_b, r, jnp.zeros(2)), "a reading with a state of other arrays"),
    ],
)
def test_wrong_readings_are_refused(modify, message):
    class Reads(AbstractSensors):
        def read(self, state, truth, instant):
            reading, state = IdealSensors().read(state, truth, instant)
            return modify(reading), state

    with pytest.raises(ScenarioError, match=message):
        anser.run(SINGLE, sensors=Reads())


def test_wrong_parts_are_refused():
    class Unstacked(AbstractPlanner):
        def first_plan(self, time, reports, performance):
            return 1.0

        def plans(self, planner_state):
            return planner_state

    for part, message in (
        ({"planner": Unstacked()}, r"Unstacked.plans: arrived float; expected an AircraftPlan"),
        (
            {"planner": lines(jnp.nan)},
            r"StraightLines.plans: arrived arrival times nan, nan, nan s; expected times after",
        ),
        ({"planner": lines(0.0)}, "arrival times 0, 0, 0 s"),
        ({"controller": Returns}, "arrived the class Returns"),
        ({"controller": {"nobody": Returns(None)}}, 'arrived "nobody"; expected the name of an aircraft'),
        ({"sensors": lines()}, "a subclass of anser.parts.AbstractSensors"),
    ):
        with pytest.raises(ScenarioError, match=message):
            anser.run(THREE, **part)


def test_a_field_that_hides_a_method_is_refused():
    with pytest.raises(TypeError, match="the field 'velocity_n' has the name of a method of AbstractReference"):

        class Line(AbstractReference):
            velocity_n: jnp.ndarray

            def at(self, time):
                return None
