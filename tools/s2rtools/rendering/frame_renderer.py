"""Interface of renderers that render a data set's frames with moved cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.reader import Store


class FrameRenderer(Protocol):
    """Renders the instances of one store, in the listed `domains`."""

    domains: tuple[str, ...]

    def frames(
        self, domain: str, start: int, stop: int, move: RigOffset
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        """RGB (n, H, W, 3) and raw depth (n, H, W) of iids [start, stop), as they are stored."""


@dataclass(frozen=True, slots=True)
class RendererKind:
    """A way to render: `claims(store)` is quick and says whether the store's data is of its kind.

    `open(store)` may take seconds; it raises RequestError where what it renders now would not be
    what the store holds. `version` changes whenever the frames of moved cameras would.
    """

    name: str
    version: int
    claims: Callable[[Store], bool]
    open: Callable[[Store], FrameRenderer]
