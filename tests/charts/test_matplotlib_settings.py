"""Figures neither change the user's matplotlib settings nor depend on them."""

from __future__ import annotations

import matplotlib
import pytest

from s2rtui.canvas import LIGHT
from tests.charts.test_figures import FIGURES

USER = {
    "text.parse_math": True, "font.size": 31.0, "axes.linewidth": 7.0, "lines.linewidth": 9.0,
    "axes.facecolor": "red", "savefig.dpi": 33, "xtick.direction": "in", "image.cmap": "gray",
    "font.family": ["serif"], "legend.fontsize": 25.0, "axes.titlepad": 40.0,
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_figures_and_the_user_s_settings_are_independent(name: str) -> None:
    plain = FIGURES[name]((240, 180), LIGHT)
    with matplotlib.rc_context(USER):
        before = dict(matplotlib.rcParams)
        figure = FIGURES[name]((240, 180), LIGHT)
        assert dict(matplotlib.rcParams) == before
    assert figure == plain
