"""Flights of a campaign on a cluster (dask.distributed): submission of chunks, supervision, and error handling.

A chunk is a number of consecutive flights that one worker flies and stores together.
"""

import contextlib
import importlib
import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Generator, Iterator
from pathlib import Path
from typing import Any

from anser.campaigns.store_integrity import StoreError
from anser.results.documents import install_hint

_CONNECT = "10s"
"""Timeout of the first connection to the scheduler."""
_SUPERVISION_PERIOD_S = 5.0
"""Time between two checks that the cluster has workers, s."""
_WAIT_S = 0.05
"""Period of polling for finished chunks, s."""
_ANSWER_S = 30.0
"""Timeout of requests to the scheduler after the connection, s; long, since a busy scheduler may answer late."""
_WITHOUT_WORKERS_S = 120.0
"""Maximum time without workers, s; killed workers may be restarted within this time."""
_RETRIES = 2
"""Number of resubmissions of a chunk; dask gives up each submission after four deaths of workers."""
_CONSECUTIVE_FAILURES = 3
"""Number of chunks abandoned in a row after which no further chunk is submitted."""


def fly_on_cluster(
    address: str,  # address of a running scheduler
    # flies a chunk of the campaign in a folder; importable by the workers. The result is ignored, since it may be lost
    # with the worker
    fly: Callable[[Path, int], object],
    folder: Path,  # folder of the campaign, accessible to the workers
    chunks: list[int],  # numbers of the chunks, in submission order
) -> Generator[int, None, None]:
    """Fly chunks of a campaign on the workers of a cluster; yield the number of each completed chunk.

    A chunk that kills workers in three submissions is abandoned; three abandoned chunks in a row end the flights.
    Raises StoreError if the package `distributed` is missing, if the cluster is unreachable, lost or lacks anser, or if
    a chunk was abandoned. An error of a flight itself is raised unchanged. Completed chunks remain complete.
    """
    with _client(address) as (client, distributed):
        watch = _Supervision(client, address)
        pending, kill_counts, abandoned, consecutive = deque(chunks), Counter[int](), list[int](), 0
        waiting: dict[Any, int] = {}
        while pending or waiting:
            while pending and len(waiting) < watch.at_a_time:
                chunk = pending.popleft()
                waiting[client.submit(fly, folder, chunk, pure=False)] = chunk
            for future in watch.ended(waiting):
                chunk = waiting.pop(future)
                if future.status == "finished":
                    consecutive = 0
                    yield chunk
                    continue
                error = future.exception()
                if not isinstance(error, distributed.KilledWorker):
                    raise _explain_import_error(error, address)
                kill_counts[chunk] += 1
                if kill_counts[chunk] <= _RETRIES:
                    pending.append(chunk)
                    continue
                abandoned.append(chunk)
                consecutive += 1
                if consecutive == _CONSECUTIVE_FAILURES:
                    raise _abandoned_error(address, abandoned)
    if abandoned:
        raise _abandoned_error(address, abandoned)


class _Supervision:
    """State of a cluster while flights run: connection, workers, and the number of chunks submitted at a time.

    Methods raise StoreError if the connection breaks, if the scheduler does not answer, or if the cluster has had no
    workers for two minutes.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._workers_seen_at = self._looked_at = time.monotonic()
        self.at_a_time = 1
        self._poll_workers()

    def _poll_workers(self) -> None:
        """Update `at_a_time`, the number of chunks submitted at a time: two per thread of the cluster's workers."""
        try:
            threads = self._client.sync(self._client.scheduler.ncores, callback_timeout=_ANSWER_S)
        except OSError:  # timeouts and broken connections are among these
            raise self.lost(f"a scheduler that does not answer within {_ANSWER_S:.0f} s") from None
        # one more chunk per thread, so that no thread waits for the next submission
        self.at_a_time = 2 * max(sum(threads.values()), 1)
        time_s = self._looked_at = time.monotonic()
        if threads:
            self._workers_seen_at = time_s
        elif time_s - self._workers_seen_at > _WITHOUT_WORKERS_S:
            raise self.lost(f"a scheduler without workers for {_WITHOUT_WORKERS_S:.0f} s")

    def ended(self, waiting: Collection[Any]) -> list[Any]:
        """Wait at most 5 s for a submission (dask future) in `waiting` to end; return the submissions that ended."""
        deadline, futures = time.monotonic() + _SUPERVISION_PERIOD_S, list[Any]()
        while time.monotonic() < deadline:
            if any(future.status == "cancelled" for future in waiting):
                raise self.lost("a scheduler that broke the connection")
            # a result that is lost with its worker makes the future pending again
            futures = [future for future in waiting if future.status in ("finished", "error")]
            if futures:
                break
            time.sleep(_WAIT_S)
        if time.monotonic() - self._looked_at >= _SUPERVISION_PERIOD_S:
            self._poll_workers()
        return futures

    def lost(self, arrived: str) -> StoreError:
        """Return the StoreError for a lost cluster, with the description `arrived` of the failure in the message."""
        expected = "expected one that lasts as long as the campaign; resume flies what is missing"
        return StoreError(f"cluster {self._address}: arrived {arrived}; {expected}")


def _explain_import_error(error: BaseException, address: str) -> BaseException:
    """Return a StoreError if `error` shows that a worker or the scheduler lacks anser; if not, return `error`."""
    # an import error of the scheduler is the cause of another error
    import_error = error if isinstance(error, ImportError) else error.__cause__
    if not isinstance(import_error, ImportError):
        return error
    detail = f"arrived a scheduler or worker without anser ({import_error}); expected it installed there, too"
    return StoreError(f"cluster {address}: {detail}")


def _abandoned_error(address: str, chunks: list[int]) -> StoreError:
    numbers = ", ".join(map(str, sorted(chunks)))
    deaths = f"whose workers died {4 * (_RETRIES + 1)} times, perhaps for want of memory"
    detail = f"arrived {'chunk' if len(chunks) == 1 else 'chunks'} {numbers}, {deaths}; expected workers that last"
    return StoreError(f"cluster {address}: {detail}; resume tries again")


@contextlib.contextmanager
def _client(address: str) -> Iterator[tuple[Any, Any]]:
    """Connect to a cluster for the `with` block; yield the client and the module `distributed`.

    Raises StoreError if `distributed` is not installed, or no scheduler answers at the address.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise StoreError(f"cluster: arrived an address; {install_hint('dask', 'campaign')}") from None
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)  # a single StoreError reports a lost connection
    try:
        try:
            client = distributed.Client(address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            expected = f"expected the address of a running scheduler, such as tcp://127.0.0.1:8786 ({error})"
            raise StoreError(f"cluster: arrived {address}; {expected}") from None
        with client:
            yield client, distributed
    finally:
        logger.setLevel(level)
