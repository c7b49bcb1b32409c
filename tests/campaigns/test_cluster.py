"""A cluster that is lost ends a campaign with one message, whatever died; a chunk that kills workers ends no other."""

import signal
import time

import pytest

from anser.campaigns import StoreError, cluster
from anser.campaigns.cluster import flown_by_cluster
from campaigns.cluster_cases import begun_cluster, deadly, marked, slow


@pytest.fixture(autouse=True)
def short_patience(monkeypatch):
    monkeypatch.setattr(cluster, "_LOOK_S", 0.2)
    monkeypatch.setattr(cluster, "_ANSWER_S", 2.0)
    monkeypatch.setattr(cluster, "_WITHOUT_WORKERS_S", 1.0)


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_scheduler_that_dies_ends_the_campaign_and_keeps_what_is_complete(tmp_path, capfd):
    with begun_cluster() as (address, scheduler, _):
        counts = flown_by_cluster(address, slow, tmp_path, [0, 1, 2])
        assert next(counts) == 1
        scheduler.kill()
        began = time.monotonic()
        with pytest.raises(StoreError, match=f"cluster {address}: arrived a scheduler that broke the connection"):
            next(counts)
    assert time.monotonic() - began < 10.0
    assert files(tmp_path) == ["0"]
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.long
def test_a_scheduler_that_does_not_answer_ends_it(tmp_path):
    with begun_cluster() as (address, scheduler, _):
        counts = flown_by_cluster(address, slow, tmp_path, [0, 1])
        assert next(counts) == 1
        scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(StoreError, match="arrived a scheduler that does not answer within 2 s; expected one that"):
            next(counts)


@pytest.mark.long
def test_a_cluster_without_workers_ends_it_after_a_while(tmp_path):
    with begun_cluster() as (address, _, worker):
        counts = flown_by_cluster(address, slow, tmp_path, [0, 1])
        assert next(counts) == 1
        worker.kill()
        with pytest.raises(StoreError, match="arrived a scheduler without workers for 1 s"):
            next(counts)


@pytest.mark.long
def test_a_chunk_that_kills_its_workers_is_given_up_and_the_others_are_flown(tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(cluster, "_WITHOUT_WORKERS_S", 60.0)
    monkeypatch.setattr(cluster, "_AGAIN", 1)
    chunks = list(range(8))
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as local:
        with pytest.raises(StoreError, match="arrived chunk 1, whose workers died 8 times"):
            list(flown_by_cluster(local.scheduler_address, deadly, tmp_path, chunks))
        assert files(tmp_path) == ["0", "2", "3", "4", "5", "6", "7", "deaths"]
        assert (tmp_path / "deaths").read_text() == 8 * "x"
        (tmp_path / "deaths").unlink()
        assert list(flown_by_cluster(local.scheduler_address, marked, tmp_path, [1])) == [1]
    assert files(tmp_path) == list("01234567")
