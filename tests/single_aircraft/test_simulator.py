"""The simulator by steps: equal to the flight, saved and restored bit by bit, one and many aircraft, and refusals."""

import functools
import pickle

import numpy as np
import pytest

import anser
from anser.single_aircraft import simulator as simulator_module


@functools.cache
def level():
    return anser.trim("f16", speed_m_s=150.0, altitude_m=1000.0)


@functools.cache
def one():
    return anser.Simulator("f16", level())


@functools.cache
def four():
    return anser.Simulator("f16", [level()] * 4)


def test_steps_by_hand_equal_the_flight():
    signal = anser.doublet(1.0, start_s=0.2, width_s=0.2)
    flight = anser.simulate("f16", level(), {"elevator": signal}, duration_s=1.0).dataset
    simulator = one()
    state = simulator.reset()
    trimmed = state["elevator_deg"]
    for k in range(100):
        assert state["alpha_deg"] == pytest.approx(float(flight.alpha_deg[k]), abs=1e-10)
        assert state["pitch_rate_deg_s"] == pytest.approx(float(flight.pitch_rate_deg_s[k]), abs=1e-10)
        state = simulator.step({"elevator": trimmed + float(signal([k * 0.01])[0])})
    assert simulator.time_s == pytest.approx(1.0)


def test_a_checkpoint_continues_bit_by_bit():
    simulator = one()
    simulator.reset()
    for _ in range(5):
        simulator.step({"elevator": -3.0})
    saved, checkpoint = dict(simulator.state), pickle.loads(pickle.dumps(simulator.save()))
    expected = [dict(simulator.step({"aileron": 2.0})) for _ in range(5)]
    simulator.step({"rudder": 5.0})
    assert dict(simulator.restore(checkpoint)) == saved
    assert simulator.restore(checkpoint)["elevator_command_deg"] == pytest.approx(-3.0, abs=1e-12)
    continued = [dict(simulator.step({"aileron": 2.0})) for _ in range(5)]
    for before, after in zip(expected, continued, strict=True):
        np.testing.assert_array_equal(list(after.values()), list(before.values()))
    fresh = anser.Simulator("f16", level())
    assert dict(fresh.restore(checkpoint)).keys() == expected[0].keys()
    again = fresh.step({"aileron": 2.0})
    np.testing.assert_array_equal(list(again.values()), list(expected[0].values()))


def test_many_aircraft_fly_as_each_alone():
    simulator, alone = four(), one()
    simulator.reset()
    elevators = np.array([-3.0, -2.0, -1.0, 0.0])
    for _ in range(20):
        state = simulator.step({"elevator": elevators})
    assert state["alpha_deg"].shape == (4,)
    for k, elevator in enumerate(elevators):
        alone.reset()
        for _ in range(20):
            single = alone.step({"elevator": elevator})
        assert state["alpha_deg"][k] == pytest.approx(single["alpha_deg"], abs=1e-12)
        assert state["altitude_m"][k] == pytest.approx(single["altitude_m"], abs=1e-9)


def test_blocks_on_several_cores_fly_as_one(monkeypatch):
    monkeypatch.setattr(simulator_module, "_BLOCK_MIN", 2)
    monkeypatch.setattr("anser.compiling.options.usable_cores", lambda: 3)
    divided, together = anser.Simulator("f16", [level()] * 4), four()
    together.reset()
    for elevators in ([-3.0, -2.0, -1.0, 0.0], [0.0, -1.0, -2.0, -3.0]):
        states = [simulator.step({"elevator": np.array(elevators)}) for simulator in (divided, together)]
    for name in states[0]:
        np.testing.assert_allclose(states[0][name], states[1][name], rtol=1e-12, atol=1e-9, err_msg=name)
    assert divided.save()["motion"].shape == together.save()["motion"].shape
    together.restore(divided.save())
    assert together.state["alpha_deg"] == pytest.approx(states[0]["alpha_deg"], abs=1e-12)


def test_an_array_of_inputs_is_in_the_order_of_the_names():
    simulator = one()
    assert simulator.inputs == ("elevator", "aileron", "rudder", "throttle")
    simulator.reset()
    by_name = dict(simulator.step({"elevator": -1.0, "aileron": 1.0, "rudder": 2.0, "throttle": 0.3}))
    simulator.reset()
    assert dict(simulator.step(np.array([-1.0, 1.0, 2.0, 0.3]))) == by_name


def test_a_reused_array_of_inputs_does_not_change_an_earlier_state():
    simulator = four()
    simulator.reset()
    inputs = np.array(simulator.save()["inputs"])
    inputs[:, 0] = -3.0
    state = simulator.step(inputs)
    inputs[:, 0] = 4.0
    assert state["elevator_command_deg"] == pytest.approx(np.full(4, -3.0), abs=1e-12)
    assert simulator.save()["inputs"][:, 0].tolist() == [-3.0] * 4


def test_the_state_has_the_names_of_a_dataset():
    flight = anser.simulate("f16", level(), duration_s=0.1).dataset
    # from airspeed, altitude and air, computed when a dataset is made
    of_instruments = {"airspeed_calibrated_m_s", "airspeed_equivalent_m_s", "pressure_altitude_m", "density_altitude_m"}
    names = set(one().state) | of_instruments
    assert {name for name in flight.data_vars if flight[name].dtype.kind == "f"} <= names
    with pytest.raises(KeyError, match="'alfa_deg' is not a variable"):
        one().state["alfa_deg"]


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: one().step({"elevater": 1.0}), "arrived 'elevater'; expected inputs among elevator"),
        (lambda: one().step({"elevator": np.zeros(4)}), r"controls\['elevator'\]: arrived array"),
        (lambda: one().step({"elevator": float("nan")}), "expected finite numbers"),
        (lambda: one().step({"throttle": 50.0}), "a throttle from 0 to 1"),
        (lambda: one().step(np.array([np.nan, 0.0, 0.0, 0.1])), "expected finite numbers"),
        (lambda: one().step(np.zeros(3)), r"arrived an array of shape \(3,\); expected \(4,\)"),
        (lambda: four().restore(one().save()), "as many of them"),
        (lambda: one().restore(None), "checkpoint: arrived None; expected one that `save` has returned"),
        (lambda: anser.Simulator("f16", [], 0.01), "arrived an empty sequence"),
        (lambda: anser.Simulator("f16", level(), -0.01), "step_s: arrived -0.01"),
        (lambda: anser.Simulator("f16", level(), 0.25), r"arrived 0.25; expected a number from 0.001 to 0.05 s"),
    ],
)
def test_wrong_use_is_refused(act, message):
    with pytest.raises(ValueError, match=message):
        act()
