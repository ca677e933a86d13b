"""The text of `s2r gap --details`: the figures of each axis beside its value."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from s2rstore.intervals import Interval
from s2rtools.common.command_line import output

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
    """Return a value with its interval, or the reason why it has none."""
    return Interval.from_columns(row, name).with_bounds(f"{{:.{digits}f}}".format)


def _visual(details: Details) -> Iterator[str]:
    halves = details["halves"]
    rows = [
        (name, row["value"], _floor(row))
        for name, row in halves.items()
        if isinstance(row, dict) and "floor_low" in row
    ]
    yield f"permutation p value of the kernel distance: {details['kid_p']:.3g}"
    names = ("metric", "sim and real", "real and real (range over the splits)")
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
        f"{Interval.from_json(drop).with_bounds()}"
    )
    for kind in ("runs", "trajectories", "rooms", "headings"):
        groups = details[kind].items()
        if len(groups) < 2:
            continue
        by_gap = sorted(groups, key=lambda item: -item[1]["gap"]["value"])
        rows = [
            (name, row["n"], row["sim"], row["real"], row["baseline"],
             Interval.from_json(row["gap"]).with_bounds(),
             Interval.from_json(row["relative_drop"]).with_bounds())
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
    return Interval.from_columns(row, name).scaled(180 / math.pi).with_bounds()


def _to_degrees(radians: float | None) -> float | None:
    return None if radians is None else math.degrees(radians)


def _delay(details: Details) -> Iterator[str]:
    delay = Interval.from_columns(details, "delay").scaled(1000).with_bounds("{:.1f}".format)
    yield (
        f"delay {delay} ms, positive if reality lags; the control "
        f"period is {1000 * details['period']:g} ms"
    )


_DESCRIPTIONS: dict[str, Callable[[Details], Iterator[str]]] = {
    "visual": _visual,
    "task": _task,
    "dynamics": _dynamics,
    "delay": _delay,
}
