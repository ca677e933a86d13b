"""The objects view: what labelled objects cost the real prediction, by class."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from s2rstore.language.canonical_text import quoted
from s2rstore.metrics.object_gains import (
    CLAIM,
    ObjectGain,
    ObjectGains,
    missing_gains,
    object_gains,
)
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import StatisticsView, Table
from s2rtui.drawing.scale import Scale, range_with_bounds
from s2rtui.drawing.table import Bar, Cell, Column, Row, Span, StripMark, TableSpec
from s2rtui.session.state import State

NOTHING = (
    "no selected pair shows a labelled object; pairs more than 2 cm or 0.5 degrees apart have no "
    "gains"
)
NAMES = ("object", "low_m", "gain_m", "high_m", "note", "images", "harmed", "sum_m", "expression")
_MARGIN = 0.5
"""Space for bounds beside the means, as a share of the range of the means."""


def objects_table(model: ObjectGains, with_strips: bool = True) -> TableSpec:
    """A row per class: the mean gain of its images in metres, and how many show and pay for it."""
    means = [0.0, *(each.gain.value for each in model.classes)]
    bounds = (float(end) for each in model.classes for end in each.gain.bounds)
    scale = Scale(*range_with_bounds(means, bounds, _MARGIN), ("gain (m)", "gain (m)", "m"))
    columns = (
        Column("object"), Column("gain m", right=True), Column("95 %", right=True, rank=2),
        Column("images", right=True), Column(f"> {CLAIM:g} m", right=True, rank=3),
        Column("sum m", right=True, rank=4), Column("", rank=1, scale=scale),
    )  # fmt: skip
    kept = len(columns) if with_strips else len(columns) - 1
    rows = tuple(replace(row, cells=row.cells[:kept]) for row in map(_row, model.classes))
    return TableSpec(columns[:kept], rows)


def _row(each: ObjectGain) -> Row:
    gain = each.gain
    strip: list[StripMark] = [Bar(gain.value, "real" if gain.value > 0 else "sim")]
    if gain.is_known:
        strip.append(Span(gain.low, gain.high, "text"))
    bounds = "..".join(gain.bound_texts("{:.2f}".format)) if gain.is_known else "too few"
    cells = (Cell(each.name), Cell(_number(gain.value, 2)), Cell(bounds), Cell(f"{each.images}"),
             Cell(f"{each.harmed}"), Cell(_number(each.total, 1)),
             Cell(strip=tuple(strip)))  # fmt: skip
    return Row(cells, "text" if gain.excludes_zero else "muted")


def _number(value: float, digits: int) -> str:
    """A number with its sign; that of 0 is `+`, whatever is rounded to it."""
    return f"{round(value, digits) + 0.0:+.{digits}f}"


def objects_notes(model: ObjectGains) -> tuple[str, ...]:
    """What the numbers of the table mean."""
    missing = "sim images have no labels: what is missing in reality counts for what is behind it"
    return (
        f"{model.n} pairs with labels, mean real error {model.error:.2f} m",
        "gain: how far the error falls if the object looks as in simulation, mean over its images",
        "estimated from the heatmap harm; intervals for all classes at once",
        *([] if model.has_sim_labels else [missing]),
    )


def object_rows(model: ObjectGains) -> Iterator[tuple[object, ...]]:
    """Rows of the columns `NAMES`."""
    for each in model.classes:
        low, high = (None if math.isnan(end) else float(end) for end in each.gain.bounds)
        yield (each.name, low, each.gain.value, high, each.gain.no_bounds or None, each.images,
               each.harmed, each.total, expression_of(each.name))  # fmt: skip


def expression_of(label: str) -> str:
    """The expression that selects the instances with an image of a class."""
    return f"label:{quoted(label)}"


class ObjectsView(StatisticsView):
    name = "objects"
    key = ":"
    description = "objects: the metres that each labelled class costs the real prediction"
    about = "what objects cost (enter: select)"
    title = "what labelled objects cost"
    figure_size = (1600, 1000)

    def model(self, store: Store, state: State) -> ObjectGains | str:
        if reason := missing_gains(store, state.run):
            return reason
        return object_gains(store, state.run, np.asarray(state.selected)) or NOTHING

    def table(self, model: ObjectGains) -> TableSpec:
        return objects_table(model)

    def notes(self, model: ObjectGains) -> tuple[str, ...]:
        return objects_notes(model)

    def choices(self, model: ObjectGains, side: Side) -> Sequence[tuple[str, str]]:
        return [(each.name, expression_of(each.name)) for each in model.classes]

    def numbers(self, scene: Scene) -> Table:
        model = self.input(scene)
        return NAMES, list(object_rows(model)) if isinstance(model, ObjectGains) else []


VIEW = ObjectsView()
