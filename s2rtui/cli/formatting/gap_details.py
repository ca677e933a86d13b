"""The text of `s2r gap --details`: the figures of each axis beside its value."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from s2rtui.cli.formatting import rows as output

Details = dict[str, Any]
_DIMENSIONS = 3
_SCALES = {
    "travel": "the mean distance driven within the horizon",
    "extent": "the diagonal of the bounding box of the path",
    "deviation": "the standard deviation of the positions",
}


def details(axis: dict[str, Any]) -> Iterator[str]:
    """Yield lines and tables of one axis; nothing for an unknown axis."""
    describe = _DESCRIPTIONS.get(axis["axis"])
    if describe is not None:
        yield from describe(axis["details"])


def with_interval(row: dict[str, Any], name: str, digits: int = 3) -> str:
    """Return a value with its interval: `name`, `name_low` and `name_high` of `row`."""
    return interval_text(row.get(name), row.get(f"{name}_low"), row.get(f"{name}_high"), digits)


def interval_text(value: float | None, low: float | None, high: float | None, digits: int) -> str:
    """Return `value (low .. high)`; `-` for an unknown value, `?` for an unknown end."""
    if value is None:
        return "-"
    ends = " .. ".join("?" if end is None else f"{end:.{digits}f}" for end in (low, high))
    return f"{value:.{digits}f} ({ends})"


def _visual(details: Details) -> Iterator[str]:
    halves = details["halves"]
    rows = [
        (name, row["value"], _floor(row))
        for name, row in halves.items()
        if isinstance(row, dict) and "floor_low" in row
    ]
    yield f"permutation p value of the kernel distance: {details['kid_p']:.3g}"
    names = ("metric", "sim and real", "real and real (noise floor)")
    yield (
        f"means over {halves['splits']} random splits of the instances into two halves, n = "
        f"{halves['n']} each: sim images of one half and real images of the other, and real images "
        f"of both halves\n{output.table(names, rows)}"
    )
    columns = halves["wasserstein_by_dimension"]
    largest = sorted(
        zip(columns["value"], columns["floor"], columns["dimension"], strict=True), reverse=True
    )[:_DIMENSIONS]
    yield f"Wasserstein-1 of single features, the largest of {len(columns['value'])}:\n" + (
        output.table(
            ("dimension", "sim and real", "real and real (noise floor)"),
            [(dimension, value, floor) for value, floor, dimension in largest],
        )
    )


def _floor(row: Details) -> str:
    """Return the floor with four significant digits, because features have any scale."""
    value, low, high = (
        "-" if row[key] is None else f"{row[key]:.4g}"
        for key in ("floor", "floor_low", "floor_high")
    )
    return f"{value} ({low} .. {high})"


def _task(details: Details) -> Iterator[str]:
    drop = details["relative_drop"]
    yield (
        f"mean error {details['sim']:.2f} m in simulation, {details['real']:.2f} m in reality, "
        f"{details['baseline']:.2f} m for the constant prediction; relative drop "
        f"{interval_text(drop['value'], drop['low'], drop['high'], 2)}"
    )
    for kind in ("runs", "trajectories", "rooms", "headings"):
        groups = details[kind].items()
        if len(groups) < 2:
            continue
        by_gap = sorted(groups, key=lambda item: -item[1]["gap"]["value"])
        rows = [
            (name, row["n"], row["sim"], row["real"], row["baseline"],
             interval_text(*_triple(row["gap"]), 2),
             interval_text(*_triple(row["relative_drop"]), 2))
            for name, row in by_gap
        ]  # fmt: skip
        names = (kind, "n", "sim m", "real m", "constant m", "gap m", "relative drop")
        yield output.table(names, rows)


def _dynamics(details: Details) -> Iterator[str]:
    rows = [
        (f"{row['horizon']:g} s", row["windows"], with_interval(row, "rmse"),
         with_interval(row, "nrmse"), _degrees(row, "heading_rmse"))
        for row in details["horizons"]
    ]  # fmt: skip
    yield f"NRMSE is RMSE over {_SCALES[details['scale']]}"
    yield output.table(("horizon", "windows", "RMSE m", "NRMSE", "heading degrees"), rows)
    yield (
        f"whole drives after removal of the delay (searched within {details['reach']:g} s); "
        f"alignment before APE and RPE: {details['alignment']}; RPE over {details['rpe_step']}"
    )
    drives = [
        (row["drive"], 1000 * row["delay"], row["ape_rmse"], row["ape_rmse_recorded"],
         _to_degrees(row["heading_rmse"]), row["rpe_rmse"],
         _to_degrees(row["rpe_heading_rmse"]))
        for row in details["drives"]
    ]  # fmt: skip
    names = ("drive", "delay ms", "APE m", "APE as recorded m", "heading degrees", "RPE m",
             "RPE heading degrees")  # fmt: skip
    yield output.table(names, drives)


def _degrees(row: Details, name: str) -> str:
    value, low, high = (_to_degrees(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return interval_text(value, low, high, 2)


def _to_degrees(radians: float | None) -> float | None:
    return None if radians is None else math.degrees(radians)


def _delay(details: Details) -> Iterator[str]:
    low, value, high = (1000 * details[f"delay{end}"] for end in ("_low", "", "_high"))
    yield (
        f"delay {interval_text(value, low, high, 1)} ms, positive if reality lags; the control "
        f"period is {1000 * details['period']:g} ms"
    )


def _triple(row: Details) -> tuple[float | None, float | None, float | None]:
    return row["value"], row["low"], row["high"]


_DESCRIPTIONS: dict[str, Callable[[Details], Iterator[str]]] = {
    "visual": _visual,
    "task": _task,
    "dynamics": _dynamics,
    "delay": _delay,
}
