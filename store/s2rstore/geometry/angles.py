"""Angles and frames: wrap, and the headings of other conventions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def wrap(angle: ArrayLike) -> NDArray[np.float64]:
    """Bring radians into [-pi, pi)."""
    values = np.asarray(angle, dtype=np.float64)
    return np.asarray((values + np.pi) % (2 * np.pi) - np.pi, dtype=np.float64)


def from_habitat(r: ArrayLike) -> NDArray[np.float64]:
    """Map heading of Habitat's yaw r (radians), whose forward is (-sin r, -cos r) in (x, z)."""
    return wrap(-np.pi / 2 - np.asarray(r, dtype=np.float64))


def distance(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """The smaller angle between two headings, radians in [0, pi]."""
    return np.abs(wrap(np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)))
