"""The loss of a cluster ends a campaign with one message; a chunk that kills workers does not stop other chunks."""

import signal
import time

import pytest

from anser.campaigns import StoreError, cluster
from anser.campaigns.cluster import fly_on_cluster
from campaigns.cluster_cases import deadly, marked, slow, start_cluster


@pytest.fixture(autouse=True)
def looked_after_often(monkeypatch):
    monkeypatch.setattr(cluster, "_SUPERVISION_PERIOD_S", 0.2)


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_dead_scheduler_ends_the_campaign_and_completed_chunks_remain(tmp_path, capfd):
    with start_cluster() as (address, scheduler, _):
        chunks = fly_on_cluster(address, slow, tmp_path, [0, 1, 2])
        assert next(chunks) == 0
        scheduler.kill()
        began = time.monotonic()
        with pytest.raises(StoreError, match=f"cluster {address}: arrived a scheduler that broke the connection"):
            next(chunks)
    assert time.monotonic() - began < 10.0
    assert files(tmp_path) == ["0"]
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.long
def test_a_cluster_without_the_module_is_refused(tmp_path):
    with start_cluster(path=()) as (address, _, _):
        message = (
            r"arrived a scheduler or worker without anser \(No module named 'campaigns'\); expected it installed there"
        )
        with pytest.raises(StoreError, match=message):
            list(fly_on_cluster(address, marked, tmp_path, [0]))


@pytest.mark.long
def test_a_scheduler_without_answer_ends_the_campaign(tmp_path, monkeypatch):
    with start_cluster() as (address, scheduler, _):
        chunks = fly_on_cluster(address, slow, tmp_path, [0, 1])
        assert next(chunks) == 0
        monkeypatch.setattr(cluster, "_ANSWER_S", 2.0)
        scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(StoreError, match="arrived a scheduler that does not answer within 2 s; expected one that"):
            next(chunks)


@pytest.mark.long
def test_a_cluster_without_workers_ends_the_campaign_after_a_while(tmp_path, monkeypatch):
    with start_cluster() as (address, _, worker):
        chunks = fly_on_cluster(address, slow, tmp_path, [0, 1])
        assert next(chunks) == 0
        monkeypatch.setattr(cluster, "_WITHOUT_WORKERS_S", 1.0)
        worker.kill()
        with pytest.raises(StoreError, match="arrived a scheduler without workers for 1 s"):
            next(chunks)


@pytest.mark.long
def test_a_chunk_that_kills_workers_is_abandoned_and_other_chunks_are_flown(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_RETRIES", 1)
    with start_cluster(is_restarted=True) as (address, _, _):
        with pytest.raises(StoreError, match="arrived chunk 1, whose workers died 8 times"):
            list(fly_on_cluster(address, deadly, tmp_path, list(range(8))))
        assert files(tmp_path) == ["0", "2", "3", "4", "5", "6", "7", "deaths"]
        assert (tmp_path / "deaths").read_text() == 8 * "x"
        (tmp_path / "deaths").unlink()
        assert list(fly_on_cluster(address, marked, tmp_path, [1])) == [1]
    assert files(tmp_path) == list("01234567")
