"""Chunks of a campaign flown by a cluster of dask.distributed: given out, looked after, ended where it is lost."""

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
"""How long the scheduler may take to answer at first."""
_LOOK_S = 5.0
"""How often the cluster is looked after."""
_WAIT_S = 0.05
"""Between two looks at whether a chunk has ended."""
_ANSWER_S = 30.0
"""How long the scheduler may take to answer while flights are in the air: it may be busy."""
_WITHOUT_WORKERS_S = 120.0
"""How long a cluster may be without workers: those that were killed are started again."""
_RETRIES = 2
"""How often a chunk is given out again after dask gave it up, which it does when four workers died with it."""
_CONSECUTIVE_FAILURES = 3
"""Chunks given up without one complete between them after which no other is tried."""


def fly_on_cluster(
    address: str, fly: Callable[[Path, int], object], folder: Path, chunks: list[int]
) -> Generator[int, None, None]:
    """Have chunks flown by the workers of a cluster; each chunk, as it becomes complete.

    A chunk with which workers die again and again is given up, and the others are flown all the same.

    Parameters
    ----------
    address
        Of a running scheduler.
    fly
        Flies a chunk of the campaign in a folder, known to the workers by its module; what it returns is not looked at,
        as it may be lost with its worker.
    folder
        Of the campaign; the workers must see it.
    chunks
        Their numbers, in the order in which they are given out.

    Raises
    ------
    StoreError
        There is no such cluster, or one without anser; its scheduler died or does not answer; it is without workers
        for two minutes; or a chunk was given up. What is complete stays complete.
    """
    with _client(address) as (client, distributed):
        watch = _Watch(client, address)
        left, killed, given_up, in_a_row = deque(chunks), Counter[int](), list[int](), 0
        waiting: dict[Any, int] = {}
        while left or waiting:
            while left and len(waiting) < watch.at_a_time:
                chunk = left.popleft()
                waiting[client.submit(fly, folder, chunk, pure=False)] = chunk
            for one in watch.ended(waiting):
                chunk = waiting.pop(one)
                if one.status == "finished":
                    in_a_row = 0
                    yield chunk
                    continue
                error = one.exception()
                if not isinstance(error, distributed.KilledWorker):
                    raise _readable(error, address)
                killed[chunk] += 1
                if killed[chunk] <= _RETRIES:
                    left.append(chunk)
                    continue
                given_up.append(chunk)
                in_a_row += 1
                if in_a_row == _CONSECUTIVE_FAILURES:
                    raise _given_up(address, given_up)
    if given_up:
        raise _given_up(address, given_up)


class _Watch:
    """Whether a cluster is still there, and how many chunks it is given at a time."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._workers_seen_at = self._looked_at = time.monotonic()
        self.at_a_time = 1
        self._poll_workers()

    def _poll_workers(self) -> None:
        """Ask the scheduler for its workers; raises StoreError where it does not answer, or has had none for long."""
        try:
            threads = self._client.sync(self._client.scheduler.ncores, callback_timeout=_ANSWER_S)
        except OSError:  # timeouts and broken connections are among these
            raise self.lost(f"a scheduler that does not answer within {_ANSWER_S:.0f} s") from None
        # one more for each thread, so that none waits for what it is given next
        self.at_a_time = 2 * max(sum(threads.values()), 1)
        now = self._looked_at = time.monotonic()
        if threads:
            self._workers_seen_at = now
        elif now - self._workers_seen_at > _WITHOUT_WORKERS_S:
            raise self.lost(f"a scheduler without workers for {_WITHOUT_WORKERS_S:.0f} s")

    def ended(self, waiting: Collection[Any]) -> list[Any]:
        """Those that have ended, as soon as there are some, or none for a while; raises as `_look` does."""
        until, found = time.monotonic() + _LOOK_S, list[Any]()
        while time.monotonic() < until:
            if any(one.status == "cancelled" for one in waiting):
                raise self.lost("a scheduler that broke the connection")
            # one whose worker died with what it returned is lost, and comes again
            found = [one for one in waiting if one.status in ("finished", "error")]
            if found:
                break
            time.sleep(_WAIT_S)
        if time.monotonic() - self._looked_at >= _LOOK_S:
            self._poll_workers()
        return found

    def lost(self, arrived: str) -> StoreError:
        """What is raised where the cluster is no more."""
        words = "expected one that lasts as long as the campaign; resume flies what is missing"
        return StoreError(f"cluster {self._address}: arrived {arrived}; {words}")


def _readable(error: BaseException, address: str) -> BaseException:
    """What a worker raised; one message where it or the scheduler lacks what flies."""
    # what the scheduler cannot import it says as the cause of another error
    lacking = error if isinstance(error, ImportError) else error.__cause__
    if not isinstance(lacking, ImportError):
        return error
    words = f"arrived a scheduler or worker without anser ({lacking}); expected it installed there, too"
    return StoreError(f"cluster {address}: {words}")


def _given_up(address: str, chunks: list[int]) -> StoreError:
    which = ", ".join(map(str, sorted(chunks)))
    deaths = f"whose workers died {4 * (_RETRIES + 1)} times, perhaps for want of memory"
    words = f"arrived {'chunk' if len(chunks) == 1 else 'chunks'} {which}, {deaths}; expected workers that last"
    return StoreError(f"cluster {address}: {words}; resume tries again")


@contextlib.contextmanager
def _client(address: str) -> Iterator[tuple[Any, Any]]:
    """Client of a cluster, and dask's package of it."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise StoreError(f"cluster: arrived an address; {install_hint('dask', 'campaign')}") from None
    with _quiet():
        try:
            client = distributed.Client(address, timeout=_CONNECT)
        except (OSError, ValueError) as error:
            words = f"expected the address of a running scheduler, such as tcp://127.0.0.1:8786 ({error})"
            raise StoreError(f"cluster: arrived {address}; {words}") from None
        with client:
            yield client, distributed


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
