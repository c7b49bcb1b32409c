"""Chunks of a campaign flown by a cluster of dask.distributed: given out, looked after, ended where it is lost."""

import concurrent.futures
import contextlib
import importlib
import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import CancelledError, Future
from pathlib import Path
from typing import Any

from anser.campaigns.store import StoreError

_CONNECT = "10s"
"""How long the scheduler may take to answer at first."""
_LOOK_S = 5.0
"""How often the cluster is looked after while no chunk ends."""
_ANSWER_S = 30.0
"""How long the scheduler may take to answer while flights are in the air: it may be busy."""
_WITHOUT_WORKERS_S = 120.0
"""How long a cluster may be without workers: those that were killed are started again."""
_AGAIN = 2
"""How often a chunk is given out again after dask gave it up, which it does when four workers died with it."""
_IN_A_ROW = 3
"""Chunks given up without one complete between them after which no other is tried."""


def flown_by_cluster(
    address: str, fly: Callable[[Path, int], int], folder: Path, chunks: list[int]
) -> Generator[int, None, None]:
    """Have chunks flown by the workers of a cluster; how many flights each had, as it becomes complete.

    A chunk with which workers die again and again is given up, and the others are flown all the same.

    Parameters
    ----------
    address
        Of a running scheduler.
    fly
        Flies a chunk of the campaign in a folder and says how many flights it had; known to the workers by its module.
    folder
        Of the campaign; the workers must see it.
    chunks
        Their numbers, in the order in which they are given out.

    Raises
    ------
    StoreError
        There is no such cluster; its scheduler died or does not answer; it is without workers for two minutes; or a
        chunk was given up. What is complete stays complete.
    """
    with _client(address) as (client, killed_worker):
        executor = client.get_executor(pure=False)
        watch = _Watch(client, address)
        left, waiting, killed, given_up, in_a_row = deque(chunks), dict[Future[int], int](), Counter[int](), [], 0
        while left or waiting:
            while left and len(waiting) < watch.at_a_time:
                chunk = left.popleft()
                waiting[executor.submit(fly, folder, chunk)] = chunk
            ended = concurrent.futures.wait(waiting, _LOOK_S, concurrent.futures.FIRST_COMPLETED).done
            if not ended:
                watch.look()
            for one in ended:
                chunk = waiting.pop(one)
                try:
                    count = one.result()
                except CancelledError:
                    raise watch.lost("a scheduler that broke the connection") from None
                except killed_worker:
                    killed[chunk] += 1
                    if killed[chunk] <= _AGAIN:
                        left.append(chunk)
                        continue
                    given_up.append(chunk)
                    in_a_row += 1
                    if in_a_row == _IN_A_ROW:
                        raise _given_up(address, given_up) from None
                    continue
                in_a_row = 0
                yield count
    if given_up:
        raise _given_up(address, given_up)


class _Watch:
    """Whether a cluster is still there, and how many chunks it is given at a time."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._workers_seen_at = time.monotonic()
        self.at_a_time = 1
        self.look()

    def look(self) -> None:
        """Ask the scheduler for its workers; raises StoreError where it does not answer, or has had none for long."""
        try:
            threads = self._client.sync(self._client.scheduler.ncores, callback_timeout=_ANSWER_S)
        except OSError:  # timeouts and broken connections are among these
            raise self.lost(f"a scheduler that does not answer within {_ANSWER_S:.0f} s") from None
        # one more for each thread, so that none waits for what it is given next
        self.at_a_time = 2 * max(sum(threads.values()), 1)
        now = time.monotonic()
        if threads:
            self._workers_seen_at = now
        elif now - self._workers_seen_at > _WITHOUT_WORKERS_S:
            raise self.lost(f"a scheduler without workers for {_WITHOUT_WORKERS_S:.0f} s")

    def lost(self, arrived: str) -> StoreError:
        """What is raised where the cluster is no more."""
        words = "expected one that lasts as long as the campaign; resume flies what is missing"
        return StoreError(f"cluster {self._address}: arrived {arrived}; {words}")


def _given_up(address: str, chunks: list[int]) -> StoreError:
    which = ", ".join(map(str, sorted(chunks)))
    deaths = f"whose workers died {4 * (_AGAIN + 1)} times, perhaps for want of memory"
    words = f"arrived {'chunk' if len(chunks) == 1 else 'chunks'} {which}, {deaths}; expected workers that last"
    return StoreError(f"cluster {address}: {words}; resume tries again")


@contextlib.contextmanager
def _client(address: str) -> Iterator[tuple[Any, type[Exception]]]:
    """Client of a cluster, and the exception that says that dask gave a chunk up."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise StoreError(
            'cluster: arrived an address, but no dask; expected it installed: the extra "campaign"'
        ) from None
    with _quiet():
        try:
            client = distributed.Client(address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            words = f"expected the address of a running scheduler, such as tcp://127.0.0.1:8786 ({error})"
            raise StoreError(f"cluster: arrived {address}; {words}") from None
        with client:
            yield client, distributed.KilledWorker


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without what dask's client logs of a lost connection, tracebacks among it: that is said in one message."""
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
