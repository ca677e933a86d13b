"""Tables of `s2r score`."""

from __future__ import annotations

from typing import Any

from s2rtools.common.command_line import output

Row = dict[str, Any]
Table = tuple[str, tuple[str, ...], list[tuple[object, ...]]]


def tables(scores: Row) -> list[str]:
    """The score report as texts, one per table."""
    made = [_heatmaps(scores), _factors(scores), _objects(scores)]
    if "harm" in scores:
        harm = scores["harm"]
        made += [_harm(harm), _repairs(harm), _shares(harm), _largest_shares(harm)]
    return [f"{title}\n\n{output.table(names, rows)}" for title, names, rows in made]


def _heatmaps(scores: Row) -> Table:
    names = ("run", "heatmap", "mode", "side", "place", "AUROC", "precision of top 5 %",
             "base rate", "n", "frames without")  # fmt: skip
    rows: list[tuple[object, ...]] = [
        (r["run"], r["kind"], r["mode"], r["side"], r["place"], _interval(r, "auroc"),
         _interval(r, "precision"), _number(r["base_rate"]), r["n"], r["without"])
        for r in scores["heatmaps"]
    ]  # fmt: skip
    return "Agreement of heatmaps with the labelled changes", names, rows


def _factors(scores: Row) -> Table:
    names = ("run", "factor", "alone", "costs", "all but it", "leaving it out gains", "n")
    rows: list[tuple[object, ...]] = [
        (r["run"], r["factor"], _interval(r, "alone"), _interval(r, "cost"),
         _interval(r, "without"), _interval(r, "gain"), r["n"])
        for r in scores["factors"]
    ]  # fmt: skip
    title = (
        "Causes of the real error: mean position error, m; the intervals of costs and gains hold "
        "for all factors at once"
    )
    return title, names, rows


def _objects(scores: Row) -> Table:
    rows: list[tuple[object, ...]] = [
        (r["run"], r["object"], r["name"], r["change"], _interval(r, "gain"), r["n"])
        for r in scores["objects"]
    ]
    title = "Error reduction by restoring one object, in images that show it, m"
    return title, ("run", "object", "name", "change", "gain", "n"), rows


def _harm(harm: Row) -> Table:
    views = ", ".join(
        f"{run} {count} ({harm['left_out'][run]} trained on left out)"
        for run, count in harm["views"].items()
    )
    title = (
        "What harms the pose: changed objects of a view, ranked by the heat on their pixels, "
        f"against the gain of restoring each; AUROC and right: gain above 0.25 m\nviews: {views}"
    )
    names = ("run", "heatmap", "mode", "side", "heat", "rank correlation", "AUROC",
             "AUROC of another run's map", "claims > 0.25 m", "right", "right at random",
             "delivered, m", "at random, m", "pairs", "views")  # fmt: skip
    rows: list[tuple[object, ...]] = [
        (r["run"], r["kind"], r["mode"], r["side"], "sum, m" if r["in_metres"] else "mean",
         _interval(r, "correlation"), _interval(r, "auroc"), _interval(r, "other_run"),
         r["claims"] if r["in_metres"] else "-", _interval(r, "precision"),
         _number(r["base_rate"]), _interval(r, "delivered"), _number(r["mean_gain"]), r["n"],
         r["views"])
        for r in harm["kinds"]
    ]  # fmt: skip
    return title, names, rows


def _repairs(harm: Row) -> Table:
    names = ("run", "heatmap", "mode", "repairs", "error", "random order", "best order",
             "saved against random", "views")  # fmt: skip
    rows: list[tuple[object, ...]] = [
        (r["run"], r["kind"], r["mode"], r["repairs"], _number(r["error"]), _number(r["random"]),
         _number(r["best"]), _interval(r, "saved"), r["n"])
        for r in harm["repairs"]
    ]  # fmt: skip
    title = "Mean real error after restoring objects in the order of their heat, m"
    return title, names, rows


def _shares(harm: Row) -> Table:
    rows: list[tuple[object, ...]] = [
        (r["run"], r["estimator"], r["group"], _interval(r, "correlation"), _interval(r, "error"),
         _number(r["mean"]), r["n"], r["left_out"])
        for r in harm["shares"]
    ]  # fmt: skip
    names = ("run", "estimator", "group", "correlation", "mean absolute error, m",
             "mean true share, m", "n", "trained on, left out")  # fmt: skip
    return "Shares of the gap per group of factors", names, rows


def _largest_shares(harm: Row) -> Table:
    rows: list[tuple[object, ...]] = [
        (r["run"], r["estimator"], _interval(r, "right"), r["n"]) for r in harm["largest_share"]
    ]
    return "Group with the largest share", ("run", "estimator", "right", "n"), rows


def image_repairs(rows: list[Row]) -> str:
    """The table of image repairs."""
    names = ("run", "heatmap", "mode", "cells %", "error falls by", "more than at random", "n")
    cells: list[tuple[object, ...]] = [
        (r["run"], r["kind"], r["mode"], round(100 * r["share"]), _interval(r, "gain"),
         _interval(r, "over_random"), r["n"])
        for r in rows
    ]  # fmt: skip
    whole = ", ".join(
        f"{run} {_number(value)}" for run, value in {r["run"]: r["whole"] for r in rows}.items()
    )
    title = f"Repairing cells of the real images by each heatmap, m; all cells repaired: {whole}"
    return f"{title}\n\n{output.table(names, cells)}"


def _interval(row: Row, name: str) -> str:
    value, low, high = (_number(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return value if low == high == "-" else f"{value} ({low} .. {high})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
