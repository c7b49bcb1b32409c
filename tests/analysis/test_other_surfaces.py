"""Trims, linear models, step tests, margins and surveys of airframes with other control surfaces."""

import numpy as np
import pytest

from anser.analysis import fly_steps, linearize, margins_at, step_test, survey_envelope, trim
from anser.analysis.step_tests import step_document
from anser.cli.step_tests import _surfaces_used
from anser.report import draw_bode, draw_envelope
from anser.report.aircraft_figures import draw_step
from support.other_surfaces import ELEVONS, SPLIT, elevon_aircraft, split_aileron_aircraft

pytestmark = pytest.mark.long

SPEED, ALTITUDE = 55.0, 400.0


@pytest.fixture(scope="module")
def elevons():
    return elevon_aircraft()


@pytest.fixture(scope="module")
def split():
    return split_aileron_aircraft()


def test_a_trim_lists_each_surface_by_label(split):
    result = trim(split, SPEED, ALTITUDE, turn_rate_deg_s=5.0)
    assert result.diagnosis is None
    values = {name: value for name, value, _ in result.quantities}
    # both ailerons have the same deflection; the mixing adds half of each
    assert values["left aileron"] == pytest.approx(values["right aileron"], abs=1e-6)
    assert abs(values["left aileron"]) > 0.1
    assert "left aileron" in repr(result)


@pytest.mark.parametrize("loop", ["open", "rates"])
def test_a_linear_model_has_units_for_every_surface(elevons, loop):
    result = linearize(elevons, speed_m_s=SPEED, altitude_m=ALTITUDE, loop=loop)
    document = result.document()
    units = {element["name"]: element["unit"] for group in ("states", "inputs") for element in document[group]}
    assert {units[name] for name in ELEVONS} == {"rad"}
    assert result.dataset.sizes["state"] == len(result.model.states)


def test_a_linear_model_with_second_order_actuators_has_units(split):
    model = linearize(split, speed_m_s=SPEED, altitude_m=ALTITUDE, actuators=True)
    dataset = model.dataset
    units = dict(zip(dataset["state"].values.tolist(), dataset["state_unit"].values.tolist(), strict=True))
    inputs = dict(zip(dataset["input"].values.tolist(), dataset["input_unit"].values.tolist(), strict=True))
    assert {units[f"{name}_velocity"] for name in SPLIT} == {"rad s-1"}
    assert {units[name] for name in SPLIT} == {inputs[f"{name}_command"] for name in SPLIT} == {"rad"}


def test_step_tests_record_and_draw_every_surface(split, tmp_path):
    tests = [step_test("rates", {"p": 5.0}, 1.0), step_test("rates", {"q": 2.0}, 1.0)]
    flights = fly_steps(tests, aircraft=split, speed_m_s=SPEED, altitude_m=ALTITUDE)
    rolled = flights[0].dataset
    assert rolled["left_aileron_deg"].attrs["long_name"] == "Left aileron"
    np.testing.assert_allclose(rolled["left_aileron_deg"], rolled["right_aileron_deg"], atol=1e-6)
    assert np.ptp(rolled["left_aileron_deg"].values) > 0.5
    document = step_document(flights)
    assert list(document["steps"][0]["surface_use_percent"]) == list(SPLIT)
    assert document["aircraft"] == "custom"
    used = [step["surface_use_percent"] for step in document["steps"]]
    assert used[0]["left_aileron"] > used[1]["left_aileron"]
    assert used[1]["elevator"] > used[0]["elevator"]
    draw_step(rolled, [tmp_path / "p.svg"])
    text = (tmp_path / "p.svg").read_text()
    assert "Right aileron" in text
    assert "custom from level trim at 55 m/s" in text
    heading = _surfaces_used(flights[0])
    assert " ".join(heading.split()) == "elevator, left aileron, right aileron, rudder used, %"
    assert max(map(len, heading.splitlines())) <= 20


def test_margins_exist_at_every_surface(split, tmp_path):
    margins = margins_at(split, speed_m_s=SPEED, altitude_m=ALTITUDE)
    assert margins["breakpoint"].values.tolist()[:4] == list(SPLIT)
    assert np.isfinite(margins.sel(breakpoint="right_aileron")["disk_margin"])
    draw_bode(margins, [tmp_path / "bode.svg"])
    assert "right aileron" in (tmp_path / "bode.svg").read_text()


def test_a_survey_has_every_surface(elevons, tmp_path):
    survey = survey_envelope(elevons, altitudes_m=(400.0, 1000.0), machs=(0.16, 0.18), duration_s=1.0)
    data = survey.dataset
    assert data["surface"].values.tolist() == list(ELEVONS)
    assert data["surface_deg"].dims[-1] == "surface"
    level = data.isel(condition=0, altitude=0, mach=0)
    assert bool(level["trimmable"])
    # in straight level flight both elevons have the same deflection
    left_elevon, right_elevon = (float(level["surface_deg"].sel(surface=name)) for name in ELEVONS)
    assert left_elevon == pytest.approx(right_elevon, abs=1e-6)
    assert data["surface_share"].sizes["surface"] == 2
    assert all(path.is_file() for path in draw_envelope(data, tmp_path))
