"""Reference of a gate: the frozen scale (floor and anchor) of every axis."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from s2rstore.errors import RequestError
from s2rstore.files.input_files import MAX_JSON_BYTES, parse_json, read_bytes
from s2rtools.common.documents import convert
from s2rtools.gap.axes import AXES
from s2rtools.gap.axis import Anchor, AxisResult

FORMAT = 2
_MIN_SPAN, _MAX_NUMBER = 1e-100, 1e100
"""Limits within which G can be computed."""
Number = Annotated[float, Meta(ge=-_MAX_NUMBER, le=_MAX_NUMBER)]


class AxisScale(Struct, frozen=True, forbid_unknown_fields=True):
    """Scale of one axis in its unit; the bounds are the confidence interval of the anchor."""

    anchor: Number
    anchor_low: Number
    anchor_high: Number
    floor: Number
    state: str
    fingerprint: dict[str, str | int | float]


class Reference(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The JSON file of a reference; `source` and `sha256` are those of the file that was read.

    `made_from` describes data set, run, model and selection, for the reader.
    """

    format: int = FORMAT
    axes: dict[str, AxisScale]
    made_from: dict[str, Any]
    source: str = ""
    sha256: str = ""


def freeze(axis: str, measured: AxisResult, anchor: Anchor) -> AxisScale:
    """Scale of a measured axis.

    Raises RequestError where the anchor is within its noise of the floor, or has no interval.
    """
    bad, unit = anchor.interval, AXES[axis].unit
    if not bad.low > measured.floor:
        why = f"is within noise of the floor ({measured.floor:.3g} {unit})"
        if not bad.is_known:
            why = f"has {bad.bounds_text()}"
        raise RequestError(
            f"{axis}: the anchor ({anchor.state}: {bad.value:.3g} {unit}) {why} and gives "
            "no scale; declare a worse state (--anchor-run, untuned logs), or leave this axis out "
            "(name the others by --axis)"
        )
    return AxisScale(bad.value, bad.low, bad.high, measured.floor, anchor.state,
                     dict(measured.fingerprint))  # fmt: skip


def text(axes: Mapping[str, AxisScale], made_from: Mapping[str, Any]) -> str:
    """The content of a reference file."""
    content = {
        "format": FORMAT,
        "made_from": dict(made_from),
        "axes": {axis: msgspec.structs.asdict(scale) for axis, scale in axes.items()},
    }
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"


def read(path: Path) -> Reference:
    """Read a reference. Raises RequestError where it is missing, invalid, or of another format."""
    raw = read_bytes(path, MAX_JSON_BYTES)
    content = parse_json(raw, str(path))
    if not isinstance(content, dict) or "axes" not in content:
        raise RequestError(f"{path}: not a gap reference; `s2r gap --freeze` writes one")
    if content.get("format") != FORMAT:
        raise RequestError(
            f"{path}: format {content.get('format')}, this version reads {FORMAT}; freeze a new "
            "reference"
        )
    found = {"source": str(path), "sha256": hashlib.sha256(raw).hexdigest()}
    file = convert(content | found, Reference, str(path), check=False)
    if not file.axes:
        raise RequestError(f"{path}: axes: empty; freeze a new reference")
    for axis, scale in file.axes.items():
        if not min(scale.anchor, scale.anchor_low) - scale.floor > _MIN_SPAN:
            raise RequestError(
                f"{path}: axes.{axis}: the anchor is within noise of the floor; freeze a new "
                "reference"
            )
    return file
