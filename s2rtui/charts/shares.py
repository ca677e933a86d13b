"""The shares view: how many metres of the gap each factor causes, with intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import counted
from s2rstore.metrics.gap_shares import GapShares, has_shares, mean_shares
from s2rstore.reader import Store
from s2rstore.records import GAP_FACTORS, Side
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import StatisticsView, Table
from s2rtui.drawing.scale import Scale, range_with_bounds
from s2rtui.drawing.table import Bar, Cell, Column, Dot, Row, Span, TableSpec
from s2rtui.session.state import State

_MARGIN = 0.5
"""Space for bounds beside the means, as a share of the range of the means."""
NO_SHARES = (
    "no selected instance has shares of the gap; "
    "pairs more than 2 cm or 0.5 degrees apart have none"
)
MISSING = "no shares of the gap; `s2r precompute --kinds harm` computes them"


@dataclass(frozen=True, slots=True)
class SharesModel:
    """Mean shares of the selection in metres, and the means of all instances by factor."""

    selected: GapShares
    overall: dict[str, float]

    @property
    def counted(self) -> str:
        """The mean gap and the instances it is of: `mean gap +3.32 m, n 50`."""
        chosen = self.selected
        few = " (too few)" if not all(share.mean.is_known for share in chosen.shares) else ""
        apart = f"; {counted(chosen.apart, 'pair')} too far apart left out" if chosen.apart else ""
        return f"mean gap {chosen.gap:+.2f} m, n {chosen.n}{few}{apart}"


def shares_scale(model: SharesModel) -> Scale:
    """The axis in metres: it holds 0, all means, and bounds that are not far beyond these."""
    means = [0.0, *model.overall.values(), *(s.mean.value for s in model.selected.shares)]
    bounds = (float(end) for share in model.selected.shares for end in share.mean.bounds)
    return Scale(*range_with_bounds(means, bounds, _MARGIN),
                 ("mean share (m)", "share (m)", "m"))  # fmt: skip


class SharesView(StatisticsView):
    name = "shares"
    key = "K"
    description = "shares of the gap: how many metres each factor causes"
    about = "mean metres of the gap, real error - sim error"
    title = "what causes the gap"
    figure_size = (1600, 700)

    def model(self, store: Store, state: State) -> SharesModel | str:
        selected, everything = (
            mean_shares(store, state.run, np.asarray(mask)) for mask in (state.selected, state.base)
        )
        if selected is None or everything is None:
            return NO_SHARES if has_shares(store, state.run) else MISSING
        return SharesModel(selected, {s.factor: s.mean.value for s in everything.shares})

    def table(self, model: SharesModel) -> TableSpec:
        strip = Column("", scale=shares_scale(model))
        return TableSpec((Column("factor"), strip), tuple(_rows(model)))

    def choices(self, model: SharesModel, side: Side) -> Sequence[tuple[str, str]]:
        """Factors with the instances whose gap each enlarges; a sum of factors has no field."""
        known = (share.factor for share in model.selected.shares)
        return [(name, f"share.{name} > 0" if name in GAP_FACTORS else "") for name in known]

    def notes(self, model: SharesModel) -> tuple[str, ...]:
        return (
            f"{model.counted}; > 0 makes real errors larger than sim errors",
            "dot: all instances; lines: 95 % intervals for all factors at once",
            "estimated by exchanging factors between the images of a pair",
        )

    def numbers(self, scene: Scene) -> Table:
        names = ("factor", "low_m", "share_m", "high_m", "all_m", "n")
        model = self.input(scene)
        if not isinstance(model, SharesModel):
            return names, []
        means = [(share.factor, share.mean) for share in model.selected.shares]
        n = model.selected.n
        return names, [(name, m.low, m.value, m.high, model.overall[name], n) for name, m in means]


def _rows(model: SharesModel) -> Iterator[Row]:
    for share in model.selected.shares:
        mean = share.mean
        strip = (
            Bar(mean.value, "real" if mean.value > 0 else "sim"), Span(mean.low, mean.high, "text"),
            Dot(model.overall[share.factor], "truth", "truth"),
        )  # fmt: skip
        bounds = mean.bounds_text() if mean.is_known else ""
        yield Row((Cell(share.factor), Cell(f"{mean.value:+.2f} m", bounds, strip)))


VIEW = SharesView()
