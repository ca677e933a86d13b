"""The worlds of a store that was made of two recordings, in which further ones are placed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.input_files import decode_json
from s2rstore.reader import Store
from s2rstore.records import SIDES, Bounds, Side
from s2rtools.datasets.floor.floor_alignment import FloorAlignment
from s2rtools.datasets.floor.floor_poses import StoredFloor


@dataclass(frozen=True, slots=True, eq=False)
class StoredWorlds:
    """The floors of both sides, the alignment of the sim floor to the real one if there is one,
    and the map of the store."""

    floors: Mapping[Side, StoredFloor]
    alignment: FloorAlignment | None
    bounds: Bounds
    accuracy_scale: float


def stored_worlds(store: Store) -> StoredWorlds:
    """The worlds of a store that `s2r ingest pairs` made. Raises RequestError for any other."""
    text, where = store.provenance("pairs").get("alignment"), f"{store.path}: provenance of pairs"
    alignment = None if text is None else decode_json(text.encode(), FloorAlignment, where)
    floors = {side: _floor(store, side) for side in SIDES}
    return StoredWorlds(floors, alignment, store.dataset.bounds, store.dataset.accuracy_scale)


def _floor(store: Store, side: Side) -> StoredFloor:
    facts = store.provenance(f"recording:{side}")
    if side not in store.domains or "world_to_floor" not in facts:
        raise RequestError(
            f"{store.path}: was not made by `s2r ingest pairs`, which appends to its own stores"
        )
    where = f"{store.path}: provenance of recording:{side}"
    rows = decode_json(facts["world_to_floor"].encode(), list[list[float]], where)
    unit = decode_json(facts.get("metres_per_unit", "1.0").encode(), float, where)
    if list(map(len, rows)) != [4] * 4:
        raise RequestError(f"{where}: no matrix of 4 x 4 numbers; restore it")
    matrix = np.array(rows)
    turn = matrix[:3, :3] / unit if unit > 0 else np.zeros((3, 3))
    if not np.isfinite(matrix).all() or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
        raise RequestError(f"{where}: no rotation and scale; restore it")
    domain = store.domain(side)
    return StoredFloor(matrix, unit, domain.camera_height, domain.rgb.pitch)
