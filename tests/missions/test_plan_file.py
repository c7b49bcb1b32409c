"""A finished plan as a file: what is read is what was written, and what is anything else is refused."""

import io
import json
from pathlib import Path

import jax
import numpy as np
import pytest

import anser
from anser.missions import NoPlanError, plans, read_plan, write_plan
from anser.missions.first_plan import PlanFileError
from anser.scenario import loads
from support.certified_scenario import GOOD

THREE = (Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml").read_text()
THREE = THREE.replace("duration_s = 150.0", "duration_s = 65.0")  # just after the arrival


def same(one, other):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.fixture(scope="module")
def planned():
    return anser.plan(loads(THREE))


@pytest.fixture
def written(planned, tmp_path):
    write_plan(planned, tmp_path / "plan.npz")
    return tmp_path / "plan.npz"


def test_what_is_read_is_what_was_written(planned, written):
    again = read_plan(str(written.parent), loads(THREE))  # its folder, as a text
    same(again.plan, planned.plan)
    same(again.initial_state().planner, planned.initial_state().planner)
    # Trimmed again, and by another program: to the solver's rounding.
    for one, other in zip(
        jax.tree.leaves(again.initial_state()), jax.tree.leaves(planned.initial_state()), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    assert again.problems() == planned.problems() == ()


def test_flown_without_a_search_it_is_the_same_flight(planned, written, monkeypatch):
    scenario = loads(THREE)
    flown = anser.run(scenario)
    read = read_plan(written, scenario)
    monkeypatch.setattr("anser.missions.runs.plan", None)  # whoever plans fails
    again = anser.run(scenario, planned=read)
    for name in ("north_m", "east_m", "altitude_m", "airspeed_m_s"):
        np.testing.assert_allclose(again.dataset[name], flown.dataset[name], rtol=1e-9, atol=1e-6)


@pytest.mark.long
def test_a_certified_plan_with_holds(tmp_path):
    scenario = loads(GOOD)
    planned = anser.plan(scenario)
    write_plan(planned, tmp_path / "plan.npz")
    again = read_plan(tmp_path / "plan.npz", scenario)
    same(again.plan, planned.plan)
    same(again.holds, planned.holds)
    assert anser.run(scenario, planned=again).met


def test_nothing_is_overwritten(planned, written):
    held = written.read_bytes()
    with pytest.raises(FileExistsError):
        write_plan(planned, written)
    assert written.read_bytes() == held


def test_a_plan_flies_its_own_scenario_only(planned, written):
    other = loads(THREE.replace("speed_m_s = 25.0", "speed_m_s = 24.0"))
    with pytest.raises(PlanFileError, match="holds the plan of another scenario"):
        read_plan(written, other)
    with pytest.raises(ValueError, match="planned: arrived a plan for three-aircraft; expected one for the scenario"):
        anser.run(other, planned=planned)


def changed(path, change, sealed=True):
    with np.load(path) as archive:
        arrays = dict(archive)
    about = json.loads(str(arrays.pop("about")))
    change(about, arrays)
    archive = io.BytesIO()
    np.savez(archive, about=np.array(json.dumps(about)), **arrays)
    path.write_bytes(plans._with_checksum(archive) if sealed else archive.getvalue())


def _lacking(about, arrays):
    del arrays["plan.arrival_time"]


def _later(about, arrays):
    about["format_version"] = 99


def _of_another_version(about, arrays):
    about["version_anser"] = "9.9"


def _without_words(about, arrays):
    about.clear()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_lacking, "cannot be read as a plan"),
        (_later, "has format_version 99; expected 2"),
        (_of_another_version, "a plan of anser 9.9; expected one of"),
        (_without_words, "cannot be read as a plan"),
    ],
)
def test_a_changed_plan_is_refused(written, change, words):
    changed(written, change)
    with pytest.raises(PlanFileError, match=words):
        read_plan(written, loads(THREE))


def test_a_plan_without_its_checksum_is_refused(written):
    changed(written, lambda about, arrays: None, sealed=False)
    with pytest.raises(PlanFileError, match="a file without a checksum, cut or of an older version"):
        read_plan(written, loads(THREE))


def test_any_changed_byte_of_a_plan_is_refused(written):
    content = written.read_bytes()
    for k in np.random.default_rng(1).integers(0, len(content), 50):
        written.write_bytes(content[:k] + bytes([content[k] ^ 4]) + content[k + 1 :])
        with pytest.raises(PlanFileError, match=r"damaged file|without a checksum"):
            read_plan(written, loads(THREE))


@pytest.mark.parametrize("content", [b"", b"not a plan", b"PK\x03\x04 half an archive"])
def test_another_file_is_refused(tmp_path, content):
    (tmp_path / "plan.npz").write_bytes(content)
    with pytest.raises(PlanFileError, match="a file without a checksum"):
        read_plan(tmp_path / "plan.npz", loads(THREE))


def test_half_a_plan_is_refused(written):
    written.write_bytes(written.read_bytes()[: written.stat().st_size // 2])
    with pytest.raises(PlanFileError, match="a file without a checksum"):
        read_plan(written, loads(THREE))


def test_a_plan_that_does_not_exist_is_not_written(tmp_path):
    class Refused:
        scenario = loads(GOOD)

        def kept(self):
            raise NoPlanError(("the goal flees",))

    with pytest.raises(NoPlanError, match="the goal flees"):
        write_plan(Refused(), tmp_path / "plan.npz")
    assert not (tmp_path / "plan.npz").exists()
