"""Columns of instances: the texts and values by which a list or a sheet is sorted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import fields
from s2rtui.charts.scene import Scene
from s2rtui.drawing.table import Column
from s2rtui.session import instance_list

_DEGREES = ("heading", "real.heading_error", "sim.heading_error")
"""Columns of radians that are shown in degrees."""


@dataclass(frozen=True, slots=True)
class ListColumn:
    """A column named as in the selection language: its display, and text and value of an iid.

    On the screen the name ends with the unit, as in the columns of `s2r show` and `s2r query`.
    """

    name: str
    shown: Column
    text: Callable[[int], str]
    value: Callable[[int], object]


def list_columns(scene: Scene) -> list[ListColumn]:
    """The column that sorts after the number of the instance, then the most important others."""
    sort = scene.state.sort
    stored = instance_list.stored_columns(scene.store)
    names = ["iid", sort] if sort != "iid" else ["iid"]
    names += ["room"] if "room" in stored else []
    names += ["split"] if scene.state.marked is not None else []
    names += [instance_list.REMARK] if scene.notes.remarks else []
    names = list(dict.fromkeys([*names, *stored]))
    return [list_column(scene, name, rank) for rank, name in enumerate(names)]


def list_column(scene: Scene, name: str, rank: int = 0) -> ListColumn:
    truth = scene.store.instances
    if name == "iid":
        return _texts(scene, name, str, 8, rank, value=int, is_number=True)
    if name == instance_list.REMARK:
        return _texts(scene, name, scene.remark, 24, rank, "tags, note")
    if name == "split":
        return _texts(scene, name, lambda iid: scene.splits(np.array([iid]))[0] or "", 11, rank)
    if name not in instance_list.NAMES:
        return _numbers(scene, name, rank)
    text = _named(getattr(truth, name), getattr(truth, f"{name}_names"))
    return _texts(scene, name, text, 16 if name == "room" else 12, rank)


def _numbers(scene: Scene, name: str, rank: int) -> ListColumn:
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

    return ListColumn(name, _shown(scene, name, title, max(8, len(title) + 1), rank), text, value)


def _texts(
    scene: Scene, name: str, text: Callable[[int], str], width: int, rank: int, title: str = "",
    value: Callable[[int], object] | None = None, is_number: bool = False,
) -> ListColumn:  # fmt: skip
    shown = _shown(scene, name, title or name, width, rank, is_number)
    return ListColumn(name, shown, text, value or (lambda iid: text(iid) or None))


def _shown(
    scene: Scene, name: str, title: str, width: int, rank: int, is_number: bool = True
) -> Column:
    return Column(title, right=is_number, sorts=scene.state.sort == name, rank=rank, least=width,
                  is_cut=not is_number)  # fmt: skip


def _named(codes: NDArray[np.int32], names: Sequence[str]) -> Callable[[int], str]:
    return lambda iid: names[codes[iid]] if codes[iid] >= 0 else ""
