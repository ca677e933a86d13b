"""Similarity of poses: how much an image at one pose says about the error at another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Poses = NDArray[np.float64]
"""(n, 3): x, y in metres, heading in radians."""
Floats = NDArray[np.float64]
Codes = NDArray[np.int32]

CUTOFF = 3.0
"""Distance, in units of `reach`, beyond which the similarity is 0."""


@dataclass(frozen=True, slots=True)
class PoseSimilarity:
    """Product of three factors in [0, 1]; equal poses have similarity 1.

    A Gaussian of the distance with standard deviation `reach` (metres), exp((cos a - 1) / w^2) of
    the angle a between the headings with w = `width` (radians), which is nearly a Gaussian of that
    deviation, and `through_walls` for poses in different rooms.
    """

    reach: float = 1.5
    width: float = 0.8
    through_walls: float = 0.25

    def of_places(
        self, first: Floats, first_rooms: Codes, second: Floats, second_rooms: Codes
    ) -> Floats:
        """Similarity (n, m) of positions (n, 2) and (m, 2) with rooms (n,) and (m,)."""
        square = (
            np.square(first[:, 0][:, None] - second[:, 0])
            + np.square(first[:, 1][:, None] - second[:, 1])
        ) / self.reach**2  # fmt: skip
        near = np.where(square <= CUTOFF**2, np.exp(-square / 2), 0.0)
        same_room = first_rooms[:, None] == second_rooms
        return np.where(same_room, near, self.through_walls * near)

    def of_headings(self, first: Floats, second: Floats) -> Floats:
        """Similarity (n, m) of headings (n,) and (m,), radians."""
        return np.exp((np.cos(first[:, None] - second) - 1) / self.width**2)

    def of_poses(
        self, first: Poses, first_rooms: Codes, second: Poses, second_rooms: Codes
    ) -> Floats:
        """Similarity (n, m) of poses (n, 3) and (m, 3) with rooms (n,) and (m,)."""
        places = self.of_places(first[:, :2], first_rooms, second[:, :2], second_rooms)
        return places * self.of_headings(first[:, 2], second[:, 2])
