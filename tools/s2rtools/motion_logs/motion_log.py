"""What was recorded while a robot drove: the same words for every file format and simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from s2rtools.motion_logs.rigid_alignment import Rigid

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Log:
    """Poses over time: `time` (n,) in s, strictly increasing; `x`, `y` (n,) in m; `heading` (n,) in
    rad, forward = (cos, sin); all finite. `source` names it in messages, `sha256` is its content's.
    `doubts` are sentences about what may be wrong with it.
    """

    time: Floats
    x: Floats
    y: Floats
    heading: Floats
    source: str
    sha256: str
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Commands:
    """What the robot was told: `time` (k,) in s, strictly increasing; each channel (k,) holds until
    the next time. `period` is the controller's, in s.
    """

    time: Floats
    channels: Mapping[str, Floats]
    period: float
    source: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Drive:
    """One command sequence driven in reality and in simulation.

    `untuned` is the simulator before any identification, the declared bad state. `odometry` is what
    moved a robot's odometry, that stands for the simulator, onto the ground truth.
    """

    name: str
    real: Log
    sim: Log
    untuned: Log | None = None
    commands: Commands | None = None
    odometry: Rigid | None = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """Those of its logs."""
        logs = (self.real, self.sim, self.untuned)
        return tuple(doubt for log in logs if log is not None for doubt in log.doubts)
