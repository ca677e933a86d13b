"""The columns and rows of the list."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import fields
from s2rtui.charts.scene import Scene
from s2rtui.session import instance_list

Text = Callable[[int], str]


@dataclass(frozen=True, slots=True, eq=False)
class ListColumn:
    """A column: `text` formats the value of an iid; `width` in cells; `right` aligns right."""

    title: str
    text: Text
    width: int
    right: bool = True
    sorts: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ListInput:
    """rows: (n,) iids in order; cursor: an iid; descending: the direction of the order."""

    rows: NDArray[np.intp]
    columns: tuple[ListColumn, ...]
    cursor: int | None = None
    descending: bool = True


def cursor_row(data: ListInput) -> int | None:
    """The cursor's index in the list, or None."""
    places = np.flatnonzero(data.rows == data.cursor) if data.cursor is not None else data.rows[:0]
    return int(places[0]) if places.size else None


_DEGREES = ("heading", "real.heading_error", "sim.heading_error")
"""Columns of radians that are shown in degrees."""


@dataclass(frozen=True, slots=True)
class _Column:
    """A column named as in the selection language, with its display and values.

    On the screen the name ends with the unit, as in the columns of `s2r show` and `s2r query`.
    """

    name: str
    shown: ListColumn
    value: Callable[[int], object]


def _column(scene: Scene, name: str, sorts: bool) -> _Column:
    if name == instance_list.REMARK:
        return _remark(scene, sorts)
    if name not in instance_list.NAMES:
        return _numbers(scene, name, sorts)
    truth = scene.store.instances
    text = _named(getattr(truth, name), getattr(truth, f"{name}_names"))
    width = 16 if name == "room" else 12 if scene.store.has_poses else 28
    return _texts(name, text, width, sorts=sorts)


def _remark(scene: Scene, sorts: bool) -> _Column:
    return _texts(instance_list.REMARK, scene.remark, 24, "tags, note", sorts)


def _split(scene: Scene) -> _Column:
    """What the run's model knew of the instance, where trained instances are shown."""
    return _texts("split", lambda iid: scene.splits(np.array([iid]))[0] or "", 11)


def _numbers(scene: Scene, name: str, sorts: bool) -> _Column:
    scale = 180 / math.pi if name in _DEGREES else 1.0
    title = fields.with_unit(name)

    @cache
    def numbers() -> NDArray[np.float64]:
        return instance_list.column(scene.store, scene.state, name)

    def value(iid: int) -> float | None:
        number = float(numbers()[iid]) * scale
        return number if math.isfinite(number) else None

    def text(iid: int) -> str:
        number = value(iid)
        if number is None:
            return "n/a"
        return f"{number:.0f}" if name in instance_list.COUNTS else f"{number:.2f}"

    shown = ListColumn(title, text, max(8, len(title) + 1), sorts=sorts)
    return _Column(name, shown, value)


def _texts(
    name: str, text: Callable[[int], str], width: int, title: str = "", sorts: bool = False
) -> _Column:
    shown = ListColumn(title or name, text, width, False, sorts)
    return _Column(name, shown, lambda iid: text(iid) or None)


def _named(codes: NDArray[np.int32], names: Sequence[str]) -> Callable[[int], str]:
    return lambda iid: names[codes[iid]] if codes[iid] >= 0 else ""
