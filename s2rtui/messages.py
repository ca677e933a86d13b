"""What workers tell the application."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from textual.message import Message

from s2rtui.plots import InstanceInput


@dataclass
class PicturesReady(Message):
    """Pictures and heat of one instance; `ticket` numbers the request, the newest one counts."""

    ticket: int
    instance: InstanceInput | None
    heat: NDArray[np.float32] | None
    error: str = ""


@dataclass
class FloorPlanReady(Message):
    """The floor plan, decoded."""

    picture: NDArray[np.uint8]
