"""What the machine has: cores that this process may use, and memory that is free for it."""

import os
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path("/")
_KIB = 1024


def usable_cores() -> int:
    """As many as there are cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory(root: Path = _ROOT) -> int | None:
    """Memory that programs may still take, bytes; None where the system does not say.

    On Linux what the kernel holds to be available, or less where a control group (of a container, of a job of a batch
    system) is allowed less; on other systems of the kind half of what is built in; Windows does not say.

    Parameters
    ----------
    root
        Of the files of the kernel, for tests.
    """
    found = [size for size in (_of_kernel(root), *_of_groups(root)) if size is not None]
    if found:
        return max(0, min(found))
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (AttributeError, ValueError, OSError):
        return None


def _of_kernel(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * _KIB
    return None


def _of_groups(root: Path) -> Iterator[int | None]:
    """What the control groups of this process leave it, from its own up to the first; of both versions."""
    for line in _lines(root / "proc/self/cgroup"):
        _, kinds, path = line.split(":", 2)
        if kinds == "":
            top, limit, usage = root / "sys/fs/cgroup", "memory.max", "memory.current"
        elif "memory" in kinds.split(","):
            top, limit, usage = root / "sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
        else:
            continue
        own = top / path.strip("/")
        # in a container the path may be that of the host, and the group itself is mounted at the top
        for group in (own, *own.parents):
            if group == top or top in group.parents:
                yield _left_in(group, limit, usage)


def _left_in(group: Path, limit: str, usage: str) -> int | None:
    """What a control group has left; files that it has read are given back when memory is short."""
    allowed, used = _number(group / limit), _number(group / usage)
    if allowed is None or used is None:
        return None
    stat = dict(line.split() for line in _lines(group / "memory.stat") if len(line.split()) == 2)
    read = int(stat.get("total_inactive_file", stat.get("inactive_file", 0)))
    return allowed - max(0, used - read)


def _number(file: Path) -> int | None:
    """The number in a file; None where there is none, or the word max."""
    lines = _lines(file)
    return int(lines[0]) if lines and lines[0].isdecimal() else None


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
