"""Plan files: equality of the restored plan, and refusal of damaged or foreign files."""

import io
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import anser
from anser.missions import NoPlanError, plans, read_plan, write_plan
from anser.missions.first_plan import PlanFileError
from anser.scenario import loads
from anser.scenario.user_parts import UserParts, attach_parts
from support.certified_scenario import GOOD
from support.straight_lines import StraightLines

THREE = (Path(__file__).parents[2] / "scenarios" / "three-aircraft.toml").read_text()
THREE = THREE.replace("duration_s = 150.0", "duration_s = 65.0")  # just after the arrival


def assert_same(tree_a, tree_b):
    for a, b in zip(jax.tree.leaves(tree_a), jax.tree.leaves(tree_b), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.fixture(scope="module")
def planned():
    return anser.plan(loads(THREE))


@pytest.fixture
def written(planned, tmp_path):
    write_plan(planned, tmp_path / "plan.npz")
    return tmp_path / "plan.npz"


def test_a_restored_plan_equals_the_written_plan(planned, written):
    restored = read_plan(str(written.parent), loads(THREE))  # its folder, as a text
    assert_same(restored.plan, planned.plan)
    assert_same(restored.initial_state().planner, planned.initial_state().planner)
    # Trimmed again, and by another program: to the solver's rounding.
    for restored_leaf, written_leaf in zip(
        jax.tree.leaves(restored.initial_state()), jax.tree.leaves(planned.initial_state()), strict=True
    ):
        np.testing.assert_allclose(restored_leaf, written_leaf, rtol=1e-9, atol=1e-9)
    assert restored.problems() == planned.problems() == ()


@pytest.mark.long
def test_a_restored_plan_gives_the_same_flight_without_a_search(planned, written, monkeypatch):
    scenario = loads(THREE)
    flown = anser.run(scenario)
    restored = read_plan(written, scenario)
    monkeypatch.setattr("anser.missions.runs.plan", None)  # whoever plans fails
    repeated = anser.run(scenario, planned=restored)
    for name in ("north_m", "east_m", "altitude_m", "airspeed_m_s"):
        np.testing.assert_allclose(repeated.dataset[name], flown.dataset[name], rtol=1e-9, atol=1e-6)


@pytest.mark.long
def test_a_certified_plan_is_restored_with_its_holds(tmp_path):
    scenario = loads(GOOD)
    planned = anser.plan(scenario)
    write_plan(planned, tmp_path / "plan.npz")
    restored = read_plan(tmp_path / "plan.npz", scenario)
    assert_same(restored.plan, planned.plan)
    assert_same(restored.holds, planned.holds)
    assert anser.run(scenario, planned=restored).met


def test_an_existing_file_is_not_overwritten(planned, written):
    content = written.read_bytes()
    with pytest.raises(FileExistsError):
        write_plan(planned, written)
    assert written.read_bytes() == content


def test_a_plan_is_refused_for_another_scenario(planned, written):
    changed_scenario = loads(THREE.replace("speed_m_s = 25.0", "speed_m_s = 24.0"))
    with pytest.raises(PlanFileError, match="holds the plan of another scenario"):
        read_plan(written, changed_scenario)
    with pytest.raises(ValueError, match="planned: arrived a plan for three-aircraft; expected one for the scenario"):
        anser.run(changed_scenario, planned=planned)


def test_a_plan_is_refused_for_a_planner_of_the_user(written):
    attached = attach_parts(loads(THREE), UserParts(planner=StraightLines(jnp.asarray(60.0), jnp.zeros(3))))
    with pytest.raises(PlanFileError, match="a user-defined planner, StraightLines; expected the scenario without it"):
        read_plan(written, attached)


def change_file(path, change, sealed=True):
    with np.load(path) as archive:
        arrays = dict(archive)
    metadata = json.loads(str(arrays.pop("about")))
    change(metadata, arrays)
    archive = io.BytesIO()
    np.savez(archive, about=np.array(json.dumps(metadata)), **arrays)
    path.write_bytes(plans._with_checksum(archive) if sealed else archive.getvalue())


def _remove_array(metadata, arrays):
    del arrays["plan.arrival_time"]


def _raise_format(metadata, arrays):
    metadata["format_version"] = 99


def _change_version(metadata, arrays):
    metadata["version_anser"] = "9.9"


def _clear_metadata(metadata, arrays):
    metadata.clear()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_remove_array, "cannot be read as a plan"),
        (_raise_format, "has format_version 99; expected 2"),
        (_change_version, "a plan of anser 9.9; expected one of"),
        (_clear_metadata, "cannot be read as a plan"),
    ],
)
def test_a_changed_plan_is_refused(written, change, words):
    change_file(written, change)
    with pytest.raises(PlanFileError, match=words):
        read_plan(written, loads(THREE))


def test_a_plan_without_its_checksum_is_refused(written):
    change_file(written, lambda metadata, arrays: None, sealed=False)
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


def test_a_refused_plan_is_not_written(tmp_path):
    class Refused:
        scenario = loads(GOOD)

        def saved_state(self):
            raise NoPlanError(("the goal flees",))

    with pytest.raises(NoPlanError, match="the goal flees"):
        write_plan(Refused(), tmp_path / "plan.npz")
    assert not (tmp_path / "plan.npz").exists()
