"""Errors of a campaign's folder, and the lock of the process that flies it."""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path


class StoreError(ValueError):
    """A folder that is no store of this study, or cannot be one; `str()` is the finished message."""


@contextlib.contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the system releases it when the process ends, however it does.

    Raises
    ------
    StoreError
        Another process holds it, or the file system has no locks.
    """
    path = folder / "lock"
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(path.open("a"))
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            words = "arrived a folder into which another process flies; expected one at a time: wait until it ends"
            raise StoreError(f"{folder}: {words}") from None
        except OSError as error:
            words = f"arrived {path}, which cannot be locked ({error.strerror}); expected a file system with locks"
            raise StoreError(f"{folder}: {words}") from None
        yield
