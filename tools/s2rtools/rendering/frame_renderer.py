"""Interface of renderers that render a data set's frames with moved cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.reader import Store


class FrameRenderer(Protocol):
    """Renders the instances of one store, in the listed `domains`."""

    domains: tuple[str, ...]

    def frames(
        self, domain: str, start: int, stop: int, move: RenderChange
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        """RGB (n, H, W, 3) and raw depth (n, H, W) of iids [start, stop), as they are stored."""

    def subsampled(
        self, domain: str, start: int, stop: int, move: RenderChange, stride: int
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        """Every `stride`-th row and column of such frames, in less time.

        Depth is that of `frames`; a colour may be that of the centre of its pixel.
        """


@dataclass(frozen=True, slots=True)
class RendererKind:
    """A way to render: `claims(store)` states quickly whether it supports the store's data.

    `open(store)` may take seconds; it raises RequestError where it would now render other frames
    than those of the store. `version` changes whenever the frames of moved cameras do.
    """

    name: str
    version: int
    claims: Callable[[Store], bool]
    open: Callable[[Store], FrameRenderer]
