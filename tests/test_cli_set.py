"""Options --set, --planner and --open."""

from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest

from anser.cli.overrides import parse_value
from anser.scenario import load, loads
from test_cli_everywhere import THREE
from test_cli_force import fake  # noqa: F401 - a fixture


def test_overrides_give_the_flight_and_hash_of_a_file_with_these_values(anser, tmp_path, fake):  # noqa: F811
    values = ("--set", "wind.speed_m_s=8", "--set", "wind.from_deg=240.0", "--set", "seed=7")
    assert anser("run", THREE, "--out", tmp_path / "a", *values)[0] == 0
    text = THREE.read_text().replace("[fleet]", "[wind]\nspeed_m_s = 8.0\nfrom_deg = 240\n\n[fleet]", 1)
    by_hand = loads(text.replace("format = 2", "format = 2\nseed = 7", 1))
    assert fake[0] == by_hand
    assert fake[0].hash == by_hand.hash != load(THREE).hash
    assert anser("run", THREE, "--out", tmp_path / "b", "--planner", "certified")[0] == 0
    assert fake[1].fleet.planner == "certified"
    names = ("--set", "goal[boat-north].course_deg=5", "--set", "aircraft[1].start.altitude_m=1700")
    assert anser("run", THREE, "--out", tmp_path / "c", *names)[0] == 0
    assert (fake[2].goal[0].course_deg, fake[2].aircraft[1].start.altitude_m) == (5.0, 1700.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--set", "wind.speed_m_s"), "--set: arrived 'wind.speed_m_s'; expected PATH=VALUE, such as"),
        (("--set", "=8"), "expected PATH=VALUE"),
        (("--set", "seed=1", "--set", "seed=2"), "--set: arrived seed twice; expected it once"),
        (
            ("--set", "aircraft[0].start.speed_m_s=150", "--set", "aircraft[aircraft-1].start.speed_m_s=140"),
            "aircraft[aircraft-1].start.speed_m_s: arrived the key of aircraft[0].start.speed_m_s again",
        ),
        (("--set", "fleet.planner=certified", "--planner", "published"), "arrived fleet.planner twice"),
        (("--set", "wind.sped_m_s=8"), 'perhaps "speed_m_s"'),
        (("--set", "wind.sped_m_s=8"), "three-aircraft.toml with wind.sped_m_s = 8: 1 problem"),
        (("--set", "wind.speed_m_s=9 kt"), "9 kt is 4.63 m/s: write 4.63"),
        (("--set", "wind.speed_m_s=fast"), 'arrived "fast"; expected a number from 0 to 100 m/s'),
        (("--set", "goal[boat].course_deg=5"), 'perhaps "boat-east"'),
        (("--set", "arrival={rule="), "expected a value of TOML"),
        (("--planner", "certifed"), "--planner: arrived 'certifed'; expected one of 'certified'"),
    ],
)
@pytest.mark.parametrize("command", ["run", "plan"])
def test_a_wrong_value_ends_with_2_and_writes_nothing(anser, tmp_path, command, options, said):
    code, printed, err = anser(command, THREE, "--out", tmp_path / "out", *options)
    assert (code, printed) == (2, "")
    assert said in err
    assert not (tmp_path / "out").exists()


def test_overrides_are_refused_for_a_flight_of_a_campaign(anser, tmp_path):
    code, _, err = anser("run", "--campaign", tmp_path, "--flight", "1", "--set", "seed=3")
    assert code == 2
    assert "--campaign, whose flight is flown as it was" in err


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("8", 8),
        ("8.5", 8.5),
        ("true", True),
        ("left", "left"),
        ("[1, 2.0, 3]", [1, 2.0, 3]),
        ('["a", "b"]', ["a", "b"]),
        ('{ rule = "at", time_s = 250.0 }', {"rule": "at", "time_s": 250.0}),
        ('"8"', "8"),
    ],
)
def test_values_are_read_as_in_a_file(text, value):
    parsed = parse_value(text)
    assert parsed == value
    assert type(parsed) is type(value)


@pytest.fixture
def opened(monkeypatch):
    pages = []
    monkeypatch.setattr(
        "webbrowser.open", lambda uri: pages.append(Path(unquote(urlparse(uri).path))) or len(pages) < 2
    )
    return pages


def test_open_shows_the_report_or_prints_its_path(anser, tmp_path, fake, opened):  # noqa: F811
    for name in ("a run", "b"):
        code, _, err = anser("run", THREE, "--out", tmp_path / name, "--open")
        assert code == 0
    assert opened == [tmp_path / "a run" / "report.html", tmp_path / "b" / "report.html"]
    assert all(page.is_file() for page in opened)
    assert f"no browser could be opened: open {opened[1]}" in err
