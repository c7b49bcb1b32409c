"""Commands for aircraft end to end: output, files, exit codes."""

import json

import pytest

from anser import cli


def run(capsys, monkeypatch, *arguments):
    """Exit code, standard output and standard error of a command."""
    monkeypatch.setattr("sys.argv", ["anser", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    out = capsys.readouterr()
    return end.value.code or 0, out.out, out.err


@pytest.fixture
def anser(capsys, monkeypatch):
    return lambda *words: run(capsys, monkeypatch, *words)


def test_a_dave_ml_file_is_checked_alone(anser, tmp_path):
    path = tmp_path / "mine.dml"
    text = (
        '<DAVEfunc><variableDef name="mach" varID="M" units="nd"><isInput/></variableDef>\n'
        '<variableDef name="gain" varID="g" units="nd"><calculation><math><ci>M</ci></math></calculation><isOutput/>'
        "</variableDef>{}</DAVEfunc>"
    )
    path.write_text(text.format(""))
    code, out, err = anser("aircraft", "check", path)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "mine.dml: there are no check data", "inputs: mach (M, nd)", "outputs: gain (g, nd)",
        "nothing found that looks wrong",
    ]  # fmt: skip
    shot = (
        '<checkData><staticShot name="one"><checkInputs><signal><varID>M</varID><signalValue>0.5</signalValue></signal>'
        "</checkInputs><checkOutputs><signal><varID>g</varID><signalValue>0.6</signalValue><tol>0.01</tol></signal>"
        "</checkOutputs></staticShot></checkData>"
    )
    path.write_text(text.format(shot))
    code, out, err = anser("aircraft", "check", path)
    assert code == 1
    assert "0 of 1 numbers of its check data agree" in out
    assert "g (one): expected 0.6 nd, obtained 0.5, tolerance 0.01" in err
    code, out, _ = anser("aircraft", "check", path, "--json")
    document = json.loads(out)
    assert code == 1
    assert [item["agrees"] for item in document["checks"]] == [False]
    assert document["inputs"] == [{"name": "mach", "id": "M", "units": "nd", "usual": None}]
    path.write_text(text.format("").replace('varID="M" units="nd"', 'varID="M" units="ft_s"'))
    code, out, err = anser("aircraft", "check", path)
    assert (code, out) == (2, "")
    assert 'line 1, column 11: arrived units="ft_s" of "mach"' in err


def test_list(anser):
    code, out, _ = anser("aircraft", "list", "--json")
    listed = {airframe["name"]: airframe for airframe in json.loads(out)["aircraft"]}
    assert code == 0
    assert {"f16", "aerosonde"} <= set(listed)
    assert listed["aerosonde"]["mass_kg"] == 11.0
    assert listed["aerosonde"]["airspeed_m_s"] == [13.0, 40.0]


def test_a_new_file_is_checked_and_errors_are_reported(anser, tmp_path):
    path = tmp_path / "my.toml"
    assert anser("aircraft", "new", path)[0] == 0
    assert anser("aircraft", "new", path)[0] == 2  # nothing is overwritten
    code, out, err = anser("aircraft", "check", path)
    assert (code, err) == (0, "")
    assert "1 of 1 numbers of its check data agree" in out
    assert "a positive deflection: elevator nose down, aileron rolls left, rudder nose left" in out
    path.write_text(
        path.read_text().replace("Cm_q = -14.32", "Cm_q = 14.32").replace("alpha_deg = 0.0", "alpha_deg = 3.0")
    )
    code, out, err = anser("aircraft", "check", path)
    assert code == 1
    assert "aerodynamics.Cm_q: 14.3" in err
    assert "check.trim[0].alpha_deg" in err
    assert "change or delete them with these" in err
    code, out, _ = anser("aircraft", "check", path, "--json")
    assert code == 1
    document = json.loads(out)
    assert [item["place"] for item in document["findings"]] == ["aerodynamics.Cm_q"]
    assert document["positive_deflections"]["elevator"] == "nose down"
    assert [item["agrees"] for item in document["checks"]] == [False]
    path.write_text(path.read_text().replace("Cm_q", "Cm_qq"))
    code, _, err = anser("aircraft", "check", path)
    assert code == 2
    assert 'perhaps "Cm_q"' in err
    code, _, err = anser("aircraft", "check", "f16")
    assert code == 1
    assert "stands out from its neighbours" in err


@pytest.mark.long
def test_show_draws_and_prints_level_flight(anser, tmp_path):
    picture = tmp_path / "aerosonde.png"
    code, out, _ = anser("aircraft", "show", "aerosonde", "--out", picture, "--json")
    assert code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    slowest, fastest = json.loads(out)["level_flight_m_s"]
    assert 13.0 <= slowest < 17.0  # at the elevator's stop
    assert 31.0 < fastest <= 34.0  # at full power
    assert anser("aircraft", "show", "aerosonde", "--out", picture)[0] == 2
    code, _, said = anser("aircraft", "show", "aerosonde", "--altitude-m", "nan")
    assert code == 2
    assert "--altitude-m" in said


def test_trim_by_name(anser):
    code, out, _ = anser("trim", "--aircraft", "aerosonde", "--speed-m-s", 25, "--altitude-m", 100, "--json")
    assert code == 0
    document = json.loads(out)
    assert (document["aircraft"], "variant" in document, "x_cg_over_c" in document) == ("aerosonde", False, False)
    quantities = {quantity["name"]: quantity["value"] for quantity in document["quantities"]}
    assert quantities["angle of attack"] == pytest.approx(3.0878, abs=1e-3)
    assert quantities["engine power"] == pytest.approx(77.40, abs=0.01)
    assert quantities["aileron"] > 0.3  # against the reaction to the propeller's torque
    code, _, err = anser("trim", "--aircraft", "aerosond", "--speed-m-s", 25, "--altitude-m", 100)
    assert code == 2
    assert 'perhaps "aerosonde"' in err


def test_a_simulation_that_cannot_be_flown_is_refused_by_argument_and_option(anser):
    level = ("--speed-m-s", 150, "--altitude-m", 1000)
    assert anser("simulate", "f17", *level)[2].startswith("AIRCRAFT: arrived 'f17'; expected perhaps \"f16\"")
    code, _, err = anser("simulate", "f16", *level, "--step-s", 0.25)
    assert code == 2
    assert "--step-s: arrived 0.25; expected a number from 0.001 to 0.05; --record-period-s gives a coarser" in err


@pytest.mark.long
def test_linearize_by_file(anser, tmp_path):
    path = tmp_path / "my.toml"
    anser("aircraft", "new", path)
    code, out, _ = anser("linearize", "--aircraft", path, "--speed-m-s", 50, "--altitude-m", 500)
    assert code == 0
    assert all(mode in out for mode in ("short period", "phugoid", "Dutch roll", "spiral"))
