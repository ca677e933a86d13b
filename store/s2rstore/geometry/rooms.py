"""Which room a point lies in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Room

NO_ROOM = "no room"
"""What views call the instances outside all rooms."""


def room_codes(
    x: NDArray[np.float64], y: NDArray[np.float64], rooms: Sequence[Room], names: Sequence[str]
) -> NDArray[np.int32]:
    """Index into `names` of each point's room, -1 for none; shape (n,).

    Edges belong to the room. A point in several rectangles belongs to the first by position. NaN
    lies in no room.
    """
    codes = np.full(x.shape, -1, dtype=np.int32)
    for room in sorted(rooms, key=lambda room: -room.position):  # the first by position is last
        inside = (x >= room.x0) & (x <= room.x1) & (y >= room.y0) & (y <= room.y1)
        np.copyto(codes, names.index(room.room), where=inside)
    return codes
