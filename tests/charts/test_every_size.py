"""Every view draws at any size in any mode, and ASCII mode uses only ASCII characters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.canvas import LIGHT, Canvas, ColourMode, RenderOptions
from s2rtui.canvas.marks import Mark
from s2rtui.charts.compare.terminal import draw_compare
from s2rtui.charts.errors.terminal import draw_errors
from s2rtui.charts.findings.model import FindingsInput
from s2rtui.charts.findings.terminal import draw_findings
from s2rtui.charts.history.terminal import draw_history
from s2rtui.charts.map.terminal import draw_map
from s2rtui.charts.orientation.terminal import draw_orientation
from s2rtui.charts.overview.terminal import draw_overview
from s2rtui.charts.rooms.groups_terminal import draw_groups
from s2rtui.charts.rooms.terminal import draw_rooms
from s2rtui.charts.scatter.terminal import draw_scatter
from s2rtui.charts.shared.image_pair_terminal import draw_instance
from s2rtui.charts.suggestions.terminal import draw_suggestions
from s2rtui.charts.umap.terminal import draw_umap
from s2rtui.terminal.strips import to_strips
from tests.charts.examples import (
    ROWS,
    compare_input,
    errors_input,
    finding_report,
    groups_input,
    instance_input,
    map_input,
    orientation_input,
    overview_lines,
    rooms_input,
    scatter_input,
    side,
    umap_input,
)
from tests.support import gaps
from tests.support.suggestions import suggestions_input

Draw = Callable[[tuple[int, int], RenderOptions], Canvas]
BOX = Mark("map", ((2.0, 2.0), (9.0, 5.0)))
LASSO = Mark("map", ((2.0, 2.0), (9.0, 5.0), (4.0, 8.0)), lasso=True)
VIEWS: dict[str, Draw] = {
    "overview": lambda size, options: draw_overview(ROWS, 0.72, 1, size, options),
    "overview lines": lambda size, options: draw_overview(
        ROWS, 0.72, 1, size, options, overview_lines(), Mark("vanilla", ((0.6, 0.0), (0.8, 0.0)))
    ),
    "map": lambda size, options: draw_map(map_input(), size, options),
    "full map": lambda size, options: draw_map(map_input(mode="full"), size, options),
    "glyph map": lambda size, options: draw_map(
        map_input(mode="glyph", clip=np.eye(5), mark=BOX), size, options
    ),
    "compare": lambda size, options: draw_compare(compare_input(mark=LASSO), size, options),
    "bare map": lambda size, options: draw_map(
        map_input(floor_plan=None, heat=None, headings=None, cursor=None), size, options
    ),
    "instance": lambda size, options: draw_instance(instance_input(), size, options),
    "plain instance": lambda size, options: draw_instance(
        instance_input(sim=side(1, False, False), real=side(2, False, False), truth=None),
        size,
        options,
    ),
    "errors": lambda size, options: draw_errors(errors_input(), size, options),
    "marked histogram": lambda size, options: draw_errors(
        errors_input(cursor=5, mark=Mark("real", ((0.2, 3.0), (99.0, -1.0)))), size, options
    ),
    "history": lambda size, options: draw_history(gaps.week(), size, options),
    "no history": lambda size, options: draw_history((), size, options),
    "umap": lambda size, options: draw_umap(umap_input(), size, options),
    "marked umap": lambda size, options: draw_umap(
        umap_input(mark=Mark("real", ((-9.0, -9.0), (3.0, 3.0), (4.0, 9.0)), lasso=True)),
        size,
        options,
    ),
    "orientation": lambda size, options: draw_orientation(orientation_input(), size, options),
    "marked orientation": lambda size, options: draw_orientation(
        orientation_input(mark=Mark("sim", ((170.0, 1.0), (-120.0, 9.0)))), size, options
    ),
    "scatter": lambda size, options: draw_scatter(scatter_input(cursor=5), size, options),
    "marked scatter": lambda size, options: draw_scatter(
        scatter_input(mark=Mark("errors", ((0.5, 0.5), (9.0, 3.0), (1.0, -2.0)), lasso=True)),
        size,
        options,
    ),
    "rooms": lambda size, options: draw_rooms(rooms_input(), size, options),
    "marked rooms": lambda size, options: draw_rooms(
        rooms_input(mark=Mark("truth", ((0.0, 1.0), (0.0, 9.0)))), size, options
    ),
    "groups": lambda size, options: draw_groups(groups_input(), size, options),
    "marked groups": lambda size, options: draw_groups(
        groups_input(mark=Mark("groups", ((0.0, 3.0), (0.0, 4.0)))), size, options
    ),
    "findings": lambda size, options: draw_findings(
        FindingsInput(finding_report(), 6), size, options
    ),
    "suggestions": lambda size, options: draw_suggestions(suggestions_input(), size, options),
    "no suggestions": lambda size, options: draw_suggestions(
        suggestions_input(real=0, sim=0), size, options
    ),
    "no findings": lambda size, options: draw_findings(
        FindingsInput(finding_report(0)), size, options
    ),
}
OPTIONS = [
    RenderOptions(),
    RenderOptions(theme=LIGHT, mode=ColourMode.PALETTE),
    RenderOptions(mode=ColourMode.ANSI),
    RenderOptions(mode=ColourMode.NONE),
    RenderOptions(mode=ColourMode.PALETTE, ascii=True),
    RenderOptions(mode=ColourMode.NONE, ascii=True),
]


@pytest.mark.parametrize("name", VIEWS)
@given(width=st.integers(1, 30), height=st.integers(1, 10), options=st.sampled_from(OPTIONS))
def test_small_sizes_are_filled_completely(
    name: str, width: int, height: int, options: RenderOptions
) -> None:
    canvas = VIEWS[name]((width, height), options)
    assert canvas.char.shape == (height, width)
    strips = to_strips(canvas, options.mode, options.ascii)
    assert [strip.cell_length for strip in strips] == [width] * height


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
def test_ascii_mode_uses_only_ascii_at_every_size(size: tuple[int, int]) -> None:
    for name, draw in VIEWS.items():
        for mode in (ColourMode.PALETTE, ColourMode.NONE):
            canvas = draw(size, RenderOptions(mode=mode, ascii=True))
            assert "".join(canvas.lines()).isascii(), name
