"""Tuned ranges as YAML, in the layout of Duckietown's line detector, and as a JSON document."""

from __future__ import annotations

from typing import Any

from s2rtools.lane_detection.line_detector import COLOURS, DEFAULT_THRESHOLDS
from s2rtools.lane_detection.threshold_tuning import Tuning


def tuning_document(tuning: Tuning) -> dict[str, Any]:
    """Ranges, F1 on the images of the tuning and widths of the plateaus."""
    ranges = {
        colour: {
            "low": list(of.range.low), "high": list(of.range.high), "f1": round(of.f1, 4),
            "plateau": {axis: list(widths) for axis, widths in of.plateau.items()},
        }
        for colour, of in tuning.ranges.items()
    }  # fmt: skip
    return {"images": tuning.images, "ranges": ranges, "untuned": list(tuning.untuned)}


def tuning_yaml(tuning: Tuning) -> str:
    """The `colors` parameter of the line detector; a hue range over 180 becomes two ranges."""
    lines = [f"# tuned on {tuning.images} images; hue 0 .. 180, saturation and value 0 .. 255"]
    lines.append("colors:")
    for colour in COLOURS:
        lines.append(f"  {colour.upper()}:")
        if colour in tuning.ranges:
            of = tuning.ranges[colour]
            widths = "; ".join(f"{axis} {low}, {high}" for axis, (low, high) in of.plateau.items())
            lines.append(f"    # F1 {of.f1:.3f}; plateau of the lower and upper bounds: {widths}")
        else:
            lines.append("    # default: no labelled pixels")
        boxes = tuning.thresholds[colour].boxes()
        numbered = len(boxes) > 1 or len(DEFAULT_THRESHOLDS[colour].boxes()) > 1
        for number, (low, high) in enumerate(boxes, start=1):
            suffix = f"_{number}" if numbered else ""
            lines.append(f"    low{suffix}: {list(low)}")
            lines.append(f"    high{suffix}: {list(high)}")
    return "\n".join(lines) + "\n"
