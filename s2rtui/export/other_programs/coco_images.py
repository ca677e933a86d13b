"""Images with COCO annotations of the objects that their label images show."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.export.other_programs.content import ExportContent, png_bytes


def write(content: ExportContent, path: Path) -> None:
    """Write `SIDE/IID.png` and `annotations.json`, whose images have the facts of their instance.

    Masks are uncompressed run lengths. Without label images there are no annotations.
    """
    store = content.store
    classes = list(dict.fromkeys(store.label_names.values()))
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for side in content.domains:
        (path / side).mkdir()
        for frame in content.frames(side):
            name, number = f"{side}/{frame.iid:06d}.png", len(images) + 1
            (path / name).write_bytes(png_bytes(frame.rgb))
            height, width = frame.rgb.shape[:2]
            images.append({"id": number, "file_name": name, "width": width, "height": height,
                           "side": side, **content.facts(frame.iid)})  # fmt: skip
            domain = content.domains[side].domain
            if domain in store.label_keys:
                shown = store.label_images(domain, frame.iid, frame.iid + 1)[0]
                for label, mask in _masks(shown):
                    annotations.append({
                        "id": len(annotations) + 1, "image_id": number, "iscrowd": 1,
                        "category_id": 1 + classes.index(store.label_names[label]),
                        **_geometry(mask),
                    })  # fmt: skip
    categories = [{"id": place, "name": name} for place, name in enumerate(classes, start=1)]
    content_of_file = {"info": {"description": store.dataset.name, "run": content.run},
                       "images": images, "annotations": annotations,
                       "categories": categories}  # fmt: skip
    (path / "annotations.json").write_text(json.dumps(content_of_file), encoding="utf-8")


def _masks(shown: NDArray[np.uint16]) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    for label in np.unique(shown[shown > 0]).tolist():
        yield label, shown == label


def _geometry(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Run lengths, from left to right and in each column downwards, area and box of a mask."""
    flat = mask.ravel(order="F")
    ends = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff([0, *ends, flat.size]).tolist()
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    x, y = int(columns[0]), int(rows[0])
    box = [x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y]
    return {
        "segmentation": {"size": list(mask.shape), "counts": [0, *counts] if flat[0] else counts},
        "area": int(mask.sum()), "bbox": box,
    }  # fmt: skip
