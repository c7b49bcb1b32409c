"""Compiled programs on disk, beside JAX's compilation cache."""

import contextlib
import hashlib
import os
import tempfile
import time
from pathlib import Path

_MARK = b"anser program 1\n"
_LEFT_S = 3600.0  # age of a half-written file whose process must have ended


class FolderStore:
    """Programs in a folder, one file each: written whole or not at all, the oldest given up beyond a size.

    A folder that cannot be read or written, or a full disk, costs time only. A file that is damaged counts as none.

    Attributes
    ----------
    folder
        May not exist yet.
    size_max
        Of all files together, bytes.
    """

    def __init__(self, folder: Path, size_max: int = 1 << 30) -> None:
        self.folder, self.size_max = folder, size_max

    def files(self) -> list[Path]:
        """The programs, those used last at the end."""
        found = []
        with contextlib.suppress(OSError):
            for path in self.folder.glob("*.program"):
                with contextlib.suppress(OSError):
                    found.append((path.stat().st_mtime_ns, path))
        return [path for _, path in sorted(found)]

    def load(self, key: str) -> bytes | None:
        """Content that was saved under a key; None where there is none, or none that is whole."""
        path = self.folder / f"{key}.program"
        try:
            held = path.read_bytes()
        except OSError:
            return None
        start = len(_MARK) + 32
        content = held[start:]
        if held[:start] != _MARK + hashlib.sha256(content).digest():
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return content

    def save(self, key: str, content: bytes) -> None:
        """Keep content under a key, if the folder takes it."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder, prefix=".new-")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(_MARK + hashlib.sha256(content).digest() + content)
                Path(name).replace(self.folder / f"{key}.program")
            except OSError:
                Path(name).unlink(missing_ok=True)
                raise
            self._shrink()

    def _shrink(self) -> None:
        sizes = [(path, path.stat().st_size) for path in self.files()]
        total = sum(size for _, size in sizes)
        for path, size in sizes:
            if total <= self.size_max:
                break
            path.unlink(missing_ok=True)
            total -= size
        for path in self.folder.glob(".new-*"):
            if time.time() - path.stat().st_mtime > _LEFT_S:
                path.unlink(missing_ok=True)

    def clear(self) -> int:
        """Delete all programs, and what an interrupted process left; how many programs it were."""
        count = len(self.files())
        for path in [*self.folder.glob("*.program"), *self.folder.glob(".new-*")]:
            path.unlink(missing_ok=True)
        return count
