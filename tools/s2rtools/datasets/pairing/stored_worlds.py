"""The worlds of the recordings of a store, in which further ones are placed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import TypeVar

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.documents import decode_json
from s2rstore.reader import Store
from s2rstore.records import SIDES, Bounds, Side
from s2rtools.datasets.floor.floor_alignment import FloorAlignment
from s2rtools.datasets.floor.floor_poses import StoredFloor
from s2rtools.datasets.recording import Recording

T = TypeVar("T")
_LARGEST_SPREAD = 100.0
"""Largest plausible `height_spread` in a store, metres."""
_LARGEST = 1e6
"""Largest scale, its inverse the smallest, and the largest number of a transform."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredWorlds:
    """The floors, the alignment and the map bounds of a store.

    `floors` has the sides that recordings were stored of. `alignment` maps the sim floor to the
    real one; None where none was fitted. `own_worlds` are the sides whose trajectories each have a
    world of their own, `with_depth` those with depth. `y_down`: y of the map is -y of the floors.
    """

    floors: Mapping[Side, StoredFloor]
    alignment: FloorAlignment | None
    own_worlds: frozenset[Side]
    with_depth: frozenset[Side]
    trajectories: frozenset[str]
    bounds: Bounds
    accuracy_scale: float
    y_down: bool = False

    def check(self, side: Side, recording: Recording, trajectories: set[str]) -> None:
        """Raise RequestError where a recording of a side has no place in the worlds of the store.

        `trajectories` are those that are continued or added.
        """
        has_own = recording.has_own_worlds or side in self.own_worlds
        if has_own and (added := sorted(trajectories - self.trajectories)):
            raise RequestError(
                f"{recording.name}: each {side} trajectory has a world of its own, so that "
                f"trajectory {added[0]} has no known place in the store; make a store of its own "
                "for it"
            )
        frames = (frame for t in recording.trajectories.values() for frame in t.frames)
        if side not in self.with_depth and any(frame.depth is not None for frame in frames):
            raise RequestError(
                f"{recording.name}: has depth, domain {side} of the store has none; make a store "
                "of its own for it"
            )


def stored_worlds(store: Store, needed: Sequence[Side] = SIDES) -> StoredWorlds:
    """The worlds of the recordings of a store.

    Raises RequestError where it has no recording of a `needed` side.
    """
    sides = [side for side in SIDES if side in store.domains and _recorded(store, side)]
    for side in needed:
        if side not in sides:
            raise RequestError(
                f"{store.path}: was not made by `s2r ingest pairs`; use the layout that made it, "
                "or make another store"
            )
    return StoredWorlds(
        {side: _floor(store, side) for side in sides},
        _alignment(store),
        frozenset(side for side in sides if _fact(store, side, "own_worlds", bool, False)),
        frozenset(side for side in SIDES if side in store.domains and store.domain(side).has_depth),
        frozenset(each.trajectory for each in store.trajectories),
        store.dataset.bounds,
        store.dataset.accuracy_scale,
        store.dataset.y_down,
    )


def _recorded(store: Store, side: Side) -> str | None:
    """The section of provenance with the facts of the first recording of a side."""
    sections = (f"recording:{side}", *(f"recording:{side}:{p.part}" for p in store.parts[1:]))
    return next((name for name in sections if "floor" in store.provenance(name)), None)


def _alignment(store: Store) -> FloorAlignment | None:
    text = store.provenance("pairs").get("alignment")
    if text is None:
        return None
    where = f"{store.path}: provenance of pairs: alignment"
    found = decode_json(text.encode(), FloorAlignment, where)
    numbers = np.array(astuple(found), dtype=np.float64)
    if not (np.abs(numbers) <= _LARGEST).all() or found.scale < 1 / _LARGEST:
        raise RequestError(f"{where}: no motion and scale; restore it")
    return found


def _floor(store: Store, side: Side) -> StoredFloor:
    where = f"{store.path}: provenance of {_recorded(store, side)}"
    matrix = np.zeros((4, 4))
    rows = _fact(store, side, "world_to_floor", list[list[float]], [])
    unit = _fact(store, side, "metres_per_unit", float, 0.0)
    if [len(row) for row in rows] == [4] * 4:
        matrix = np.array(rows)
    is_valid = 1 / _LARGEST <= unit <= _LARGEST and (np.abs(matrix) <= _LARGEST).all()
    turn = matrix[:3, :3] / unit if is_valid else np.zeros((3, 3))
    is_rotation = np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0
    if not is_rotation or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise RequestError(f"{where}: world_to_floor: no rotation and scale; restore it")
    domain = store.domain(side)
    spread = _fact(store, side, "height_spread", float, 0.0)
    tilt = _fact(store, side, "tilt_median", float, 0.0)
    if not (0 <= spread <= _LARGEST_SPREAD and 0 <= tilt <= math.pi):
        raise RequestError(f"{where}: implausible height_spread or tilt_median; restore it")
    return StoredFloor(matrix, unit, domain.camera_height, spread, domain.rgb.pitch, tilt)


def _fact(store: Store, side: Side, name: str, kind: type[T], default: T) -> T:
    """A fact of a side's recording; RequestError where it is of another type."""
    section = _recorded(store, side) or ""
    text = store.provenance(section).get(name)
    if text is None:
        return default
    return decode_json(text.encode(), kind, f"{store.path}: provenance of {section}: {name}")
