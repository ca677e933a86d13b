"""How two recordings were paired, as the store records it and the user reads it."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.floor.floor_alignment import FloorAlignment
from s2rtools.datasets.pairing.pair_matching import PoseTolerance
from s2rtools.datasets.pairing.recording_pairs import Match, Pairing, RecordedSide

_FAR, _TURNED = 1.0, 20.0
"""Metres and degrees between the poses of pairs, in the median, that are reported."""


def provenance(
    sim: RecordedSide,
    real: RecordedSide,
    pairing: Pairing,
    how: tuple[Match, PoseTolerance | float | None],
    alignment: FloorAlignment | None,
) -> dict[str, dict[str, Any]]:
    """Facts for the provenance, by section: how images were paired, and of both recordings.

    `how` are the values of `--match` and of `--tolerance`.
    """
    match, tolerance = how
    facts: dict[str, Any] = {
        "match": match,
        "pairs": int(pairing.sim.size),
        "images": {side.side: len(side) for side in (sim, real)},
        "offsets": _offsets(pairing),
    }
    if isinstance(tolerance, PoseTolerance):
        facts["tolerance"] = {"m": tolerance.distance, "degrees": math.degrees(tolerance.angle)}
        facts["cost"] = f"metres + {tolerance.metres_per_radian:.6g} * angle in radians"
    elif tolerance is not None:
        facts["tolerance"] = {"s": tolerance}
        facts["cost"] = "seconds"
    if alignment is not None:
        facts["alignment"] = asdict(alignment)
    return {"pairs": facts, **recording_facts(sim), **recording_facts(real)}


def recording_facts(side: RecordedSide) -> dict[str, dict[str, Any]]:
    """Facts of a recording for the provenance, by section."""
    recording = side.recording
    facts = {
        **{str(key): value for key, value in recording.provenance.items()},
        "layout": recording.layout,
        "camera": asdict(recording.camera),
        "floor": list(side.floor.report),
        "metres_per_unit": side.floor.metres_per_unit,
        "world_to_floor": side.floor.world_to_floor.tolist(),
        "height_spread": side.floor.height_spread,
        "tilt_median": side.floor.tilt_median,
        "own_worlds": recording.has_own_worlds,
    }
    return {f"recording:{side.side}": facts}


def _offsets(pairing: Pairing) -> dict[str, list[float]]:
    """Median and 95th percentile of the offsets in metres, degrees and seconds where known."""
    columns = {"m": pairing.metres, "degrees": pairing.degrees, "s": pairing.seconds}
    return {
        unit: [round(float(value), 6) for value in np.percentile(known, [50, 95])]
        for unit, known in ((unit, _finite(each)) for unit, each in columns.items())
        if known.size
    }


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return values[np.isfinite(values)]


def summary(
    sim: RecordedSide,
    real: RecordedSide,
    pairing: Pairing,
    match: Match,
    alignment: FloorAlignment | None,
    is_stored: bool,
) -> list[str]:
    """Lines for the user: the floors, the alignment, and the offsets of the pairs.

    An alignment that `is_stored` was fitted to other pairs.
    """
    lines = [f"{side.side} floor: {line}" for side in (sim, real) for line in side.floor.report]
    if alignment is not None:
        how = f"as in the store, {alignment.motion}" if is_stored else alignment.text
        lines.append(f"sim floor {how}")
    offsets = _offsets(pairing)
    units = ["m", "degrees", *(["s"] if match == "time" else [])]
    median, high = (
        ", ".join(f"{offsets[unit][n]:.3g} {unit}" for unit in units if unit in offsets)
        for n in (0, 1)
    )
    lines.append(
        f"pairs: {pairing.sim.size} of {len(sim)} sim and {len(real)} real images; offset "
        f"{median} in the median, {high} at the 95th percentile"
    )
    return lines


def far_apart(real: RecordedSide, pairing: Pairing, is_stored: bool) -> list[InputIssue]:
    """An issue where pairs of times or names do not seem to lie in the same world."""
    metres, degrees = (
        float(np.median(known)) if (known := _finite(each)).size else 0.0
        for each in (pairing.metres, pairing.degrees)
    )
    if metres <= _FAR and degrees <= _TURNED:
        return []
    advice = "the worlds may be others than those of the store" if is_stored else (
        "the worlds may differ, and --align fits one to the other"
    )  # fmt: skip
    detail = f"{metres:.3g} m and {degrees:.3g} degrees in the median; {advice}"
    return [InputIssue("poses of pairs far apart", real.recording.name, detail)]
