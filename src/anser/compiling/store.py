"""Store of compiled programs in a folder on disk."""

import contextlib
import hashlib
import logging
import os
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # no POSIX system
    fcntl = None

_MARK = b"anser program 2\n"
_ABANDONED_S = 3600.0  # age of an unfinished file from which an ended process is inferred
_OPEN_FLAGS = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_LOG = logging.getLogger(__name__)


class FolderStore:
    """Store of compiled programs in a folder, one file per program.

    The folder is created on the first save. If the files exceed `size_max` bytes in total, the least recently used
    files are deleted. An unreadable folder, a full disk or a damaged file raises no error; the program is compiled
    again.

    For security, code is loaded only if folder and file belong to the user and other users cannot write to them. For
    any other path, a warning is logged once.
    """

    _reported: set[Path] = set()  # noqa: RUF012 - of the process: each path is reported once

    def __init__(self, folder: Path, size_max: int = 1 << 30) -> None:
        self.folder, self.size_max = folder, size_max

    def files(self) -> list[Path]:
        """Return the paths of the program files, the most recently used last; empty if the folder cannot be read."""
        dated_paths = []
        with contextlib.suppress(OSError):
            for path in self.folder.glob("*.program"):
                with contextlib.suppress(OSError):
                    dated_paths.append((path.lstat().st_mtime_ns, path))
        return [path for _, path in sorted(dated_paths)]

    def load(self, key: str) -> bytes | None:
        """Return the content saved under a key; None if it is missing, damaged or not trusted."""
        if not self._trusted_folder():
            return None
        path = self.folder / f"{key}.program"
        data, reason = _read_trusted(path)
        if reason:
            self._report(path, reason)
        if data is None:
            return None
        start = len(_MARK) + 32
        content = data[start:]
        if data[:start] != _header(key, content):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return content

    def save(self, key: str, content: bytes) -> None:
        """Save content under a key, and delete the oldest files above `size_max`; an unwritable folder is ignored."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not self._trusted_folder():
                return
            handle, name = tempfile.mkstemp(dir=self.folder, prefix=".new-")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(_header(key, content) + content)
                Path(name).replace(self.folder / f"{key}.program")
            except OSError:
                Path(name).unlink(missing_ok=True)
                raise
            self._shrink()

    @contextlib.contextmanager
    def reserve(self, key: str) -> Iterator[None]:
        """Reserve a key for the `with` block; meanwhile, other processes and threads that reserve the key wait.

        The key is not reserved if the system has no file locks, or the folder is not trusted or not writable.
        """
        with contextlib.ExitStack() as stack:
            if fcntl is not None and self._trusted_folder():
                with contextlib.suppress(OSError):
                    self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                    path = self.folder / f".lock-{key}"
                    handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
                    stack.callback(os.close, handle)
                    stack.callback(path.unlink, missing_ok=True)
                    fcntl.flock(handle, fcntl.LOCK_EX)
            yield

    def distrust_reason(self) -> str | None:
        """Return the reason for not using the folder; None if the folder is trusted or cannot be examined."""
        try:
            return _distrust_reason(self.folder.stat(), folder=True)
        except OSError:
            return None

    def _trusted_folder(self) -> bool:
        reason = self.distrust_reason()
        if reason:
            self._report(self.folder, reason)
        return reason is None

    def _report(self, path: Path, reason: str) -> None:
        if path not in self._reported:
            self._reported.add(path)
            _LOG.warning("caution: %s: compiled programs there are not used: %s", path, reason)

    def _shrink(self) -> None:
        sizes = [(path, path.lstat().st_size) for path in self.files()]
        total = sum(size for _, size in sizes)
        for path, size in sizes:
            if total <= self.size_max:
                break
            path.unlink(missing_ok=True)
            total -= size
        for path in self._leftovers():
            if time.time() - path.lstat().st_mtime > _ABANDONED_S:
                path.unlink(missing_ok=True)

    def _leftovers(self) -> list[Path]:
        return [*self.folder.glob(".new-*"), *self.folder.glob(".lock-*")]

    def clear(self) -> int:
        """Delete the programs and the leftovers of interrupted processes; return the number of program files."""
        count = len(self.files())
        for path in [*self.folder.glob("*.program"), *self._leftovers()]:
            path.unlink(missing_ok=True)
        return count


def _header(key: str, content: bytes) -> bytes:
    """Return the header of a program file: a mark, and a hash of key and content, which loading verifies."""
    return _MARK + hashlib.sha256(key.encode() + b"\0" + content).digest()


def _distrust_reason(status: os.stat_result, *, folder: bool = False) -> str | None:
    """Return the reason why another user could have written a file or folder; None if only the user could."""
    if stat.S_IFMT(status.st_mode) != (stat.S_IFDIR if folder else stat.S_IFREG):
        return "it is no folder" if folder else "it is no regular file"
    if os.name != "posix":  # on Windows, the cache lies in the user's profile, which is closed to other users
        return None
    if status.st_uid != os.geteuid():
        return f"it belongs to another user (number {status.st_uid}; this one is {os.geteuid()})"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"other users may write it (mode {stat.S_IMODE(status.st_mode):o}; `chmod go-w` takes that away)"
    return None


def _read_trusted(path: Path) -> tuple[bytes | None, str | None]:
    """Return a file's content (None if unreadable or not trusted) and the reason for distrust (None if trusted)."""
    try:
        handle = os.open(path, _OPEN_FLAGS)
    except OSError:
        return None, "it is a link" if path.is_symlink() else None
    try:
        reason = _distrust_reason(os.fstat(handle))
        if reason is not None:
            return None, reason
        with open(handle, "rb", closefd=False) as file:
            return file.read(), None
    except OSError:
        return None, None
    finally:
        os.close(handle)
