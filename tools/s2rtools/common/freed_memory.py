"""Keep freed memory in the process, so that large temporary arrays need no new pages."""

from __future__ import annotations

import ctypes
import platform

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's mallopt(3)."""
_LARGEST_KEPT = 32 << 20
"""Bytes of the largest array that is taken from kept memory; glibc allows no more."""
_KEPT = 64 << 20
"""Bytes of free memory at the end of the heap that are not returned to the system."""


def keep_freed_memory() -> None:
    """Let the allocator of this process reuse what arrays up to 32 MB free; glibc only."""
    if platform.libc_ver()[0] != "glibc":
        return
    library = ctypes.CDLL(None)
    library.mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
    library.mallopt(_TRIM_THRESHOLD, _KEPT)
