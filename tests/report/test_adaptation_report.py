"""Estimates of adaptive aircraft in reports: truth, estimate and band in figures and pages, and the fault in words."""

import json

import numpy as np
import pytest

from anser.report import write_report
from anser.report.aircraft_flight import aircraft_flight_figure, write_aircraft_report
from anser.report.derived_variables import add_derived_variables, recorded_table
from anser.report.estimates import recorded_changes, scenario_deviations, true_effectiveness
from anser.report.flight_data import page_sections
from anser.report.flight_figures import available_figures, select_figures
from anser.report.flight_sheet import FigureFormat, FlightSheet
from anser.results.variable_labels import catalogue_attributes
from anser.single_aircraft.flight import flight_dataset
from anser.variables import ADAPTATION_KEYS, CATALOGUE, DERIVED_KEYS

HALF_S = 30.0


@pytest.fixture(scope="module")
def adaptive(flight):
    """The made-up flight with estimates: the elevator of the second aircraft is half effective from 30 s on."""
    thin = flight[0].isel(time=slice(None, None, 40))
    is_half = (thin["time"].values >= HALF_S)[:, None] * np.array([[False, True, False]])
    data = {}
    for variable in CATALOGUE:
        if variable.key in ADAPTATION_KEYS:
            values = np.full(is_half.shape, 0.1 if variable.key.endswith("_sigma") else 1.0)
            values[:, 2] = np.nan  # without an adaptive autopilot
            data[variable.name] = (thin["altitude_m"].dims, values, catalogue_attributes(variable))
    data["pitch_effectiveness_estimate"][1][:, :2] -= 0.4 * is_half[:, :2]
    data["fault"] = (thin["altitude_m"].dims, 4 * is_half, data["fault"][2])
    scenario = recorded_table(thin)
    names = [str(name) for name in thin["aircraft"].values]
    scenario["aircraft"] = [{"name": name, "goal": "sea"} for name in names]
    deviation = {"surface_effectiveness": {"elevator": 0.5}}
    scenario["event"] = [
        {"time_s": HALF_S, "kind": "aircraft-changes", "aircraft": names[1], "deviation": deviation},
        {"time_s": 5.0, "kind": "goal-stops", "goal": "sea"},
    ]
    return thin.assign(data).assign_attrs(scenario=json.dumps(scenario))


def test_the_figure_has_estimate_band_and_truth(flight, adaptive):
    assert "adaptation" not in available_figures(flight[0])
    assert "adaptation" in available_figures(adaptive)
    sheet = FlightSheet(adaptive, FigureFormat(170.0))
    roll, pitch, *others = select_figures(adaptive, ["adaptation"])["adaptation"].draw(sheet).axes
    assert len(others) == 5
    assert len(pitch.collections) == 2  # bands: the third aircraft estimates nothing
    edges = pitch.collections[1].get_datalim(pitch.transData)
    np.testing.assert_allclose([edges.y0, edges.y1], [0.4, 1.2])
    truth, estimate = (line.get_ydata() for line in pitch.lines[2:4])  # of the second aircraft
    before = adaptive["time"].values[: truth.size] < HALF_S
    np.testing.assert_allclose(truth, np.where(before, 1.0, 0.5))
    np.testing.assert_allclose(estimate, np.where(before, 1.0, 0.6))
    fault_lines = [line.get_xdata()[0] for line in pitch.lines if len(line.get_xdata()) == 2]
    assert fault_lines == [HALF_S]
    low, high = pitch.get_ylim()
    assert low < 0.5 < 1.0 < high
    assert "Roll effectiveness" in roll.get_ylabel()


def test_an_estimate_that_begins_after_the_arrivals_leaves_its_panel_empty(adaptive):
    is_last = adaptive["time"] == adaptive["time"][-1]
    late = adaptive.assign(roll_effectiveness_estimate=adaptive["roll_effectiveness_estimate"].where(is_last))
    sheet = FlightSheet(late, FigureFormat(170.0))
    roll, *_ = select_figures(late, ["adaptation"])["adaptation"].draw(sheet).axes
    assert not roll.collections


def test_the_page_has_panels_with_bands_for_recorded_estimates_only(flight, adaptive):
    assert "adaptation" not in {section["key"] for section in page_sections(flight[0])}
    unknown = {f"{axis}_effectiveness_estimate": np.nan * adaptive["fault"] for axis in ("roll", "pitch", "yaw")}
    for dataset, count in ((adaptive, 7), (adaptive.assign(unknown), 4)):
        derived = add_derived_variables(dataset, recorded_table(dataset))
        (section,) = (section for section in page_sections(derived) if section["key"] == "adaptation")
        assert len(section["panels"]) == count
        assert all(name in derived for panel in section["panels"] for name in panel["band"])
    derived = add_derived_variables(adaptive, recorded_table(adaptive))
    np.testing.assert_allclose(derived["cm_alpha_low"].values[:, :2], 0.8)
    assert np.isnan(derived["pitch_effectiveness_truth"].values[:, 2]).all()
    assert float(derived["pitch_effectiveness_truth"].values[-1, 1]) == 0.5


def test_the_page_names_the_fault(flight, adaptive, tmp_path):
    summary = json.loads(json.dumps(flight[1]))
    summary["aircraft"][1]["fault"] = {
        "name": "elevator",
        "time_s": 30.0,
        "size": 0.4,
        "unit": "of the effectiveness lost",
    }
    write_report(adaptive, summary, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "bert: fault: elevator, 40 % of the effectiveness lost, found at 30.0 s." in page
    assert '"band":["pitch_effectiveness_low","pitch_effectiveness_high"]' in page.replace(" ", "")


def test_the_truth_is_that_of_deviations_and_changes():
    scenario = {
        "aircraft": [{"name": "anna", "deviation": {"coefficients": {"Clda": 1.2}, "surface_effectiveness": None}}],
        "event": [
            {"time_s": 4.0, "aircraft": "anna", "deviation": {"surface_effectiveness": {"aileron": 0.5}}},
            {"time_s": 5.0, "aircraft": "bert", "deviation": {"surface_effectiveness": {"aileron": 0.1}}},
            {"time_s": 6.0, "aircraft": "anna", "deviation": {"cg_shift": 0.05}},
        ],
    }
    deviations = scenario_deviations(scenario, "anna")
    time = np.array([0.0, 3.9, 4.0, 9.0])
    np.testing.assert_allclose(true_effectiveness(time, "roll_effectiveness", deviations), [1.2, 1.2, 0.6, 0.6])
    # From the shift at 6 s on, the side force of the rudder has another lever.
    np.testing.assert_allclose(true_effectiveness(time, "yaw_effectiveness", deviations), [1.0, 1.0, 1.0, np.nan])
    assert scenario_deviations({}, "anna") is None


@pytest.mark.parametrize(
    ("deviation", "unknown"),
    [
        ({"mass": 1.2, "thrust": 0.9, "second_moment_x": 1.0, "cg_shift": 0.0}, ()),
        ({"second_moment_x": 2.0}, ("pitch", "yaw")),  # flown with test inputs: 0.56, 0.51
        ({"second_moment_y": 2.0}, ("roll", "yaw")),
        ({"second_moment_z": 2.0}, ("roll", "pitch")),
        ({"cg_shift": 0.05}, ("pitch", "yaw")),  # flown with test inputs: 0.94, 0.96
    ],
)
def test_the_truth_is_unknown_where_inertia_or_centre_of_gravity_deviate(deviation, unknown):
    time = np.array([0.0, 1.0])
    for axis in ("roll", "pitch", "yaw"):
        truth = true_effectiveness(time, f"{axis}_effectiveness", [(1.0, deviation)])
        np.testing.assert_allclose(truth, [1.0, np.nan if axis in unknown else 1.0])


def test_an_unknown_truth_is_not_drawn():
    change = json.dumps([{"time_s": 3.0, "second_moment_x": 2.0}])
    figure = aircraft_flight_figure(aircraft_flight(change))
    truth = figure.axes[10].lines[0]
    assert np.isfinite(truth.get_ydata()).sum() == np.sum(truth.get_xdata() < 3.0)


def aircraft_flight(change):
    time = np.arange(0.0, 10.0, 0.1)
    history = {
        variable.key: np.full(time.size, 1.0).astype(variable.dtype)
        for variable in CATALOGUE
        if variable.key not in DERIVED_KEYS
    }
    history |= {"fault": np.where(time < 6.0, 0, 4), "fault_size": np.where(time < 6.0, 0.0, 0.5)}
    attributes = {"aircraft": "f16", "controller": "adaptive", "controls": "", "command": "", "change": change}
    return flight_dataset(time, history, ("elevator", "aileron", "rudder"), attributes)


def test_the_figure_of_one_aircraft_has_rows_of_estimates(tmp_path):
    change = json.dumps([{"time_s": 3.0, "surface_effectiveness": {"elevator": 0.5}}])
    dataset = aircraft_flight(change)
    assert recorded_changes(dataset)[0][0] == 3.0
    figure = aircraft_flight_figure(dataset)
    assert len(figure.axes) == 15
    pitch = figure.axes[10]
    assert "Pitch effectiveness" in pitch.get_ylabel()
    np.testing.assert_allclose(pitch.lines[0].get_ydata()[[0, -1]], [1.0, 0.5])
    assert pitch.lines[-1].get_xdata()[0] == pytest.approx(6.0)
    write_aircraft_report(dataset.assign_attrs(engine_lag="no"), tmp_path / "report.html", figure)
    page = (tmp_path / "report.html").read_text()
    assert "elevator, 50 % of the effectiveness lost, found at 6.0 s" in page
    assert "<dt>engine lag</dt><dd>no</dd>" in page
    assert "<dt>actuator lag</dt>" not in page
    keys = [name for name in dataset.data_vars if name.removesuffix("_deg") in ADAPTATION_KEYS]
    assert len(aircraft_flight_figure(dataset.drop_vars(keys)).axes) == 9
