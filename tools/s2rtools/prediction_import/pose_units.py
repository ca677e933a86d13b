"""Units and heading conventions of imported poses: declared, or recognised from the values.

A convention is written as the formula of the map heading in degrees: `90-h` says that heading h of
the file is 90 - h degrees on the map, where heading 0 points along x and 90 degrees along y.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.records import Bounds

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres of a unit."""
ANGLES = {"rad": 1.0, "deg": math.pi / 180}
"""Radians of a unit."""
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds of a unit."""
CONVENTIONS: dict[str, tuple[int, int]] = {
    f"{offset}{'+' if sign > 0 else '-'}h": (offset, sign)
    for sign in (1, -1)
    for offset in (0, 90, 180, 270)
}
"""Offset in degrees and sign of each convention."""
NAMED = {"map": "0+h", "habitat": "270-h", "compass": "90-h"}
"""Other names of conventions."""
AUTO = "auto"
"""Requests the convention that fits the ground truth best."""
_FARTHEST = 2.0
"""Median distance from the centre of the bounds, in their diagonals, that is still plausible."""
_FULL_SHARE = 0.5
"""Share of headings beyond a turn from which they are taken for degrees."""
_FEWEST = 10
"""Rows that a comparison of conventions or units needs."""
_CLEAR_RATIO = 4
"""Ratio of median position errors by which a unit is clearly better than another."""
_CLEAR = math.radians(10)
"""Median heading error by which a convention is clearly better than another, radians."""


@dataclass(frozen=True, slots=True)
class Units:
    """Declared units; None where they are to be recognised. Times are in seconds by default."""

    length: str | None = None
    angle: str | None = None
    time: str = "s"


def parse_units(text: str) -> Units:
    """Units as `mm,deg`, in any order. Raises RequestError for unknown or repeated ones."""
    found: dict[str, str] = {}
    for name in (part.strip() for part in text.split(",") if part.strip()):
        kinds = {"length": LENGTHS, "angle": ANGLES, "time": TIMES}
        kind = next((kind for kind, known in kinds.items() if name in known), None)
        if kind is None:
            known = ", ".join((*LENGTHS, *ANGLES, *TIMES))
            raise RequestError(f"--units {name}: one of {known}, separated by commas")
        if kind in found:
            raise RequestError(f"--units {text}: {found[kind]} and {name}; name one {kind}")
        found[kind] = name
    return Units(found.get("length"), found.get("angle"), found.get("time", "s"))


def parse_convention(text: str) -> str:
    """A convention by its formula or name, or `AUTO`. Raises RequestError for others."""
    formula = NAMED.get(text, text.replace(" ", ""))
    if formula not in (AUTO, *CONVENTIONS):
        known = ", ".join((*CONVENTIONS, *NAMED, AUTO))
        raise RequestError(f"--heading {text}: one of {known}")
    return formula


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of a file by its `scale` to metres or radians."""

    name: str
    scale: float
    is_recognised: bool

    def __str__(self) -> str:
        return f"{self.name} (recognised)" if self.is_recognised else self.name


def length_unit(
    declared: str | None, positions: NDArray[np.float64], bounds: Bounds, where: str
) -> Unit:
    """The declared unit, or that in which finite `positions` (n, 2) lie around the map's bounds.

    The largest one is taken. Raises RequestError where none fits.
    """
    if declared is not None:
        return Unit(declared, LENGTHS[declared], False)
    centre = np.array([(bounds.x0 + bounds.x1) / 2, (bounds.y0 + bounds.y1) / 2])
    for name, metres in LENGTHS.items():
        away = np.hypot(*(positions * metres - centre).T)
        if np.median(away) <= _FARTHEST * bounds.diagonal:
            return Unit(name, metres, True)
    x, y = np.median(positions, axis=0)
    raise RequestError(
        f"{where}: positions around ({x:.6g}, {y:.6g}) are far off the map in m, cm and mm; "
        "declare --units, or bring them into the frame of the map"
    )


def length_warnings(
    positions: NDArray[np.float64],
    unit: str,
    truth: NDArray[np.float64],
    bounds: Bounds,
    where: str,
) -> tuple[str, ...]:
    """Whether positions lie far off the map, or another unit fits clearly better, in one line.

    `positions` (n, 2) are the numbers of the file, `truth` (n, 2) the true ones in metres. Far off
    is farther from the bounds than their diagonal. Clearly better is at most a quarter of the
    median error, in at least 10 rows.
    """
    errors = {
        name: float(np.median(np.hypot(*(positions * metres - truth).T)))
        for name, metres in LENGTHS.items()
    }
    far = int((_off_map(positions * LENGTHS[unit], bounds) > bounds.diagonal).sum())
    best = min(errors, key=errors.__getitem__)
    is_better = len(positions) >= _FEWEST and errors[best] * _CLEAR_RATIO <= errors[unit]
    if not far and not is_better:
        return ()
    text = f"{where}: positions in {unit}"
    if far:
        text += (
            f": {far} of {len(positions)} predictions lie more than {bounds.diagonal:.3g} m (the "
            "diagonal of the map) off the map"
        )
    if is_better:
        text += (
            f"{';' if far else ':'} the median position error is {errors[unit]:.3g} m, with "
            f"--units {best} it would be {errors[best]:.3g} m; add that if the file is so"
        )
    return (text,)


def _off_map(positions: NDArray[np.float64], bounds: Bounds) -> NDArray[np.float64]:
    """The distance of positions (n, 2) from the bounds, 0 inside; metres."""
    low, high = np.array([bounds.x0, bounds.y0]), np.array([bounds.x1, bounds.y1])
    outside = np.maximum(np.maximum(low - positions, positions - high), 0)
    return np.asarray(np.hypot(*outside.T))


def angle_unit(declared: str | None, headings: NDArray[np.float64], where: str) -> Unit:
    """The declared unit of finite `headings` (n,), or degrees where most are beyond 2 pi.

    Raises RequestError where only some are.
    """
    if declared is not None:
        return Unit(declared, ANGLES[declared], False)
    share = float(np.mean(np.abs(headings) > angles.TURN * (1 + 1e-6)))
    if share == 0:
        return Unit("rad", ANGLES["rad"], True)
    if share >= _FULL_SHARE:
        return Unit("deg", ANGLES["deg"], True)
    largest = float(np.abs(headings).max())
    raise RequestError(
        f"{where}: {share:.1%} of the headings are beyond a turn in radians (up to {largest:.6g}); "
        "declare --units rad or --units deg"
    )


def to_map(headings: NDArray[np.float64], convention: str) -> NDArray[np.float64]:
    """Map headings of headings in a convention, radians in [-pi, pi)."""
    offset, sign = CONVENTIONS[convention]
    return angles.wrap(math.radians(offset) + sign * headings)


def heading_errors(headings: NDArray[np.float64], truth: NDArray[np.float64]) -> dict[str, float]:
    """The median heading error, radians, that each convention gives for `headings` (n,)."""
    return {
        name: float(np.median(angles.distance(to_map(headings, name), truth)))
        for name in CONVENTIONS
    }


def best_convention(errors: Mapping[str, float], count: int, where: str) -> str:
    """The convention with the smallest error of `count` rows.

    Raises RequestError where no convention is clearly better than all others.
    """
    ordered = sorted(errors, key=errors.__getitem__)
    best, second = ordered[:2]
    if count >= _FEWEST and errors[second] - errors[best] > _CLEAR:
        return best
    listed = ", ".join(f"{name}: {math.degrees(errors[name]):.3g} deg" for name in ordered[:3])
    raise RequestError(
        f"{where}: --heading auto: no convention fits clearly better than all others ({listed}, "
        f"{count} rows); declare one"
    )


def convention_warnings(
    headings: NDArray[np.float64],
    unit: str,
    convention: str,
    truth: NDArray[np.float64],
    where: str,
) -> tuple[str, ...]:
    """Whether another unit or convention fits the true headings (n,) clearly better, in one line.

    `headings` (n,) are the numbers of the file. Clearly better is less than half the median error,
    by at least 10 degrees, in at least 10 rows.
    """
    if len(headings) < _FEWEST:
        return ()
    found = heading_errors(headings * ANGLES[unit], truth)
    now = found[convention]

    def is_better(error: float) -> bool:
        return error < now / 2 and now - error > _CLEAR

    other = next(name for name in ANGLES if name != unit)
    by_unit = heading_errors(headings * ANGLES[other], truth)[convention]
    best = min(found, key=found.__getitem__)
    if is_better(by_unit) and by_unit < found[best]:
        option, error = f"--units {other}", by_unit
    elif is_better(found[best]):
        option, error = f"--heading {best}", found[best]
    else:
        return ()
    return (
        f"{where}: the median heading error is {math.degrees(now):.3g} deg, with {option} it would "
        f"be {math.degrees(error):.3g} deg; add that if the file is so",
    )
