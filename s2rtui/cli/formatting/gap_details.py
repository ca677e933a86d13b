"""What a gap's axes found besides m, in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from s2rtui.cli.formatting import rows as output

Details = dict[str, Any]
_DIMENSIONS = 3
_SCALES = {
    "travel": "the distance driven in the horizon, on average",
    "extent": "the diagonal of the path's box",
    "deviation": "the standard deviation of the places",
}


def details(axis: dict[str, Any]) -> Iterator[str]:
    """Lines and tables of one axis; nothing for an axis that has none."""
    told = _TOLD.get(axis["axis"])
    if told is not None:
        yield from told(axis["details"])


def bounds(row: dict[str, Any], name: str, digits: int = 3) -> str:
    """A figure with its interval, by its keys."""
    return between(row.get(name), row.get(f"{name}_low"), row.get(f"{name}_high"), digits)


def between(value: float | None, low: float | None, high: float | None, digits: int) -> str:
    """A figure with its interval; - where it is unknown."""
    if value is None:
        return "-"
    ends = " .. ".join("?" if end is None else f"{end:.{digits}f}" for end in (low, high))
    return f"{value:.{digits}f} ({ends})"


def _visual(found: Details) -> Iterator[str]:
    halves = found["halves"]
    rows = [
        (name, row["value"], _floor(row))
        for name, row in halves.items()
        if isinstance(row, dict) and "floor_low" in row
    ]
    yield f"permutation p of the kernel distance: {found['kid_p']:.3g}"
    names = ("figure", "sim and real", "real and real")
    yield f"of halves, n = {halves['n']}:\n" + output.table(names, rows)
    columns = halves["wasserstein_by_dimension"]
    largest = sorted(
        zip(columns["value"], columns["floor"], columns["dimension"], strict=True), reverse=True
    )[:_DIMENSIONS]
    yield f"Wasserstein-1 of single features, the largest of {len(columns['value'])}:\n" + (
        output.table(
            ("dimension", "sim and real", "real and real"),
            [(dimension, value, floor) for value, floor, dimension in largest],
        )
    )


def _floor(row: Details) -> str:
    """Four digits of each, because features may be of any size."""
    value, low, high = (
        "-" if row[key] is None else f"{row[key]:.4g}"
        for key in ("floor", "floor_low", "floor_high")
    )
    return f"{value} ({low} .. {high})"


def _task(found: Details) -> Iterator[str]:
    drop = found["relative_drop"]
    yield (
        f"mean error {found['sim']:.2f} m in simulation, {found['real']:.2f} m in reality, "
        f"{found['baseline']:.2f} m for the constant prediction; relative drop "
        f"{between(drop['value'], drop['low'], drop['high'], 2)}"
    )
    low, high = found["no_gap_interval"]
    yield f"mean gap if sim and real changed places at random: {low:.3f} .. {high:.3f} m"
    for kind in ("runs", "trajectories", "rooms", "headings"):
        groups = found[kind].items()
        if len(groups) < 2:
            continue
        by_gap = sorted(groups, key=lambda item: -item[1]["gap"]["value"])
        rows = [
            (name, row["n"], row["sim"], row["real"], row["baseline"],
             between(*_three(row["gap"]), 2), between(*_three(row["relative_drop"]), 2))
            for name, row in by_gap
        ]  # fmt: skip
        names = (kind, "n", "sim m", "real m", "constant m", "gap m", "relative drop")
        yield output.table(names, rows)


def _dynamics(found: Details) -> Iterator[str]:
    rows = [
        (f"{row['horizon']:g} s", row["windows"], bounds(row, "rmse"), bounds(row, "nrmse"),
         _degrees(row, "heading_rmse"))
        for row in found["horizons"]
    ]  # fmt: skip
    yield f"NRMSE is RMSE over {_SCALES[found['scale']]}"
    yield output.table(("horizon", "windows", "RMSE m", "NRMSE", "heading degrees"), rows)
    yield (
        f"whole drives, the delay (searched within {found['reach']:g} s) taken out; alignment "
        f"before APE and RPE: {found['alignment']}; RPE over {found['rpe_step']}"
    )
    drives = [
        (row["drive"], 1000 * row["delay"], row["ape_rmse"], row["ape_rmse_recorded"],
         _turned(row["heading_rmse"]), row["rpe_rmse"],
         _turned(row["rpe_heading_rmse"]))
        for row in found["drives"]
    ]  # fmt: skip
    names = ("drive", "delay ms", "APE m", "APE as recorded m", "heading degrees", "RPE m",
             "RPE heading degrees")  # fmt: skip
    yield output.table(names, drives)


def _degrees(row: Details, name: str) -> str:
    value, low, high = (_turned(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return between(value, low, high, 2)


def _turned(radians: float | None) -> float | None:
    return None if radians is None else math.degrees(radians)


def _delay(found: Details) -> Iterator[str]:
    low, value, high = (1000 * found[f"delay{end}"] for end in ("_low", "", "_high"))
    yield (
        f"delay {between(value, low, high, 1)} ms, positive where reality is later; the control "
        f"period is {1000 * found['period']:g} ms"
    )


def _three(row: Details) -> tuple[float | None, float | None, float | None]:
    return row["value"], row["low"], row["high"]


_TOLD: dict[str, Callable[[Details], Iterator[str]]] = {
    "visual": _visual,
    "task": _task,
    "dynamics": _dynamics,
    "delay": _delay,
}
