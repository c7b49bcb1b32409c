"""Free memory of the machine."""

import os
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path("/")
_KIB = 1024


def available_memory(
    root: Path = _ROOT,  # folder with the kernel's folders `proc` and `sys`; tests use another
) -> int | None:
    """Return the free memory for programs, bytes; None if the system does not report any.

    On Linux: the kernel's available memory, or less if a control group (of a container or batch job) sets a lower
    limit. On other Unix systems: half of the installed memory. On Windows: None.
    """
    limits = [size for size in (_kernel_available(root), *_group_limits(root)) if size is not None]
    if limits:
        return max(0, min(limits))
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (AttributeError, ValueError, OSError):
        return None


def _kernel_available(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * _KIB
    return None


def _group_limits(root: Path) -> Iterator[int | None]:
    """Yield the memory left in each control group of the process, bytes; None for a group without a limit."""
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            top, limit, usage = root / "sys/fs/cgroup", "memory.max", "memory.current"
        elif "memory" in controllers.split(","):
            top, limit, usage = root / "sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
        else:
            continue
        own_group = top / path.strip("/")
        # in a container the path may be the host's, with the group itself mounted at the top
        for group in (own_group, *own_group.parents):
            if group == top or top in group.parents:
                yield _remaining_memory(group, limit, usage)


def _remaining_memory(group: Path, limit: str, usage: str) -> int | None:
    """Return the memory left in a control group, bytes; None if there is no limit.

    `limit` and `usage` are names of files in the group's folder. Inactive cached files count as free memory.
    """
    limit_bytes, used_bytes = _number(group / limit), _number(group / usage)
    if limit_bytes is None or used_bytes is None:
        return None
    stat = dict(line.split() for line in _lines(group / "memory.stat") if len(line.split()) == 2)
    file_cache = int(stat.get("total_inactive_file", stat.get("inactive_file", 0)))
    return limit_bytes - max(0, used_bytes - file_cache)


def _number(file: Path) -> int | None:
    """Return the whole number in a file; None for a missing file or another text, such as "max"."""
    lines = _lines(file)
    return int(lines[0]) if lines and lines[0].isdecimal() else None


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
