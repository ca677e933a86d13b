"""The mark of a class of labelled objects: pixels of an image, and their place on the map."""

from __future__ import annotations

from typing import Any

import numpy as np

from s2rstore.geometry import camera
from s2rstore.reader import Store
from s2rstore.records import Side


def object_mark(store: Store, run: str, side: Side, iid: int, label: str) -> dict[str, Any]:
    """The pixels of a class of objects in an image, and the middle of them on the map.

    Both cameras of the domain are taken for the same, as far as the place is concerned.
    """
    name = store.displayed_run(run).domain(side)
    if not name or not store.has_frames(name) or not store.is_imaged(name, iid):
        return {}
    values = [value for value, each in store.label_names.items() if each == label]
    marked = np.isin(store.label_images(name, iid, iid + 1)[0], values)
    if not marked.any():
        return {}
    domain = store.domain(name)
    if not domain.has_depth:
        return {"marked": marked}
    depth = store.frames(name, iid, iid + 1, ("depth",))["depth"]
    known = (depth[0] >= domain.depth_raw_min) & (depth[0] <= domain.depth_raw_max) & marked
    if not known.any():
        return {"marked": marked}
    rows, columns = (np.arange(size, dtype=np.float64) + 0.5 for size in marked.shape)
    x, y, _ = camera.to_floor(
        camera.rays(domain.depth, rows, columns), depth * np.float64(domain.depth_scale), domain,
        store.poses(name)[iid : iid + 1], store.dataset.y_down,
    )  # fmt: skip
    place = float(np.median(x[0][known])), float(np.median(y[0][known]))
    return {"marked": marked, "place": place}


def mark_note(label: str | None, marks: dict[Side, dict[str, Any]]) -> list[tuple[str, str]]:
    """Where a class of objects is marked; nothing without one."""
    if label is None:
        return []
    found = [side for side, mark in marks.items() if mark]
    return [("marked", f"{label} in {' and '.join(found) or 'neither image'} (escape: no mark)")]
