"""Compiled programs on disk."""

import contextlib
import hashlib
import logging
import os
import stat
import tempfile
import time
from pathlib import Path

_MARK = b"anser program 2\n"
_LEFT_S = 3600.0  # age of a half-written file whose process must have ended
_READING = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_LOG = logging.getLogger(__name__)


class FolderStore:
    """Programs in a folder, one file each: written whole or not at all, the oldest given up beyond a size.

    A folder that cannot be read or written, or a full disk, costs time only. A file that is damaged, or that was saved
    under another key, counts as none. Code is loaded only where no other user could have put it: a folder or file that
    is not the user's, or that others may write, is not used, which one caution says.

    Attributes
    ----------
    folder
        May not exist yet.
    size_max
        Of all files together, bytes.
    """

    _reported: set[Path] = set()  # noqa: RUF012 - of the process: each place once

    def __init__(self, folder: Path, size_max: int = 1 << 30) -> None:
        self.folder, self.size_max = folder, size_max

    def files(self) -> list[Path]:
        """The programs, those used last at the end."""
        found = []
        with contextlib.suppress(OSError):
            for path in self.folder.glob("*.program"):
                with contextlib.suppress(OSError):
                    found.append((path.lstat().st_mtime_ns, path))
        return [path for _, path in sorted(found)]

    def load(self, key: str) -> bytes | None:
        """Content that was saved under a key; None where there is none, or none that is whole."""
        if not self._trusted_folder():
            return None
        path = self.folder / f"{key}.program"
        held, reason = _read_trusted(path)
        if reason:
            self._report(path, reason)
        if held is None:
            return None
        start = len(_MARK) + 32
        content = held[start:]
        if held[:start] != _head(key, content):
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return content

    def save(self, key: str, content: bytes) -> None:
        """Keep content under a key, if the folder takes it."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not self._trusted_folder():
                return
            handle, name = tempfile.mkstemp(dir=self.folder, prefix=".new-")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(_head(key, content) + content)
                Path(name).replace(self.folder / f"{key}.program")
            except OSError:
                Path(name).unlink(missing_ok=True)
                raise
            self._shrink()

    def distrust_reason(self) -> str | None:
        """Why the folder is not used; None: it is used, or does not exist yet."""
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
        for path in self.folder.glob(".new-*"):
            if time.time() - path.lstat().st_mtime > _LEFT_S:
                path.unlink(missing_ok=True)

    def clear(self) -> int:
        """Delete all programs, and what an interrupted process left; how many programs it were."""
        count = len(self.files())
        for path in [*self.folder.glob("*.program"), *self.folder.glob(".new-*")]:
            path.unlink(missing_ok=True)
        return count


def _head(key: str, content: bytes) -> bytes:
    """What stands before the content: it is whole, and the content of no other key."""
    return _MARK + hashlib.sha256(key.encode() + b"\0" + content).digest()


def _distrust_reason(status: os.stat_result, *, folder: bool = False) -> str | None:
    """Why a file or folder may be another user's; None: it is the user's alone.

    On Windows nothing is distrusted: the cache lies in the user's profile, which is closed to other users.
    """
    if stat.S_IFMT(status.st_mode) != (stat.S_IFDIR if folder else stat.S_IFREG):
        return "it is no folder" if folder else "it is no regular file"
    if os.name != "posix":
        return None
    if status.st_uid != os.geteuid():
        return f"it belongs to another user (number {status.st_uid}; this one is {os.geteuid()})"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"other users may write it (mode {stat.S_IMODE(status.st_mode):o}; `chmod go-w` takes that away)"
    return None


def _read_trusted(path: Path) -> tuple[bytes | None, str | None]:
    """Content of a file; without it, why the file is distrusted, or nothing where it cannot be read at all."""
    try:
        handle = os.open(path, _READING)
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
