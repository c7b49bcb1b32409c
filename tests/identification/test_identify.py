"""Identification from a flight: against the linear model and the airframe, validation, the estimated file in flight."""

import dataclasses
import functools
import json
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.aircraft.f16 import F16_COEFFICIENTS
from anser.identification.aircraft_file import slug
from anser.identification.coefficients import airframe_derivatives
from anser.identification.identify import _resolve
from anser.identification.kinematics import with_specific_force
from anser.identification.models import LATERAL
from anser.identification.records import flight_record
from anser.results.netcdf import read_netcdf
from support.manoeuvres import NOISE, STEP_S, clean_record, f16, flight, noisy_record

CONDITIONS = [
    *((120.0, 1000.0), (150.0, 1000.0), (180.0, 1000.0), (220.0, 1000.0), (130.0, 3000.0), (160.0, 3000.0)),
    *((200.0, 3000.0), (240.0, 3000.0), (150.0, 6000.0), (180.0, 6000.0), (220.0, 6000.0), (250.0, 8000.0)),
]
_STATES = {"alpha": "alpha", "beta": "beta", "p": "P", "q": "Q", "r": "R"}
_EQUATIONS = {"Z": "alpha", "M": "Q", "Y": "beta", "L": "P", "N": "R"}


@functools.cache
def linear_parameters(speed_m_s, altitude_m):
    """Elements of the linear model by the names of the estimates."""
    model = f16().linearize(speed_m_s=speed_m_s, altitude_m=altitude_m).model
    A, B, states, inputs = np.asarray(model.A), np.asarray(model.B), list(model.states), list(model.inputs)
    elements = {}
    for prefix, row in _EQUATIONS.items():
        elements |= {f"{prefix}_{key}": A[states.index(row), states.index(state)] for key, state in _STATES.items()}
        elements |= {
            f"{prefix}_{key}": B[states.index(row), inputs.index(key)] for key in ("elevator", "aileron", "rudder")
        }
    return elements


def scores(model, manoeuvre, method, truth, **condition):
    """Errors of the estimates over four seeds, in standard errors."""
    errors = []
    for seed in range(4):
        result = anser.identify(noisy_record(manoeuvre, seed, **condition), model, aircraft=f16(), method=method)
        rows = [row for row in result.rows() if row["name"] in truth]  # without constants and starts
        errors += [(row["estimate"] - truth[row["name"]]) / row["standard_error"] for row in rows]
    return np.abs(errors)


@pytest.mark.parametrize(
    ("model", "manoeuvre", "method", "speed_m_s", "altitude_m"),
    [
        ("short-period", "doublet", "frequency", 150.0, 1000.0),
        ("short-period", "doublet", "frequency", 200.0, 5000.0),
        ("short-period", "doublet", "equation-error", 150.0, 1000.0),
        ("lateral", "lateral", "frequency", 150.0, 1000.0),
        ("lateral", "lateral", "equation-error", 200.0, 5000.0),
    ],
)
def test_linear_models_are_within_two_standard_errors_of_linearize(model, manoeuvre, method, speed_m_s, altitude_m):
    truth = linear_parameters(speed_m_s, altitude_m)
    errors = scores(model, manoeuvre, method, truth, speed_m_s=speed_m_s, altitude_m=altitude_m)
    # 95 % of normal errors are inside; with 24 or 60 correlated numbers down to 80 %, and none is far off. A constant
    # slope stands for the tables' curvature over +-2 deg, which moves an estimate by up to a standard error.
    assert np.mean(errors < 2.0) >= 0.8, errors
    assert errors.max() < 4.5


@pytest.mark.long
@pytest.mark.parametrize(("model", "manoeuvre"), [("short-period", "doublet"), ("lateral", "lateral")])
def test_output_error_is_within_two_standard_errors_of_its_fit_without_noise(model, manoeuvre):
    """The intervals of output error are so narrow that the curvature of the tables shows against `linearize`."""
    clean = anser.identify(clean_record(manoeuvre), model, aircraft=f16(), method="output-error")
    truth = {name: value for name, value in clean.parameters.items() if name[0] in "ZMYLN" and "_" in name}
    errors = scores(model, manoeuvre, "output-error", truth)
    assert np.mean(errors < 2.0) >= 0.8, errors
    assert errors.max() < 4.5


def test_derivatives_without_noise_are_those_of_the_airframe():
    result = anser.identify(clean_record("multisine"), aircraft=f16())
    # [SL] appendix A: CY = -0.02 beta + 0.021 da / 20 + 0.086 dr / 30, per deg
    assert result["CY_beta"] == pytest.approx(np.degrees(-0.02), rel=0.005)
    assert result["CY_aileron"] == pytest.approx(np.degrees(0.021 / 20.0), rel=0.02)
    assert result["CY_rudder"] == pytest.approx(np.degrees(0.086 / 30.0), rel=0.005)
    # CZ = ... - 0.19 de / 25 per deg, turned into lift by alpha of 2.8 deg
    assert result["CL_elevator"] == pytest.approx(np.degrees(0.19 / 25.0), rel=0.02)
    assert min(row["r_squared"] for row in result.fit_rows()) > 0.997


@functools.cache
def estimated():
    return anser.identify(noisy_record("multisine", 1), aircraft=f16(), validate=noisy_record("doublet", 2))


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    return estimated().save(tmp_path_factory.mktemp("identification") / "estimate")


def test_another_manoeuvre_is_predicted():
    rows = {row["response"]: row for row in estimated().fit_rows()}
    # noise of alpha of 0.05 deg alone leaves 0.995 of CL; drag has the greatest share of noise
    assert rows["CL"]["validation_r_squared"] > 0.99
    assert rows["Cm"]["validation_r_squared"] > 0.99
    assert rows["CD"]["validation_r_squared"] > 0.95
    assert rows["CY"]["validation_r_squared"] is None  # the doublet has no lateral motion
    assert rows["CL"]["theil_inequality"] < 0.1
    assert not any(note.startswith("Caution") for note in estimated().notes)
    other = anser.identify(noisy_record("3211"), "short-period", aircraft=f16(), validate=noisy_record("doublet"))
    assert min(row["validation_r_squared"] for row in other.fit_rows()) > 0.99


@pytest.mark.long
def test_the_estimated_aircraft_flies_like_the_true_one(saved):
    model = anser.aircraft(saved / "aircraft.toml")
    condition = {"speed_m_s": 150.0, "altitude_m": 1000.0}
    trim = model.trim(**condition)
    true = f16().trim(**condition)
    responses = []
    for vehicle, start in ((model, trim), (f16(), true)):
        controls = {"elevator": anser.three_two_one_one(0.7, width_s=0.5), "rudder": anser.doublet(2.0)}
        flown = anser.simulate(vehicle, start, controls, duration_s=6.0).dataset
        assert int(flown.outside_tables.sum()) == 0
        responses.append(flown)
    # Constant slopes in place of tables, with errors of estimation of a per cent; the roll moment of sideslip changes with
    # the angle of attack by a tenth per degree, which moves by a degree here.
    tolerances = {"alpha_deg": 0.04, "pitch_rate_deg_s": 0.04, "load_factor": 0.04, "beta_deg": 0.15}
    for name, tolerance in (tolerances | {"roll_rate_deg_s": 0.15}).items():
        difference = responses[0][name] - responses[1][name]
        assert float(difference.std()) < tolerance * float(responses[1][name].std()), name
    assert float(responses[0].alpha_deg[0]) == pytest.approx(float(responses[1].alpha_deg[0]), abs=0.05)


def test_what_the_record_does_not_tell_is_taken_from_the_aircraft_and_said():
    result = anser.identify(noisy_record("doublet"), aircraft=f16())
    assert {row["name"][:2] for row in result.rows()} == {"CL", "CD", "Cm"}
    assert any(note.startswith("Cn is not estimated") for note in result.notes)
    text = result.aircraft_file("my-estimate")
    assert 'name = "my-estimate"' in text
    assumed = next(line for line in text.splitlines() if line.startswith("assumed"))
    assert "Cn_beta" in assumed
    assert "Cm_alpha" not in assumed
    # the engine of the F-16 is not described by a file
    assert "thrust by a straight line from idle to full power" in assumed


@pytest.mark.long
def test_an_aircraft_by_a_file_keeps_its_engine_and_actuators(tmp_path):
    model = anser.aircraft("aerosonde")
    trim = model.trim(speed_m_s=30.0, altitude_m=300.0)

    def sines(channel):
        return anser.multisine(1.5, (0.2, 3.0), 10.0, channel=channel, channels=3)

    controls = {name: sines(k) for k, name in enumerate(("elevator", "aileron", "rudder"))}
    flown = anser.simulate(model, trim, controls, duration_s=12.0, record_period_s=0.02)
    result = anser.identify(flown, frequency_max_hz=3.0)
    # the file's own derivatives, per rad; the drag polar and the stall bend the rest
    for name, value in {"CL_alpha": 5.61, "Cm_alpha": -2.74, "Cm_q": -38.21, "Cl_p": -0.51, "CY_beta": -0.98}.items():
        assert result[name] == pytest.approx(value, rel=0.03), name
    (tmp_path / "estimated.toml").write_text(result.aircraft_file())
    assert "straight line" not in result.aircraft_file()
    again = anser.aircraft(tmp_path / "estimated.toml")
    assert type(again.airframe.engine) is type(model.airframe.engine)
    assert again.trim(speed_m_s=30.0, altitude_m=300.0).diagnosis is None


def test_dataset_and_document_hold_the_same_numbers(saved):
    names = {path.name for path in saved.iterdir()}
    pictures = {f"{n}.{s}" for n in ("responses", "validation", "residuals", "correlation") for s in ("svg", "png")}
    assert names == {"identification.nc", "identification.json", "report.html", "aircraft.toml"} | pictures
    result = estimated()
    dataset = read_netcdf(saved / "identification.nc")
    document = json.loads((saved / "identification.json").read_text())
    for row in document["parameters"]:
        chosen = dataset.sel(parameter=row["name"])
        assert float(chosen["estimate"]) == row["estimate"] == result[row["name"]]
        assert row["low"] < row["estimate"] < row["high"]
        assert float(chosen["correlation"].sel(parameter_2=row["name"])) == pytest.approx(1.0)
    page = (saved / "report.html").read_text()
    assert "Cm_elevator" in page
    assert page.count("<svg") == 4
    with pytest.raises(FileExistsError):
        result.save(saved)


def refused(recording, model="derivatives", **options):
    with pytest.raises(ValueError, match=r"arrived|excitation|collinear") as raised:
        anser.identify(recording, model, **options)
    return str(raised.value)


def test_each_defect_has_a_message():
    record = noisy_record("multisine")
    air: dict[str, Any] = {"aircraft": f16()}
    steady = flight_record(flight("doublet")).window(0.0, 1.0)
    assert "elevator, aileron, rudder that do not move" in refused(steady, **air)
    lateral = {key: values for key, values in record.channels.items() if key not in ("aileron", "rudder")}
    assert "no surface that moved" in refused(dataclasses.replace(record, channels=lateral), "lateral", **air)
    assert "beta, p, r that vary no more than" in refused(noisy_record("doublet"), "lateral")
    assert "without pitch_rate_deg_s" in refused(
        dataclasses.replace(record, channels={k: v for k, v in record.channels.items() if k != "pitch_rate"}), **air
    )
    together = record.with_channels(rudder=0.5 * record["aileron"])
    assert "aileron are collinear" in refused(together, "lateral", align=False, **air).replace(
        "aileron, rudder", "aileron"
    )
    assert "the recording names none" in refused(dataclasses.replace(record, attributes={}))
    assert "model: arrived 'phugoid'" in refused(record, "phugoid")
    assert "method: arrived 'magic'" in refused(record, method="magic")
    with pytest.raises(ValueError, match="aircraft_file: arrived the model lateral"):
        anser.identify(record, "lateral").aircraft_file()
    with pytest.raises(KeyError, match="'Cm_flap' is not estimated"):
        estimated()["Cm_flap"]


@pytest.mark.long
def test_the_rates_of_the_air_are_separated_from_the_angles_in_turbulence():
    """The pitch rate of a gust, unmeasured, acts like that of the aircraft: without it, CL_alpha is 7 % off."""
    model = anser.aircraft("f16", "global")
    trim = model.trim(speed_m_s=150.0, altitude_m=1000.0)
    controls = {
        name: anser.multisine(amplitude, (0.1, 1.5), 20.0, channel=k, channels=3)
        for k, (name, amplitude) in enumerate({"elevator": 0.8, "aileron": 1.5, "rudder": 1.5}.items())
    }
    options = {"duration_s": 22.0, "record_period_s": 0.02, "turbulence": "light"}
    flown = [flight_record(anser.simulate(model, trim, controls, seed=seed, **options)) for seed in range(4)]
    records = [record.with_noise({"alpha_deg": 0.05}, seed) for seed, record in enumerate(flown)]
    own = airframe_derivatives(model.airframe, records[0])
    results = [anser.identify(record, aircraft=model) for record in records]
    for name, tolerance in {"CL_alpha": 0.01, "Cm_alpha": 0.02, "CL_q": 0.06, "Cm_elevator": 0.02}.items():
        assert np.mean([result[name] for result in results]) == pytest.approx(own[name], rel=tolerance), name
    # the rate of the air acts as that of the aircraft, turned the other way; the small rest is the sample period and the
    # finite extent
    assert np.mean([result["CL_q_gust"] for result in results]) == pytest.approx(-own["CL_q"], rel=0.15)
    assert any(note.startswith("Turbulence") for note in results[0].notes)


_EXPERIMENTS = {
    "derivatives": {
        name: anser.multisine(amplitude, (0.1, 1.5), 20.0, channel=k, channels=3)
        for k, (name, amplitude) in enumerate({"elevator": 0.3, "aileron": 0.9, "rudder": 0.9}.items())
    },
    "short-period": {"elevator": anser.doublet(0.3)},
    "lateral": {"aileron": anser.doublet(0.6), "rudder": anser.doublet(1.2, start_s=4.0)},
}
"""Inputs in deg at 150 m/s. The elevator moves alpha by about a degree: the slope of the textbook's tables changes
between their points, and the misfit of a line over a greater range would pass for noise in the standard errors."""


def errors_at(model, variant, condition, seeds, turbulence=None):
    """Errors and standard errors by parameter over seeds of the sensors, and of the air, at a flight condition.

    Truth of the smooth aircraft: its own derivatives; of the tables: the fit to the same flight without noise.
    """
    aircraft, (speed_m_s, altitude_m) = anser.aircraft("f16", variant), condition
    controls = {name: (150.0 / speed_m_s) * signal for name, signal in _EXPERIMENTS[model].items()}
    options = {"duration_s": 22.0 if model == "derivatives" else 12.0, "record_period_s": STEP_S}
    trim, errors, truth = aircraft.trim(speed_m_s=speed_m_s, altitude_m=altitude_m), {}, {}
    for seed in range(seeds):
        if seed == 0 or turbulence:
            flown = anser.simulate(aircraft, trim, controls, turbulence=turbulence, seed=seed, **options)
            clean = with_specific_force(flight_record(flown))
            if model == "derivatives" and variant == "global":
                truth = airframe_derivatives(aircraft.airframe, clean)
            else:
                truth = anser.identify(clean, model, aircraft=aircraft, align=False).parameters
        result = anser.identify(clean.with_noise(NOISE, seed), model, aircraft=aircraft, align=False)
        for row in result.rows():
            # powers of alpha and constants of the smooth model depend on each other over the range of alpha
            if row["name"] in truth and not row["name"].endswith(("0", "gust")) and "CD_alpha" not in row["name"]:
                error = row["estimate"] - truth[row["name"]], row["standard_error"]
                errors.setdefault(row["name"], []).append(error)
    return [np.array(series) for series in errors.values()]


def share_and_ratio(errors):
    """Share of the errors within two standard errors, and median of standard error over scatter."""
    inside = np.concatenate([np.abs(series[:, 0]) < 2.0 * series[:, 1] for series in errors])
    return np.mean(inside), np.median([np.median(x[:, 1]) / np.std(x[:, 0], ddof=1) for x in errors])


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "variant"),
    [("derivatives", "global"), ("derivatives", "textbook"), ("short-period", "textbook"), ("lateral", "textbook")],
)
def test_estimates_at_twelve_conditions_are_within_two_standard_errors(model, variant):
    errors = [series for condition in CONDITIONS for series in errors_at(model, variant, condition, 10)]
    share, ratio = share_and_ratio(errors)
    # 95.4 % of normal errors
    assert share > 0.93
    assert 1.0 / 1.3 < ratio < 1.3


@pytest.mark.long
def test_derivatives_in_light_turbulence_are_within_two_standard_errors():
    """Roll gusts, which nothing measures, move the aircraft: without instruments 88 % of the estimates are inside."""
    errors = [
        series for condition in CONDITIONS[::3] for series in errors_at("derivatives", "global", condition, 8, "light")
    ]
    share, ratio = share_and_ratio(errors)
    assert share > 0.93
    assert 1.0 / 1.3 < ratio < 1.3


def test_maximum_likelihood_agrees_with_the_regression():
    record = noisy_record("doublet").window(0.0, 5.0)
    regression = anser.identify(record, "short-period", aircraft=f16())
    errors = {row["name"]: row["standard_error"] for row in regression.rows()}
    for method in ("output-error", "filter-error"):
        result = anser.identify(record, "short-period", aircraft=f16(), method=method)
        for name, error in errors.items():
            assert abs(result[name] - regression[name]) < 4.0 * error, (method, name)
        assert min(row["r_squared"] for row in result.fit_rows()) > 0.99


@pytest.mark.long
def test_filter_error_covers_the_linear_model_in_turbulence():
    """The gusts enter as noise in the rates; the noise-free air of `linearize` is the truth."""
    trim = f16().trim(speed_m_s=150.0, altitude_m=1000.0)
    controls = {"elevator": anser.three_two_one_one(1.0, width_s=0.5) + anser.doublet(1.0, start_s=8.0)}
    flown = anser.simulate(f16(), trim, controls, duration_s=14.0, record_period_s=0.02, turbulence="light", seed=4)
    record = flight_record(flown).with_noise({"alpha_deg": 0.05, "pitch_rate_deg_s": 0.05})
    result = anser.identify(record, "short-period", method="filter-error", align=False)
    truth = linear_parameters(150.0, 1000.0)
    for row in result.rows():
        if row["name"] in truth:
            assert abs(row["estimate"] - truth[row["name"]]) < 4.0 * row["standard_error"], row
    assert result["noise(alpha)"] > 0.0
    with pytest.raises(ValueError, match="method: arrived filter-error with the model derivatives"):
        anser.identify(record, method="filter-error", align=False)


@pytest.mark.long
def test_a_flight_without_experiment_gets_a_caution():
    """The autopilot flies a gentle turn: the surfaces follow the rates, and the fit says little."""
    trim = f16().trim(speed_m_s=150.0, altitude_m=1000.0)
    command = {"course_deg": anser.step_input(3.0)}
    flown = anser.simulate(f16(), trim, controller="inversion", command=command, duration_s=20.0, record_period_s=0.1)
    result = anser.identify(flown)
    assert any(note.startswith("Caution") for note in result.notes)
    assert not any(note.startswith("Caution") for note in estimated().notes)


def test_surfaces_that_jump_between_samples_get_a_caution():
    """A log of servo commands: the deflections of a doublet without the lag of the actuator."""
    record = clean_record("doublet")
    start, moved = record["elevator"][0], record["elevator"] - record["elevator"][0]
    commands = record.with_channels(elevator=start + np.round(moved / np.radians(1.0)) * np.radians(1.0))
    for recording, is_jumping in ((record, False), (commands, True)):
        notes = anser.identify(recording, "short-period", aircraft=f16(), align=False).notes
        assert any("elevator: a change between neighbouring samples" in note for note in notes) == is_jumping


@pytest.mark.long
@pytest.mark.parametrize(("record_period_s", "is_cautioned"), [(0.01, False), (0.02, True)])
def test_surfaces_without_lag_are_held_over_the_step_before_the_sample(record_period_s, is_cautioned):
    """Straight lines between the samples made the pitch damping greater by 4 % at 0.01 s, and by 8 % at 0.02 s."""
    trim = f16().trim(speed_m_s=150.0, altitude_m=1000.0)
    controls = {"elevator": anser.three_two_one_one(0.7, width_s=0.5)}
    options = {"duration_s": 10.0, "step_s": 0.01, "record_period_s": record_period_s}
    result = anser.identify(
        anser.simulate(f16(), trim, controls, actuator_lag=False, **options), "short-period", aircraft=f16()
    )
    assert any("Caution: elevator: a change" in note for note in result.notes) == is_cautioned
    if not is_cautioned:
        truth = linear_parameters(150.0, 1000.0)
        assert result["M_q"] == pytest.approx(truth["M_q"], rel=0.01)
        assert result["M_elevator"] == pytest.approx(truth["M_elevator"], rel=0.015)


def test_a_window_and_a_run_with_several_aircraft():
    fleet = flight("multisine").dataset.expand_dims(aircraft=["a", "b"]).transpose("time", "aircraft")
    whole = anser.identify(flight("multisine"))
    assert anser.identify(fleet, aircraft_name="b")["Cm_alpha"] == whole["Cm_alpha"]
    part = anser.identify(flight("multisine"), window_s=(2.0, 18.0))
    assert part.record.time_s[-1] == pytest.approx(18.0)
    assert part["Cm_alpha"] == pytest.approx(whole["Cm_alpha"], rel=0.02)


@pytest.mark.parametrize("take", [lambda fleet: fleet.sel(aircraft="small"), lambda fleet: fleet])
def test_the_aircraft_of_a_scenario_is_the_named_or_the_selected_one(take):
    aircraft = [{"name": "big", "type": "f16"}, {"name": "small", "type": "aerosonde"}]
    fleet = flight("multisine").dataset.expand_dims(aircraft=["big", "small"]).transpose("time", "aircraft")
    fleet = fleet.assign_attrs(scenario=json.dumps({"aircraft": aircraft}))
    named = {"aircraft_name": "small"} if "aircraft" in take(fleet).dims else {}
    found = _resolve(None, flight_record(take(fleet), **named), named.get("aircraft_name"))
    assert found.identity["aircraft"] == "aerosonde"


def test_names_of_aircraft():
    assert slug("F-16 (textbook) / estimated") == "f-16-textbook-estimated"
    assert slug("***") == "aircraft"


def test_the_aircraft_of_a_recorded_flight_has_its_centre_of_gravity():
    f16 = anser.aircraft("f16", x_cg_over_c=0.38)
    flight = anser.simulate(f16, f16.trim(speed_m_s=150.0, altitude_m=1000.0), duration_s=2.0)
    resolved = _resolve(None, flight_record(flight), None)
    assert float(resolved.airframe.x_cg) == 0.38
    plain = anser.aircraft("f16")
    standard = flight_record(anser.simulate(plain, plain.trim(150.0, 1000.0), duration_s=2.0))
    assert float(_resolve(None, standard, None).airframe.x_cg) == float(plain.airframe.x_cg)


def test_a_surface_that_rests_away_from_zero_has_its_effect_in_the_file(tmp_path):
    """Aileron and rudder alone: the elevator rests at its trim of -2.06 deg, with its noise or without."""
    record = noisy_record("lateral")
    condition = {"speed_m_s": 150.0, "altitude_m": 1000.0}
    for name, recorded in (("clean", record), ("noisy", record.with_noise({"elevator_deg": 0.1}, 5))):
        result = anser.identify(recorded, aircraft=f16(), align=False)
        assert "Cm_elevator" not in result.parameters
        path = tmp_path / f"{name}.toml"
        path.write_text(result.aircraft_file(name), encoding="utf-8")
        found, true = (
            dict(zip(*list(zip(*trim.quantities, strict=True))[:2], strict=True))
            for trim in (anser.aircraft(str(path)).trim(**condition), f16().trim(**condition))
        )
        assert found["elevator"] == pytest.approx(true["elevator"], abs=0.1)
        assert found["angle of attack"] == pytest.approx(true["angle of attack"], abs=0.1)


def validations(manoeuvre, other, pitch_factor):
    """Validation R^2 by response, with a prior aircraft whose pitch moments are multiplied by a factor."""
    factors = jnp.where(jnp.asarray([name == "Cm0" for name in F16_COEFFICIENTS]), pitch_factor, 1.0)
    prior = dataclasses.replace(f16(), airframe=f16().airframe.with_coefficients_scaled(factors))
    result = anser.identify(noisy_record(manoeuvre, 1), aircraft=prior, validate=noisy_record(other, 2))
    return {row["response"]: row["validation_r_squared"] for row in result.fit_rows()}


@pytest.mark.parametrize(("pitch_factor", "Cm_min"), [(1.0, 0.97), (1.5, 0.75)])
def test_a_surface_that_only_the_other_manoeuvre_moves_has_the_effect_of_the_prior_aircraft(pitch_factor, Cm_min):
    r_squared = validations("lateral", "multisine", pitch_factor)
    assert r_squared["CL"] > 0.95
    assert r_squared["CD"] > 0.85
    assert r_squared["Cm"] > Cm_min  # a Cm_elevator that is 1.5 times too large leaves 0.79
    assert min(r_squared[name] for name in LATERAL) > 0.98


@pytest.mark.parametrize("pitch_factor", [1.0, 1.5])
def test_a_surface_that_the_other_manoeuvre_leaves_at_rest_has_its_estimated_effect(pitch_factor):
    """Little pitch motion is to be explained; with the prior Cm_elevator of the elevator at rest, R^2 is -6,900."""
    r_squared = validations("multisine", "lateral", pitch_factor)
    assert r_squared["Cm"] > 0.5
    assert min(r_squared[name] for name in ("CL", "CD")) > -0.1
    assert min(r_squared[name] for name in LATERAL) > 0.98


def test_a_validation_without_an_estimated_response_is_refused():
    doublet, lateral = clean_record("doublet"), clean_record("lateral")
    at_rest = {name: np.full_like(lateral[name], lateral[name][0]) for name in ("alpha", "pitch_rate")}
    lateral = dataclasses.replace(lateral, channels={**lateral.channels, **at_rest})
    with pytest.raises(ValueError, match="validate: arrived a manoeuvre that excites none of CD, CL, Cm"):
        anser.identify(doublet, aircraft=f16(), validate=lateral, align=False)


@pytest.mark.long
def test_the_noise_of_flow_angles_does_not_weaken_the_moment_derivatives():
    """Equation error with 0.2 deg, a third of the motion: 8 to 10 percent were lost, and no interval held the truth."""
    clean, noise = clean_record("multisine"), {**NOISE, "alpha_deg": 0.2, "beta_deg": 0.2}
    names = "Cm_alpha", "Cm_q", "Cl_beta", "Cn_beta"
    truth = anser.identify(clean, aircraft=f16(), method="equation-error").parameters
    covered = []
    for seed in range(6):
        record = clean.with_noise(noise, seed)
        result = anser.identify(record, aircraft=f16(), method="equation-error", align=False)
        rows = {row["name"]: row for row in result.rows()}
        for name in names:
            assert rows[name]["estimate"] == pytest.approx(truth[name], rel=0.05)
            covered.append(rows[name]["low"] <= truth[name] <= rows[name]["high"])
    assert np.mean(covered) > 0.75
