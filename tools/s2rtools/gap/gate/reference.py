"""The frozen scale of a gate: floor and anchor of every axis, and how they were measured."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files.input_files import MOST_JSON, parse_json, read_bytes
from s2rstore.metrics.bootstrap import percentile_bounds
from s2rtools.gap.axis_result import Anchor, AxisResult, GapSettings

FORMAT = 2


@dataclass(frozen=True, slots=True)
class Frozen:
    """One axis' scale in its own unit; the bounds tell how well the anchor was known."""

    anchor: float
    anchor_low: float
    anchor_high: float
    floor: float
    state: str
    fingerprint: Mapping[str, str | int | float]


_KEYS = {each.name for each in fields(Frozen)}
_NUMBERS = ("anchor", "anchor_low", "anchor_high", "floor")
_LEAST, _MOST = 1e-100, 1e100
"""Of a scale: beyond them G is not to be computed."""


@dataclass(frozen=True, slots=True)
class Reference:
    """A reference file; `source` names it in messages, `sha256` is its content's.

    `made_from` tells data set, run, model and selection, for people.
    """

    axes: Mapping[str, Frozen]
    made_from: Mapping[str, Any]
    source: str
    sha256: str


def freeze(measured: AxisResult, anchor: Anchor, unit: str, settings: GapSettings) -> Frozen:
    """An axis' scale; raises RequestError where the anchor is within the floor's noise.

    The noise is that of their difference, because a resample moves both.
    """
    span = anchor.value - measured.floor
    low, _ = percentile_bounds(anchor.replicates - measured.floor_replicates, settings.level)
    if not (math.isfinite(span) and span > 0 and low > 0):
        raise RequestError(
            f"{measured.axis}: the anchor ({anchor.state}: {anchor.value:.3g} {unit}) is within "
            f"noise of the floor ({measured.floor:.3g} {unit}), so it is no scale; declare a worse "
            "state (--anchor-run, untuned logs), or name only the other axes (--axis)"
        )
    least, most = percentile_bounds(anchor.replicates, settings.level)
    return Frozen(
        anchor.value, least, most, measured.floor, anchor.state, dict(measured.fingerprint)
    )


def text(axes: Mapping[str, Frozen], made_from: Mapping[str, Any]) -> str:
    """The file of a reference."""
    content = {
        "format": FORMAT,
        "made_from": dict(made_from),
        "axes": {axis: asdict(frozen) for axis, frozen in axes.items()},
    }
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"


def read(path: Path) -> Reference:
    """Raises RequestError where the file is missing, no reference, or of another format."""
    raw = read_bytes(path, MOST_JSON)
    content = parse_json(raw, str(path))
    if not isinstance(content, dict) or not isinstance(content.get("axes"), dict):
        raise RequestError(f"{path}: no reference of a gap; `s2r gap --freeze` writes one")
    if content.get("format") != FORMAT:
        told = f"format {content.get('format')}, this version reads {FORMAT}"
        raise RequestError(f"{path}: {told}; freeze it anew")
    if not content["axes"]:
        raise RequestError(f"{path}: no axis to judge by; freeze it anew")
    axes = {axis: _frozen(path, axis, found) for axis, found in content["axes"].items()}
    made_from = content.get("made_from")
    if not isinstance(made_from, dict):
        raise RequestError(f"{path}: made_from must be an object; freeze it anew")
    return Reference(axes, made_from, str(path), hashlib.sha256(raw).hexdigest())


def _frozen(path: Path, axis: str, found: object) -> Frozen:
    if not isinstance(found, dict) or set(found) != _KEYS:
        told = sorted(_KEYS ^ set(found)) if isinstance(found, dict) else "no object"
        raise RequestError(f"{path}: {axis}: {told}; freeze the reference anew")
    if not all(_is_number(found[key]) for key in _NUMBERS):
        told = f"must be numbers up to {_MOST:g}"
        raise RequestError(f"{path}: {axis}: {', '.join(_NUMBERS)} {told}; freeze it anew")
    if not min(found["anchor"], found["anchor_low"]) - found["floor"] > _LEAST:
        raise RequestError(
            f"{path}: {axis}: the anchor is within noise of the floor; freeze it anew"
        )
    if not isinstance(found["state"], str):
        raise RequestError(f"{path}: {axis}: state must be text; freeze it anew")
    if not isinstance(found["fingerprint"], dict):
        raise RequestError(f"{path}: {axis}: fingerprint must be an object")
    return Frozen(**found)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST
