"""Outputs that a study defines: their values, their refusals, and their place in a campaign's results."""

import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.campaigns import StoreError, compare_campaigns, load_campaign
from anser.campaigns import flights as flying
from anser.campaigns.campaign_report import write_campaign
from anser.campaigns.flights import create_store
from anser.config import ScenarioError
from anser.config.expressions import parse_expression
from anser.missions import fly_many
from anser.missions.flight_batches import FlightCase, _fly_alone
from anser.missions.flight_outputs import FlightOutput, OutputRecording
from anser.missions.series import SeriesSelection
from campaigns.study_cases import STUDIES, THREE, made_up, study_of, text_of

SHORT = anser.load(STUDIES / "short-approach.toml")
KEYS = ("bank", "load_factor", "alpha", "phase", "path_angle", "airspeed", "rates_limited")
ROUNDING = 1e-12  # of the order of the sums


def output(name, expression, reduction, **keys):
    return {"name": name, "expression": expression, "reduction": reduction, **keys}


OUTPUTS = (
    output("bank", "abs(bank_deg)", "greatest"),
    output("load", "load_factor - 1", "least"),
    output("pull", "hypot(load_factor, cos(bank_deg)) ** 2", "mean"),
    output("climb", "airspeed_m_s * sin(path_angle_deg)", "integral", until="arrival", unit="m"),
    output("alpha", "min(alpha_deg, 3) / 2", "final"),
    output("banked", "0.5 < abs(bank_deg) < 5 and not rates_limited or phase == 2", "time"),
)
BANK, LOAD = OUTPUTS[:2]


def values_by_numpy(series, step_s):
    """The outputs from the variables at every step, written out."""
    bank, load, alpha, phase, gamma, speed, limited = (series[key][0] for key in KEYS)
    approach = phase[:-1] != 2
    is_banked = ((abs(bank) > 0.5) & (abs(bank) < 5) & (limited == 0)) | (phase == 2)
    return {
        "bank": np.max(abs(bank)),
        "load": np.min(load) - 1,
        "pull": np.mean((load**2 + np.cos(np.radians(bank)) ** 2)[:-1]),
        "climb": np.sum((speed * np.sin(np.radians(gamma)))[:-1][approach]) * step_s,
        "alpha": min(alpha[-1], 3) / 2,
        "banked": np.sum(is_banked[:-1]) * step_s,
    }


@pytest.mark.parametrize("reduction", ["greatest", "least", "mean", "integral", "final", "time"])
@pytest.mark.parametrize("until", ["end", "arrival"])
def test_the_running_value_is_the_reduction_of_all_samples(reduction, until):
    expression = "mach > 0.2" if reduction == "time" else "mach ** 2 if mach > -0.5 else mach"
    values = output("x", expression, reduction, until=until)
    recording = OutputRecording.of_study([FlightOutput.model_validate(values)], SHORT)
    assert recording is not None
    formula = recording.formulas[0][1]
    variables = {"mach": np.random.default_rng(1).normal(size=(9, 1)), "phase": np.array([[0] * 6 + [2] * 3]).T}
    variables["mach"][3] = np.nan
    weights = np.append(np.full(8, 0.02), 0.0)
    running = formula.start
    for k in range(9):
        sample = {name: array[k : k + 1] for name, array in variables.items()}
        running = formula.combine(running, formula.partial(sample, weights[k : k + 1], np))
    whole = formula.finish(*formula.partial(variables, weights, np))
    assert whole is not None
    assert formula.finish(*map(float, running)) == pytest.approx(whole, rel=ROUNDING)


@pytest.mark.long
def test_outputs_are_those_of_the_flight_recorded_at_every_step():
    recording = OutputRecording.of_study([FlightOutput.model_validate(values) for values in OUTPUTS], SHORT)
    series, step_s = SeriesSelection(KEYS, 1), SHORT.timing.step_s
    cases = [FlightCase(SHORT), FlightCase(SHORT, seed=5)]
    for flight_row in fly_many(cases, series=series, outputs=recording):
        expected = values_by_numpy(flight_row.series, step_s)
        assert dict(flight_row.outputs) == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING)
    alone = _fly_alone(FlightCase(SHORT), SeriesSelection(KEYS, 1), recording)
    assert dict(alone.outputs) == pytest.approx(values_by_numpy(alone.series, step_s), rel=ROUNDING, abs=ROUNDING)
    sparse = _fly_alone(FlightCase(SHORT), SeriesSelection(KEYS, 50), recording)
    assert sparse.outputs == alone.outputs
    np.testing.assert_array_equal(sparse.series["bank"], alone.series["bank"][:, ::50])


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("__import__('os').system('true')", "nothing but numbers, variables"),
        ("(lambda: 1)()", "nothing but numbers, variables"),
        ("mach.real", 'arrived "mach.real"; expected nothing but numbers'),
        ("mach[0]", "nothing but numbers"),
        ("[mach for mach in mach]", "nothing but numbers"),
        ("'mach'", "nothing but numbers"),
        ("open(mach)", "nothing but numbers"),
        ("max(mach, key=abs)", "nothing but numbers"),
        ("mach if mach else 2", 'arrived "mach", which is a number; expected a condition there'),
        ("mach if mach > 1 else mach > 2", "which is true or false; expected a number there"),
        ("-" * 200 + "mach", "40 levels at most"),
        ("(" * 250 + "mach" + ")" * 40, "an expression of numbers"),
        ("1e999 * mach", "a finite number"),
        ("9 ** 9", "at least one variable of the flight"),
        ("mach +", "an expression of numbers"),
        ("abs(mach, 1)", "abs of one number"),
        ("1 + (mach > 0.5)", 'arrived "mach > 0.5", which is true or false; expected a number there'),
        ("bank_limited + 1", "which is true or false; expected a number"),
    ],
)
def test_what_is_no_expression_is_refused(expression, message):
    with pytest.raises(ScenarioError) as caught:
        study_of(output=[BANK, output("x", expression, "mean")])
    assert "output[1].expression: arrived" in str(caught.value)
    assert message in str(caught.value)


def test_a_conditional_expression_selects_between_two_numbers():
    evaluate = parse_expression("abs(bank_deg) if 0 < mach < 1 or bank_deg > 50 else -1").evaluate
    values = {"bank_deg": np.array([-20.0, 30.0, 60.0]), "mach": np.array([0.5, 2.0, np.nan])}
    assert evaluate(values, np).tolist() == [20.0, -1.0, 60.0]
    assert evaluate(values, jnp).tolist() == [20.0, -1.0, 60.0]


def test_huge_powers_take_no_time_and_have_no_value():
    recording = OutputRecording.of_study(
        [FlightOutput.model_validate(output("x", "mach * 9 ** 9 ** 9 ** 9", "greatest"))], SHORT
    )
    assert recording is not None
    formula = recording.formulas[0][1]
    with np.errstate(all="ignore"):
        assert formula.finish(*formula.partial({"mach": np.ones((2, 1))}, np.ones(2), np)) is None


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([BANK, BANK], 'output[1].name: arrived "bank"; expected a name that no other output or result has'),
        ([output("met", "mach", "mean")], 'output[0].name: arrived "met"'),
        ([output("Bank", "mach", "mean")], "output[0].name"),
        ([output("x", "mach > 0.5", "mean")], 'output[0].reduction: arrived "mean"; expected "time"'),
        ([output("x", "mach", "time")], 'output[0].expression: arrived "mach", which is a number'),
        ([output("x", "mach", "median")], 'output[0].reduction: arrived "median"; expected "greatest" or "least"'),
    ],
)
def test_outputs_that_do_not_fit_are_refused(values, message):
    with pytest.raises(ScenarioError) as caught:
        study_of(output=values)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (output("x", "bank_rad", "greatest"), 'output[0].expression: arrived "bank_rad"; expected a variable'),
        (output("x", "bank_rad", "greatest"), 'perhaps "bank_deg"'),
        (output("x", "bank", "greatest"), 'perhaps "bank_deg"'),
        (output("x", "load_facter", "greatest"), 'perhaps "load_factor"'),
        (output("x", "gust_u_m_s", "greatest"), "this one takes turbulence or a gust"),
        (output("x", "mach", "mean"), 'output[0].aircraft: arrived nothing; expected "aircraft-1" or '),
        (output("x", "mach", "mean", aircraft="four"), 'output[0].aircraft: arrived "four"; expected the name'),
    ],
)
def test_outputs_that_the_fleet_does_not_have_are_refused(values, message, tmp_path):
    with pytest.raises(ScenarioError) as caught:
        create_store(tmp_path, study_of(output=[values]), THREE, {})
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"outputs": {"name": "bank"}}, "outputs: arrived a table; expected a list of dictionaries"),
        ({"outputs": ["bank"]}, "outputs: arrived .*; expected a list of dictionaries"),
        ({"outputs": 5}, "outputs: arrived 5; expected a list of dictionaries"),
        ({"processes": 0}, "processes: arrived 0; expected a whole number, 1 at least"),
        ({"processes": "2"}, "processes: arrived '2'; expected a whole number"),
    ],
)
def test_wrong_arguments_of_a_campaign_are_refused_before_its_folder_is_made(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        anser.campaign(STUDIES / "how-surely.toml", tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


def test_a_stopping_rule_names_an_output():
    until = {"statistic": "bank", "share": 0.5, "width": 1.0}
    rule = study_of(output=[BANK], until=until).until
    assert rule is not None
    assert rule.statistic == "bank"
    with pytest.raises(ScenarioError, match=r'until.statistic: arrived "bank"; expected "met" or "miss_m" or'):
        study_of(until=until)


def test_a_campaign_has_its_outputs_in_every_result(tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "fly_many", made_up)
    monkeypatch.setattr(flying, "BATCH", 20)
    (tmp_path / "three.toml").write_text((STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text())
    study, out = tmp_path / "study.toml", tmp_path / "out"
    table = '[[output]]\nname = "load"\nexpression = "load_factor - 1"\nreduction = "least"\n'
    rule = '[until]\nstatistic = "load"\nshare = 0.5\nwidth = 30.0\nat_least = 40\n'
    study.write_text(text_of(flights=60) + table + rule)
    bank = {**BANK, "unit": "deg"}
    anser.campaign(study, out, processes=1, outputs=[bank])
    campaign = load_campaign(out)
    data = campaign.dataset
    assert data.sizes["flight"] == 40
    assert data["bank"].dims == ("flight",)
    assert data["bank"].attrs == {"units": "deg", "long_name": "bank: greatest abs(bank_deg)"}
    started = data["reason"].values == ""
    assert np.array_equal(np.isnan(data["bank"].values), ~started)
    np.testing.assert_array_equal(data["bank"].values[started], 2.0 * data["load"].values[started])
    quantiles = {(estimate.name, estimate.upper, estimate.unit) for estimate in campaign.estimates().quantiles}
    assert {("bank", True, "deg"), ("load", False, "1")} <= quantiles
    assert {"bank", "load"} <= {entry.output for entry in campaign.influences().entries}
    write_campaign(campaign.store, worst=0)
    page = (out / "report.html").read_text()
    assert '"words": "bank"' in page or '"words":"bank"' in page
    assert "greatest abs(bank_deg)" in page or "abs(bank_deg)" in page
    with pytest.raises(StoreError, match="study hash"):
        anser.campaign(study, out, resume=True, processes=1)
    anser.campaign(study, out, resume=True, processes=1, outputs=[bank])
    differences = {difference.name: difference for difference in compare_campaigns(out, out).differences}
    assert differences["load"].greater_is_better
    assert differences["bank"].alike == 40
