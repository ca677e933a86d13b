"""The shares of the gap by factor, for the selection beside all instances."""

from __future__ import annotations

import numpy as np

from s2rstore.errors import counted
from s2rstore.metrics.gap_shares import GapShares, has_shares, mean_shares
from s2rstore.reader import Store
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.charts.scene import Scene
from s2rtui.charts.shares.model import SharesInput, shares_model
from s2rtui.charts.shares.terminal import draw_shares
from s2rtui.charts.view import Pixels, Table, View

NO_SHARES = (
    "no selected instance has shares of the gap; "
    "pairs more than 2 cm or 0.5 degrees apart have none"
)
MISSING = "no shares of the gap; `s2r precompute --kinds harm` computes them"


class SharesView(View):
    name = "shares"
    key = "K"
    description = "shares of the gap: how many metres each factor causes"
    brushable = False
    narrow_ratio = 1.3
    wide_ratio = 0.5
    figure_size = (1600, 700)

    def subtitle(self, scene: Scene) -> str:
        return "mean metres of the gap, real error - sim error"

    def input(self, scene: Scene) -> SharesInput:
        state = scene.state
        selected, everything = (
            _shares(scene.store, state.run, mask) for mask in (state.selected, state.base)
        )
        return SharesInput(selected, everything)

    def cache_key(self, scene: Scene) -> tuple[object, ...] | None:
        data = self.input(scene)
        return data, "" if shares_model(data) else _reason(scene)

    def numbers(self, scene: Scene) -> Table:
        names = ("factor", "low_m", "share_m", "high_m", "all_m", "n")
        model = shares_model(self.input(scene))
        if model is None:
            return names, []
        means = [(bar.factor, bar.share.mean, bar.overall) for bar in model.bars]
        return names, [(name, m.low, m.value, m.high, all_, model.n) for name, m, all_ in means]

    def summary(self, scene: Scene) -> str:
        model = shares_model(self.input(scene))
        if model is None:
            return f"{scene.state.run}: {_reason(scene)}."
        parts = ", ".join(f"{bar.factor} {bar.text}" for bar in model.bars)
        apart = f" {counted(model.apart, 'pair')} too far apart left out." if model.apart else ""
        return f"Of the mean gap {model.gap:+.2f} m over {model.n} instances: {parts}.{apart}"

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.shares import paper

        title = f"{scene.state.run}: what causes the gap"
        return paper.shares_figure(self.input(scene), size, theme, title, scene.caption)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_shares(self.input(scene), size, options, _reason(scene))


def _reason(scene: Scene) -> str:
    """Why the selection has no shares."""
    return NO_SHARES if has_shares(scene.store, scene.state.run) else MISSING


@cached_by_identity(8)
def _shares(store: Store, run: str, chosen: Bools) -> GapShares | None:
    return mean_shares(store, run, np.asarray(chosen))


VIEW = SharesView()
