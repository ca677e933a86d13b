"""Compare a scan with the store to which it is to be appended.

What decides on the meaning of stored values must agree: frame size, map frame, accuracy scale,
domains with their cameras, and the recipe of rendered data. The source may lack domains of the
store and have others: an instance has images in the domains of its source alone.
Bounds, rooms and floor plan stay those of the store; others in the source are reported.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any

import cv2

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Bounds, Domain
from s2rstore.security.printable_text import printable_lines
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.floor.floor_plans import read_floor_plan
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing.build import floor_plan_image

_RELATIVE_TOLERANCE = 1e-9
_ABSOLUTE_TOLERANCE = 1e-9
_MAX_PLAN_DIFFERENCE = 2.0
"""Mean difference in grey levels of two floor plans that count as equal."""


def in_store_terms(scan: Scan, store: Store) -> Scan:
    """The scan with bounds, rooms and domains of the store, and without floor plan and drives.

    Domains that the store does not have are kept. Both share the list of issues, to which other
    bounds, rooms and floor plans are added. Raises RequestError that names the first difference in
    what must agree.
    """
    for name, in_source, in_store in _differences(scan, store):
        raise RequestError(
            f"{store.path}: the source has another {name}: {in_source}, the store {in_store}; "
            "only data that agree can be appended"
        )
    _report_other_map(scan, store)
    rooms = tuple(replace(room, room=store.stored_rooms[room.room]) for room in store.rooms)
    domains = {name: (scan.domains | store.domains)[name] for name in sorted(scan.domains)}
    return replace(
        scan, bounds=store.dataset.bounds, rooms=rooms, domains=domains,
        accuracy_scale=store.dataset.accuracy_scale, floor_plan=None, drives=None,
    )  # fmt: skip


def _differences(scan: Scan, store: Store) -> Iterator[tuple[str, object, object]]:
    """What differs, with the values in the source and in the store."""
    dataset = store.dataset
    if scan.has_poses != dataset.has_poses:
        names = {True: "images with poses", False: "images without poses"}
        yield "kind of data", names[scan.has_poses], names[dataset.has_poses]
    (height, width), (rows, columns) = scan.frame, (dataset.frame_height, dataset.frame_width)
    if (height, width) != (rows, columns):
        yield "frame size (--size)", f"{width}x{height}", f"{columns}x{rows}"
    if scan.y_down != dataset.y_down:
        yield "y_down", scan.y_down, dataset.y_down
    is_stated = not scan.has_default_scale
    if is_stated and not is_close(scan.accuracy_scale, dataset.accuracy_scale):
        yield "accuracy_scale", f"{scan.accuracy_scale:g} m", f"{dataset.accuracy_scale:g} m"
    for name, domain in scan.domains.items():
        if name not in store.domains:
            continue
        other = _domain_facts(store.domains[name])
        for fact, value in _domain_facts(domain).items():
            if not is_close(value, other[fact]):
                yield f"{fact} of domain {name}", value, other[fact]
    for section, facts in scan.provenance.items():
        recorded = store.provenance(section)
        for key, value in facts.items():
            text = value if isinstance(value, str) else _json(value)
            if not _is_same_text(printable_lines(text), recorded.get(key)):
                yield f"{key} of {section}", _short(text), _short(recorded.get(key))


def _domain_facts(domain: Domain) -> dict[str, Any]:
    """Kind, cameras and depth of a domain by the names of their columns in the index."""
    facts: dict[str, Any] = {"kind": domain.kind, "has_depth": domain.has_depth}
    for image in ("rgb", "depth"):
        facts |= {f"{image}_{name}": v for name, v in asdict(getattr(domain, image)).items()}
    names = ("camera_height", "forward_offset", "depth_scale", "depth_raw_min", "depth_raw_max")
    return facts | {name: getattr(domain, name) for name in names}


def is_close(a: Any, b: Any) -> bool:
    """Whether two values are equal, numbers up to float rounding, NaN to NaN."""
    if not (isinstance(a, int | float) and isinstance(b, int | float)):
        return bool(a == b)
    if math.isnan(a) or math.isnan(b):
        return math.isnan(a) and math.isnan(b)
    return math.isclose(a, b, rel_tol=_RELATIVE_TOLERANCE, abs_tol=_ABSOLUTE_TOLERANCE)


def _json(value: Any) -> str:
    return json.dumps(value, default=lambda number: number.tolist())


def _is_same_text(text: str, recorded: str | None) -> bool:
    """Whether two texts are equal, or are JSON of equal values."""
    if recorded is None or text == recorded:
        return text == recorded
    try:
        return bool(json.loads(text) == json.loads(recorded))
    except ValueError:
        return False


def _short(text: str | None) -> str:
    return "none" if text is None else text if len(text) <= 60 else f"{text[:57]}..."


def _report_other_map(scan: Scan, store: Store) -> None:
    """Add issues for bounds, rectangles of rooms and a floor plan that differ from the store's."""
    if not scan.has_poses:
        return
    if not all(map(is_close, _edges(scan.bounds), _edges(store.dataset.bounds))):
        _report_kept(scan, "bounds")
    rooms, kept = ([_edges(room) for room in each] for each in (scan.rooms, store.rooms))
    same = len(rooms) == len(kept) and all(
        is_close(a, b) for one, other in zip(rooms, kept, strict=True)
        for a, b in zip(one, other, strict=True)
    )  # fmt: skip
    if rooms and not same:  # names may have been changed by `s2r rooms`
        _report_kept(scan, "rooms")
    thresholds = scan.recall_thresholds or store.dataset.recall_thresholds
    if thresholds != store.dataset.recall_thresholds:
        _report_kept(scan, "recall thresholds")
    plan = floor_plan_image(scan)
    if plan is None:
        return
    path = store.floor_plan_path()
    stored = None if path is None else read_floor_plan(path)
    if (
        stored is None
        or stored.shape != plan.shape
        or cv2.absdiff(stored, plan).mean() > _MAX_PLAN_DIFFERENCE
    ):
        _report_kept(scan, "floor plan")


def _edges(area: Any) -> tuple[float, float, float, float]:
    edges = Bounds(area.x0, area.y0, area.x1, area.y1)
    return edges.x0, edges.y0, edges.x1, edges.y1


def _report_kept(scan: Scan, what: str) -> None:
    scan.issues.append(InputIssue(f"other {what}", scan.name, f"the store keeps its {what}"))
