"""What views draw from: a session's state, its store, and what background loading has delivered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.gap_history.reader import History
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.canvas.brush import Mark
from s2rtui.charts.shared.axis_scale import Interval
from s2rtui.charts.shared.instance_model import InstanceInput
from s2rtui.session import State
from s2rtui.session.provenance import (
    HeatProvenance,
    InstanceProvenance,
    about,
    heat_of,
    seen_of,
)
from s2rtui.user_data.notebook import Notes

Grid = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class OverviewRow:
    """One run: mean accuracies 0 .. 1 with their 95 % intervals; None or NaN: nothing is left.

    `n` counts the instances behind the numbers; `note` is shown in their place or beside them.
    """

    run: str
    sim_accuracy: float | None
    real_accuracy: float | None
    sim_interval: Interval | None = None
    real_interval: Interval | None = None
    n: int = 0
    note: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class RunAccuracies:
    """Accuracies (N,) of every run on one side."""

    side: Side
    values: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class Resources:
    """What workers have brought so far; a view shows what is there, under its own name.

    `grid` is the heat on the map, `seen` (rows, cols) what the selection has seen, `live` the
    instance as it is being adjusted; what each is of stands beside it. `history` holds the nights
    of the gap. `progress` and `failed` are by feed: the share that is done, and why nothing came.
    """

    rows: tuple[OverviewRow, ...] = ()
    lines: RunAccuracies | None = None
    baseline: float = math.nan
    floor_plan: NDArray[np.uint8] | None = None
    pictures: InstanceInput | None = None
    pictures_of: InstanceProvenance | None = None
    grid: Grid | None = None
    grid_of: HeatProvenance | None = None
    seen: Grid | None = None
    seen_of: tuple[object, ...] | None = None
    live: InstanceInput | None = None
    live_of: InstanceProvenance | None = None
    live_grid: Grid | None = None
    history: History | None = None
    progress: Mapping[str, float] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    saving: str = ""

    def heat_on_map(self, state: State) -> Grid | None:
        """What lies on the floor: the heat asked for, or that of the image being adjusted."""
        if state.adjusting and state.overlay == "instance":
            return self.live_grid if self.live_of == about(state) else None
        return self.grid if self.grid_of and self.grid_of.name == heat_of(state).name else None

    def heat_note(self, state: State) -> str:
        """Whose heat lies on the map, where that is not the present instance's or selection's."""
        if state.adjusting and state.overlay == "instance":
            return ""
        return self.grid_of.told(state) if self.grid_of else ""

    def seen_on_map(self, state: State) -> Grid | None:
        """The floor that the present selection has seen."""
        return self.seen if state.clip and self.seen_of == seen_of(state) else None

    def adjusted(self, state: State) -> InstanceInput | None:
        """The instance that is being adjusted, as the present run's model sees it."""
        of = self.live_of
        return self.live if of and of.source == (state.generation, state.run) else None

    def asked(self, feeds: Set[str], emptied: Mapping[str, Any]) -> Resources:
        """Without what is told of feeds that are asked anew, and of the emptied fields."""
        progress = {feed: told for feed, told in self.progress.items() if feed not in feeds}
        failed = {feed: told for feed, told in self.failed.items() if feed not in feeds}
        return replace(self, **emptied, progress=progress, failed=failed)

    def fed(self, feed: str, fields: Mapping[str, Any], error: str) -> Resources:
        """With what a feed has brought, or why it could not."""
        made = self.asked({feed}, fields)
        return replace(made, failed={**made.failed, feed: error}) if error else made

    def told_of(self, words: str) -> str:
        """Words and how far each feed is."""
        shares = ", ".join(f"{feed} {share:.0%}" for feed, share in self.progress.items())
        return f"{words}  {shares}".strip()


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All that a view draws from."""

    store: Store
    state: State
    resources: Resources
    notes: Notes = field(default_factory=Notes)

    def remark(self, iid: int) -> str:
        """The user's tags and note on an instance."""
        remark = self.notes.remarks.get(iid)
        return remark.text if remark else ""

    @property
    def caption(self) -> str:
        """What a figure's title leaves open: the data set, how many of how many, the expression."""
        counted = f"{self.state.count} instances"
        return "  ·  ".join((self.store.dataset.name, counted, self.state.expression))

    def mark(self, view: str) -> Mark | None:
        """The mark that is being drawn in a view."""
        brush = self.state.brush
        return brush.mark if brush is not None and brush.view == view else None
