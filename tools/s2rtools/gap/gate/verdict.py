"""Reference and verdict of the gate: G of every axis, and whether all lie below the threshold.

G = 100 (m - floor) / (anchor - floor) puts all axes on one scale: 0 is no gap, 100 the declared bad
state. The numerator is measured; the denominator is that of the frozen reference, the scale (floor
and anchor) of every axis, so that G changes only with the gap. The headline is the axis with the
largest G. Each axis is tested by its own interval (`s2rstore.intervals.verdict.judge`).
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from s2rstore.errors import RequestError
from s2rstore.files.documents import MAX_JSON_BYTES, parse_json
from s2rstore.files.input_files import read_bytes
from s2rstore.intervals import Interval, simultaneous_level, verdict
from s2rstore.intervals.verdict import Bounds, Outcome
from s2rtools.common.typed_documents import convert
from s2rtools.gap.axes import AXES, THRESHOLD
from s2rtools.gap.axis import Anchor, AxisResult, GapSettings, Measurement

FORMAT = 2
_MIN_SPAN, _MAX_NUMBER = 1e-100, 1e100
"""Limits within which G can be computed."""
Number = Annotated[float, Meta(ge=-_MAX_NUMBER, le=_MAX_NUMBER)]
_HASH = re.compile("[0-9a-f]{64}")
NOTHING = Interval.unknown()
_REASONS: dict[Outcome, str] = {
    "PASS": "every axis is known to be below the threshold of {:g}",
    "FAIL": "{axes} known to be above the threshold of {:g}, corrected for the number of axes",
    "INCONCLUSIVE": "{axes} not known to be below the threshold of {:g}",
}


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


def freeze_scale(axis: str, measured: AxisResult, anchor: Anchor) -> AxisScale:
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


def reference_text(axes: Mapping[str, AxisScale], made_from: Mapping[str, Any]) -> str:
    """The content of a reference file."""
    content = {
        "format": FORMAT,
        "made_from": dict(made_from),
        "axes": {axis: msgspec.structs.asdict(scale) for axis, scale in axes.items()},
    }
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"


def read_reference(path: Path) -> Reference:
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


@dataclass(frozen=True, slots=True)
class Verdict:
    """G of the worst axis against the threshold; INCONCLUSIVE without axes to judge.

    `gaps` are G of all judged axes with their intervals, not clipped to 0 .. 100.
    """

    outcome: Outcome
    threshold: float
    worst: str | None
    gap: Interval
    gaps: Mapping[str, Interval]
    reason: str


def judge(
    measurement: Measurement,
    reference: Reference,
    settings: GapSettings,
    threshold: float = THRESHOLD,
) -> Verdict:
    """PASS where all axes are below the threshold, FAIL where any is above, each by its interval.

    An axis with too little evidence makes the verdict INCONCLUSIVE unless another axis fails.
    Raises RequestError where the reference does not fit the measurement.
    """
    quantities, inconclusive = _gaps(measurement, reference)
    if not quantities:
        return Verdict("INCONCLUSIVE", threshold, None, NOTHING, {}, "; ".join(inconclusive))
    gaps = {axis: bounds(settings.level) for axis, bounds in quantities.items()}
    worst = max(gaps, key=lambda axis: gaps[axis].value)
    found = verdict.judge(
        quantities, dict.fromkeys(quantities, threshold), settings.level, settings.fail_level
    )
    outcome = found.outcome
    reason = _REASONS[outcome].format(threshold, axes=", ".join(found.deciding))
    if outcome == "INCONCLUSIVE":
        reason += _only_at_level(gaps, threshold, settings)
    unjudged_axes = [axis for axis in measurement.measured if axis not in reference.axes]
    if unjudged_axes:
        reason += f"; measured but not judged by this reference: {', '.join(unjudged_axes)}"
    if inconclusive and outcome == "PASS":
        outcome, reason = "INCONCLUSIVE", "; ".join(inconclusive)
    return Verdict(outcome, threshold, worst, gaps[worst], gaps, reason)


def _only_at_level(gaps: Mapping[str, Interval], threshold: float, settings: GapSettings) -> str:
    """Which axes lie above the threshold by their printed intervals, but not by that of a FAIL."""
    above = [axis for axis, gap in gaps.items() if gap.low > threshold]
    if not above:
        return ""
    level = simultaneous_level(len(gaps), settings.fail_level or settings.level)
    return (
        f"; {', '.join(above)} above it at {100 * settings.level:g} %, not at {100 * level:.6g} %, "
        "the level of a FAIL"
    )


def _gaps(measurement: Measurement, reference: Reference) -> tuple[dict[str, Bounds], list[str]]:
    """G of every axis of the reference at any level, and the reasons of the inconclusive ones."""
    gaps: dict[str, Bounds] = {}
    inconclusive: list[str] = []
    for axis, scale in reference.axes.items():
        if axis in measurement.inconclusive:
            inconclusive.append(f"{axis}: {measurement.inconclusive[axis]}")
            continue
        if axis not in measurement.measured:
            reason = measurement.absent.get(axis, "it was not requested")
            raise RequestError(
                f"{reference.source}: judges {axis}, which cannot be measured here ({reason}); "
                "provide what is missing, or freeze a reference without this axis"
            )
        _check_fits(axis, measurement.measured[axis], scale, reference.source)
        gaps[axis] = _gap_bounds(measurement.measured[axis], scale)
    return gaps, inconclusive


def unjudged(threshold: float) -> Verdict:
    """The verdict without a reference."""
    reason = "no reference to judge by: `--freeze REF.json` writes one, `--reference` uses it"
    return Verdict("INCONCLUSIVE", threshold, None, NOTHING, {}, reason)


def _gap_bounds(measured: AxisResult, scale: AxisScale) -> Bounds:
    factor = 100 / (scale.anchor - scale.floor)
    return lambda level: measured.bounds(level).scaled(factor, -measured.floor)


def _check_fits(axis: str, measured: AxisResult, scale: AxisScale, source: str) -> None:
    for key in sorted({*measured.fingerprint, *scale.fingerprint}):
        here, there = measured.fingerprint.get(key), scale.fingerprint.get(key)
        if here != there:
            raise RequestError(
                f"{source}: does not fit: {axis}'s {key} is {_short(here)} here and "
                f"{_short(there)} in the reference; freeze a new reference for this measurement"
            )


def _short(value: object) -> str:
    """The first 12 digits of a hash, else the whole text."""
    text = str(value)
    return text[:12] if _HASH.fullmatch(text) else text
