"""Memory of this process that compiled programs take: memory regions, and what the allocator keeps of freed memory."""

import ctypes
import functools
import sys
from collections.abc import Callable
from pathlib import Path

_REGIONS = Path("/proc/self/maps")
_REGIONS_MAX = Path("/proc/sys/vm/max_map_count")


def regions_used() -> float:
    """Share of the memory regions that the system gives a process, 0 to 1; 0 where there is no such limit.

    A loaded program takes up to some thousands; a process that has none left is ended within the compiler.
    """
    try:
        return _REGIONS.read_bytes().count(b"\n") / int(_REGIONS_MAX.read_text())
    except (OSError, ValueError):  # no Linux
        return 0.0


@functools.cache
def _trim() -> Callable[[int], int] | None:
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None


def return_freed_memory() -> None:
    """Give freed memory back to the system: glibc keeps what loading took beside the program, as much as it again."""
    trim = _trim()
    if trim is not None:
        trim(0)
