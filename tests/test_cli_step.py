"""The commands step and gallery end to end: output, files, exit codes."""

import json

import pytest

from anser.analysis.step_tests import PUBLISHED_STEPS

PITCH = ("step", "--loop", "rates", "--channel", "q", "--size", "-5", "--at", "150,2000")


@pytest.mark.long
def test_step_prints_its_metrics_and_draws(anser, tmp_path):
    out = tmp_path / "pitch.svg"
    code, printed, said = anser(*PITCH, "--duration-s", "1.5", "--out", out)
    assert code == 0
    assert "-5 deg/s" in printed
    assert "at 150 m/s, 2000 m" in printed
    assert "written" in said
    picture = out.read_bytes()
    assert b"<svg" in picture
    code, _, said = anser(*PITCH, "--out", out)
    assert code == 2
    assert "exists" in said
    assert out.read_bytes() == picture


def test_step_prints_json(anser):
    code, printed, _ = anser(*PITCH, "--duration-s", "1.5", "--json")
    assert code == 0
    document = json.loads(printed)
    (step,) = document["steps"]
    assert document["altitude_m"] == 2000
    assert step["channels"]["q"]["size"] == -5
    assert 0.1 < step["channels"]["q"]["rise_time_s"] < 1.0
    assert set(step["coupling"]) == {"p", "r"}


@pytest.mark.long
def test_an_untrimmable_point_ends_with_1_and_the_diagnosis(anser, tmp_path):
    code, _, said = anser(*PITCH[:-1], "30,1000", "--out", tmp_path / "a.svg")
    assert code == 1
    assert "slowest trimmable speed" in said
    assert not (tmp_path / "a.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((*PITCH, "--channel", "p"), ("--size", "1 for 2 channels")),
        ((*PITCH, "--channel", "q", "--size", "1"), ("--channel", "q, q", "once")),
        ((*PITCH, "--channel", "mu", "--size", "1"), ("--channel", "'mu'", "p, q, r")),
        ((*PITCH, "--channel", "p", "--size", "0"), ("--size", "0 for p", "not 0")),
        ((*PITCH[:-1], "150"), ("--at", "'150'", "SPEED,ALTITUDE")),
        ((*PITCH[:-1], "nan,2000"), ("--at, speed", "nan", "1 to 1000")),
        ((*PITCH, "--duration-s", "0"), ("--duration-s", "0", "0.2 to 600")),
        ((*PITCH, "--variant", "x"), ("--variant", "'x'", "textbook")),
        ((*PITCH, "--out", "a.jpg"), ("--out", "a.jpg", ".svg")),
        ((*PITCH, "--out", "nowhere/a.svg"), ("--out", "folder that exists")),
    ],
)
def test_bad_input_ends_with_2_and_the_expected_value(anser, arguments, said):
    code, _, err = anser(*arguments)
    assert code == 2
    for part in said:
        assert part in err


@pytest.mark.long
def test_gallery_draws_every_test_and_ends_by_its_limits(anser, tmp_path, monkeypatch):
    """Velocity steps only, the longest ones: each figure takes a second."""
    tests = tuple(test for test in PUBLISHED_STEPS if test.loop == "velocity")
    monkeypatch.setattr("anser.analysis.step_flights.gallery_steps", lambda *requirement: (tests, (150.0, 1000.0)))
    out = tmp_path / "gallery"
    code, printed, said = anser("gallery", "--out", out)
    keys = [*(test.key for test in tests), "overview", "climb-and-turn"]
    files = {f"{key}{suffix}" for key in keys for suffix in (".svg", ".png")} | {"metrics.json"}
    assert {path.name for path in out.iterdir()} == files
    document = json.loads((out / "metrics.json").read_text())
    steps, tracking = document["steps"], document["climb_and_turn"]
    assert len(tracking) > 1
    assert [step["key"] for step in steps] == [test.key for test in tests]
    for step in steps:
        assert step["key"] in printed
        for line in step["shortfalls"]:
            assert f"falls short: {step['key']}: {line}" in said
    short = any(step["shortfalls"] for step in steps) or not all(requirement["met"] for requirement in tracking)
    assert code == (1 if short else 0)
    code, _, said = anser("gallery", "--out", out)
    assert code == 2
    assert "exists" in said
