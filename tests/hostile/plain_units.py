"""A function that worker processes can import."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path


def opener(root: Path, threads: int) -> Callable[[object], None]:
    """A function that computes nothing."""
    return lambda unit: None
