"""Damaged folders of rare events: reported on reading, flown again on resuming, with bit-identical results."""

import shutil

import numpy as np
import pytest

from anser.campaigns import StoreError, rare, rare_flights, read_rare
from anser.campaigns.store_integrity import folder_lock
from campaigns.rare_cases import RARE_TEXT, made_up
from campaigns.study_cases import STUDIES
from trials.damaged_files import MUTATIONS, OF_ONE_FILE

pytestmark = pytest.mark.usefixtures("undrawn_figures")


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(rare_flights, "fly_many", made_up)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    shutil.copy(STUDIES.parent / "scenarios" / "three-aircraft.toml", folder / "three.toml")
    (folder / "study.toml").write_text(RARE_TEXT)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def whole(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rare_flights, "fly_many", made_up)
        rare(study, folder, processes=1)
    return folder


@pytest.fixture
def out(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "out")


def batches(folder):
    return {path.name: path.read_bytes() for path in (folder / "flown").iterdir()}


@pytest.mark.parametrize("seed", range(10))
def test_a_damaged_batch_is_reported_and_flown_again(study, whole, out, seed):
    kinds = [*OF_ONE_FILE, "swap", "copy over"]
    files = sorted((out / "flown").iterdir())
    damaged = MUTATIONS[kinds[seed % len(kinds)]](files, np.random.default_rng(seed))
    with pytest.raises(
        StoreError, match=r"the batch from flight \d+ on of which .*flown/\d+\.npy is (damaged|missing)"
    ):
        read_rare(out)
    messages = []
    event = rare(study, out, processes=1, resume=True, progress=lambda message, part: messages.append(message))
    assert batches(out) == batches(whole)
    assert event.document == read_rare(whole).document
    assert sum("flown again" in text for text in messages) == sum(path.name in str(messages) for path in damaged)


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_configuration_is_refused(study, out, seed):
    kind = ("edit JSON", "flip one bit", "cut", "empty")[seed]
    MUTATIONS[kind]([out / "checksums" / "store.json"], np.random.default_rng(seed))
    for read in (lambda: read_rare(out), lambda: rare(study, out, processes=1, resume=True)):
        with pytest.raises(StoreError, match=r"store\.json: arrived"):
            read()


def test_a_rare_event_is_flown_by_one_process_at_a_time(study, out):
    with folder_lock(out), pytest.raises(StoreError, match="a folder into which another process flies"):
        rare(study, out, processes=1, resume=True)
    rare(study, out, processes=1, resume=True)
