"""The command plan end to end: output, files, exit codes."""

import csv
import json
import types
from pathlib import Path

import pytest

SCENARIOS = Path(__file__).parents[1] / "scenarios"
THREE = SCENARIOS / "three-aircraft.toml"
FILES = ["plan.json", "plan.npz", "plan.png", "plan.svg", "trajectories.csv"]


@pytest.mark.long
def test_plan_writes_its_files_and_prints_margins(anser, tmp_path):
    out = tmp_path / "deep" / "plan"
    code, printed, _ = anser("plan", THREE, "--out", out)
    assert code == 0
    assert "all arrive at 60.36 s" in printed
    assert "left to the limits" in printed
    assert "aircraft-2 and aircraft-3 at 60.36 s" in printed
    assert sorted(path.name for path in out.iterdir()) == FILES
    summary = json.loads((out / "plan.json").read_text())
    assert summary["status"] == "planned"
    assert [sample["path"] for sample in summary["aircraft"]] == ["nominal", "bent left", "bent right"]
    for sample in summary["aircraft"]:
        # all paths have the length of the farthest's, to what the planner solves them to
        assert sample["length_m"] == pytest.approx(9054.059, abs=0.01)
        assert all(limit["margin"] > 0.0 for limit in sample["limits"])
    # two goals on the sea 1005 m apart, in the plane, at the arrival: see the scenario
    assert summary["least_distance"]["value_m"] == pytest.approx(100.0 + 15.0 * 60.36039, abs=0.1)
    with (out / "trajectories.csv").open(newline="") as file:
        samples = list(csv.DictReader(file))
    assert len(samples) == 3 * 122  # 0, 0.5, ..., 60 s and the arrival
    arrived = [sample for sample in samples if float(sample["time_s"]) > 60.3]
    assert [sample["aircraft"] for sample in arrived] == ["aircraft-1", "aircraft-2", "aircraft-3"]
    assert [float(sample["altitude_m"]) for sample in arrived] == pytest.approx([300.0] * 3, abs=1e-3)
    assert float(arrived[2]["east_m"]) == pytest.approx(100.0 + 15.0 * 60.36039, abs=0.01)
    svg = (out / "plan.svg").read_text()
    assert "closest: aircraft-2 and aircraft-3" in svg

    original = {path.name: path.read_bytes() for path in out.iterdir()}
    code, printed, said = anser("plan", THREE, "--out", out)
    assert (code, printed) == (2, "")
    assert f"--out: arrived {out}, which exists; expected a new folder" in said
    assert original == {path.name: path.read_bytes() for path in out.iterdir()}


@pytest.mark.long
def test_a_plan_beyond_a_limit_is_written_and_ends_with_1(anser, tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(THREE.read_text().replace("bank_max_deg = 70.0", "bank_max_deg = 40.0"))
    code, printed, said = anser("plan", path, "--out", tmp_path / "plan")
    assert code == 1
    assert "aircraft-3" in said
    assert "turns faster" in said
    assert "-25." in printed  # it banks to 65 deg
    summary = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert summary["status"] == "not flyable"
    assert "turns faster" in summary["aircraft"][2]["status"]
    assert sorted(path.name for path in (tmp_path / "plan").iterdir()) == FILES


def test_a_refusal_is_printed_and_leaves_no_files(anser, tmp_path, monkeypatch):
    reasons = ("earliest common arrival 83.2 s", "separation 430 m reachable, 500 m asked")
    refused = types.SimpleNamespace(refusals=reasons)
    monkeypatch.setattr("anser.missions.first_plan.CertifiedFirstPlan.make", lambda *arguments: refused)
    code, printed, said = anser("plan", SCENARIOS / "twenty-aircraft.toml", "--out", tmp_path / "plan")
    assert (code, printed) == (1, "")
    assert [line for line in said.splitlines() if line.startswith("no plan")] == [
        f"no plan: {reason}" for reason in reasons
    ]
    code, printed, _ = anser("plan", SCENARIOS / "twenty-aircraft.toml", "--json")
    assert code == 1
    assert json.loads(printed) == {"format_version": 1, "status": "no plan", "reasons": list(reasons)}
    assert not (tmp_path / "plan").exists()


def test_bad_input_leaves_nothing(anser, tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(THREE.read_text().replace("speed_m_s = 150.0\n", "sped_m_s = 150.0\n", 1))
    code, _, said = anser("plan", path, "--out", tmp_path / "plan")
    assert code == 2
    assert "fleet.sped_m_s" in said
    assert not (tmp_path / "plan").exists()
    (tmp_path / "file").write_text("")
    code, _, said = anser("plan", THREE, "--out", tmp_path / "file" / "plan")
    assert code == 2
    assert "--out" in said
