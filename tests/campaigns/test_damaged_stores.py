"""Stores read by plain xarray, and damaged stores: reported on reading, flown again on resuming."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr

from anser.campaigns import StoreError, campaign, flights, load_campaign
from anser.campaigns.campaign_folder import open_campaign_store
from anser.campaigns.store import CampaignStore
from anser.campaigns.study import Study
from anser.config.errors import ScenarioError
from anser.scenario.schema import Scenario
from campaigns.study_cases import STUDIES, made_up, text_of
from trials.damaged_files import MUTATIONS, files_of

FLIGHTS, CHUNK = 12, 4
KEPT = '[keep]\nseries = ["position_error", "speed_limited", "phase"]\nseries_every_s = 30.0\n'


@pytest.fixture(autouse=True)
def made_up_flights(monkeypatch):
    monkeypatch.setattr(flights, "fly_many", made_up)
    monkeypatch.setattr(flights, "BATCH", CHUNK)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    shutil.copy(STUDIES.parent / "scenarios" / "three-aircraft.toml", folder / "three.toml")
    (folder / "study.toml").write_text(text_of(flights=FLIGHTS) + KEPT)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def whole(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flights, "fly_many", made_up)
        patch.setattr(flights, "BATCH", CHUNK)
        campaign(study, folder, processes=1)
    return folder


@pytest.fixture
def out(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "out")


def contents(folder):
    """Rows, series and every file of the store and its checksums."""
    store = CampaignStore.open(folder)
    files = {str(path.relative_to(folder)): path.read_bytes() for path in files_of(folder)}
    return store.dataset(), store.series().load(), files


def assert_same(folder, expected_folder):
    actual, expected = contents(folder), contents(expected_folder)
    xr.testing.assert_identical(actual[0], expected[0])
    xr.testing.assert_identical(actual[1], expected[1])
    assert actual[2] == expected[2]


def test_plain_xarray_reads_every_array_as_written(whole):
    store, plain = CampaignStore.open(whole), xr.open_zarr(whole / "flights.zarr")
    data = plain.load()
    assert data["flown"].values.all()
    kinds = {values.dtype.kind for values in data.variables.values()}
    assert kinds == set("bifuU")
    expected = store.dataset()
    xr.testing.assert_identical(data.drop_vars("flown").drop_attrs(deep=False), expected.drop_attrs(deep=False))
    assert data["flight"].values[0] == 0
    assert not data["met"].values.all()
    assert float(data["met"].mean()) == expected["met"].values.mean()
    assert "" in data["reason"].values
    series = xr.open_zarr(whole / "flights.zarr", group="series").load()
    assert {values.dtype.kind for values in series.variables.values()} == set("ifU")
    assert (series["phase"].values == -1).any()
    assert (series["speed_limited"].values == 0).any()
    xr.testing.assert_identical(series, store.series().load())


def test_missing_flights_are_marked_in_plain_xarray(study, tmp_path):
    store = open_campaign_store(study, tmp_path / "out", resume=False)
    flights.fly_chunk(store.folder, 1)
    data = xr.open_zarr(tmp_path / "out" / "flights.zarr").load()
    assert np.flatnonzero(data["flown"].values).tolist() == [4, 5, 6, 7]
    assert np.isnan(data["miss_m"].values[[0, 11]]).all()


@pytest.mark.parametrize("seed", range(11))
def test_a_damaged_store_is_reported_and_restored_bit_identically(study, whole, out, seed):
    draw = np.random.default_rng(seed)
    kinds = sorted(MUTATIONS)
    damaged = MUTATIONS[kinds[seed % len(kinds)]](files_of(out), draw)
    with pytest.raises(StoreError, match=r"flights\.zarr|checksums"):
        contents(out)
    try:
        campaign(study, out, resume=True, processes=1)
    except StoreError as error:
        # without this record nobody knows what is whole
        assert "store.json: arrived" in str(error)  # noqa: PT017
        assert [path.name for path in damaged] == ["store.json"]
    else:
        assert_same(out, whole)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("flights.zarr/met/1", r"chunk 1 \(flights 4 to 7\) of which .*met/1 is (damaged|missing); expected a whole store"),
        ("flights.zarr/flown/2", r"flown/2 is (damaged|missing)"),
        ("checksums/0.json", "the record of checksums is missing|0.json: arrived a file that cannot be read"),
        ("flights.zarr/seed/0", r"seed/0: arrived a file that is damaged or missing; expected it as anser wrote it"),
        ("flights.zarr/.zattrs", "zattrs: arrived a file that is damaged or missing"),
        ("flights.zarr/wind.speed_m_s/0", "arrived a file that is damaged or missing"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("content", [None, pytest.param(b"", marks=pytest.mark.long)])
def test_every_type_of_store_file_is_restored(study, whole, out, name, message, content):
    if content is None:
        (out / name).unlink()
    else:
        (out / name).write_bytes(content)
    with pytest.raises(StoreError, match=message):
        CampaignStore.open(out)
    messages = []
    campaign(study, out, resume=True, processes=1, progress=lambda what, part: messages.append(what))
    assert_same(out, whole)
    assert ("is flown again" in messages[0]) == (name.split("/")[-1] != "0" and "zattrs" not in name)


def test_damage_after_opening_a_store_is_reported(out):
    store = CampaignStore.open(out)
    (out / "flights.zarr" / "series" / "phase" / "1.0.0").unlink()
    store.dataset()
    with pytest.raises(StoreError, match=r"phase/1\.0\.0 is missing"):
        store.series()


def test_metadata_of_another_study_are_not_inserted(study, out, tmp_path):
    (out / "flights.zarr" / "seed" / "0").unlink()
    (study.parent / "other.toml").write_text(study.read_text().replace("seed = 1", "seed = 2"))
    with pytest.raises(
        StoreError, match=r"seed/0: arrived a damaged file that this study and version do not make anew"
    ):
        campaign(study.parent / "other.toml", out, resume=True, processes=1)


@pytest.mark.long
def test_two_processes_do_not_resume_one_store(study, out):
    program = (
        "import pathlib, sys\nfrom anser.campaigns.store_integrity import folder_lock\n"
        "with folder_lock(pathlib.Path(sys.argv[1])):\n    print('held', flush=True)\n    sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, str(out)]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout.readline() == b"held\n"
    with pytest.raises(StoreError, match="a folder into which another process flies; expected one at a time"):
        campaign(study, out, resume=True, processes=1)
    CampaignStore.open(out)
    holder.kill()
    holder.communicate()
    campaign(study, out, resume=True, processes=1)


def test_a_stored_campaign_is_read_even_if_the_rules_of_today_refuse_its_study_and_scenario(tmp_path):
    """Earlier versions accepted weights in a grid, and this limit, written out, for the global model."""
    text = (STUDIES.parent / "scenarios" / "three-aircraft.toml").read_text()
    text = text.replace("[limits]", "[limits]\nalpha_min_deg = -5.0")
    (tmp_path / "three.toml").write_text(text.replace('\ngoal = "', '\nvariant = "global"\ngoal = "'))
    path, choice = tmp_path / "study.toml", 'distribution = "choice"\nvalues = [1.0, 2.0]\nweights = [3.0, 1.0]\n'
    path.write_text(
        'format = 1\nname = "test"\nscenario = "three.toml"\n[sampling]\nmethod = "grid"\nlevels = 2\n'
        f'[[vary]]\npath = "wind.speed_m_s"\n{choice}'
    )
    with pytest.MonkeyPatch.context() as earlier:
        earlier.setattr(Scenario, "consistency_problems", lambda self: [])
        earlier.setattr(Study, "consistency_problems", lambda self: [])
        campaign(path, tmp_path / "out", processes=1)
    stored = load_campaign(tmp_path / "out")
    assert stored.estimates().flights == 2
    assert stored.report(worst=0)
    with pytest.raises(ValueError, match="worst: arrived -1; expected"):
        stored.report(worst=-1)
    assert stored.store.study.vary[0].weights == (3.0, 1.0)
    with pytest.raises(ScenarioError, match=r"limits.alpha_min_deg: arrived -5; expected at least -4 deg"):
        stored.flight(0)
    with pytest.raises(ScenarioError, match=r"vary\[0\].weights: arrived a list of 2"):
        campaign(path, tmp_path / "out", resume=True, processes=1)
