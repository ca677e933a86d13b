"""An instance that is being adjusted as the input of its drawing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.charts.shared.instance import (
    InstanceInput,
    PoseNumbers,
    SideView,
    heat_fields,
    truth_fields,
)
from s2rtui.session.state import HeatChoice, State

if TYPE_CHECKING:
    from s2rtools.interactive import LiveResult


def live_input(
    store: Store, state: State, result: LiveResult, heat: HeatChoice | None
) -> InstanceInput:
    """Images and predictions of a live result, with the change of the stored errors."""
    iid = result.iid
    return InstanceInput(
        iid=iid,
        sim=_side(result, "sim", heat),
        real=_side(result, "real", heat),
        **truth_fields(store, state.run, iid),
        **heat_fields(store, state.run, heat),
        notes=(_change(store, state, result, "sim"), _change(store, state, result, "real")),
    )


def _side(result: LiveResult, side: Side, heat: HeatChoice | None) -> SideView:
    shown = result.side(side)
    return SideView(
        rgb=shown.rgb,
        depth=shown.depth,
        heat=None if heat is None else result.heatmap(heat.kind, side, heat.mode),
        pose=None
        if math.isnan(shown.x)
        else PoseNumbers(shown.x, shown.y, shown.heading, shown.error, shown.heading_error),
        original=shown.original,
    )


def _change(store: Store, state: State, result: LiveResult, side: Side) -> tuple[str, str]:
    """The error of the stored run, the adjusted one, and their difference."""
    before = float(store.run_columns(state.run).side(side).error[result.iid])
    after = result.side(side).error
    if not (math.isfinite(before) and math.isfinite(after)):
        return side, "no prediction"
    return side, f"error {before:.2f} m, now {after:.2f} m ({after - before:+.2f})"
