"""Result of a model for one instance, as numpy arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import DEFAULT_MODES
from s2rstore.records import Domain, Side

HeatKey = tuple[str, Side, str | None]
"""Kind, side and mode of a heatmap; modes as `Store.heatmap` names them."""
Heat = Mapping[HeatKey, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class LiveSide:
    """Network input of one side, and the predicted pose.

    rgb (H, W, 3) uint8; depth (H, W) metres, NaN where invalid; both adjusted. `surface` (H, W) is
    the raw depth before image adjustments, on which heat is projected. `domain` holds the cameras
    of the frame. x, y and error in metres, heading and heading_error in radians; NaN without a
    prediction.
    """

    domain: Domain
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    surface: NDArray[np.uint8] | NDArray[np.uint16]
    x: float
    y: float
    heading: float
    error: float
    heading_error: float


@dataclass(frozen=True, slots=True, eq=False)
class LiveResult:
    """Both sides of one instance, with the heatmaps computed so far."""

    iid: int
    sim: LiveSide
    real: LiveSide
    heat: Heat = field(default_factory=dict)

    def side(self, side: Side) -> LiveSide:
        return self.sim if side == "sim" else self.real

    def heatmap(self, kind: str, side: Side, mode: str | None = None) -> NDArray[np.float32]:
        """A heatmap (rows, columns), as from `Store.heatmap`. RequestError if not computed."""
        key = kind, side, mode or DEFAULT_MODES.get(kind)
        if key not in self.heat:
            raise RequestError(f"heatmap {kind} {key[2] or ''}: not computed for these adjustments")
        return self.heat[key]
