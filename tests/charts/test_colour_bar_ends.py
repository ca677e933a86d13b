"""Every colour bar in the terminal has the numbers of its two ends beside it, at every size."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.charts.compare.model import compare_model
from s2rtui.charts.compare.terminal import draw_compare
from s2rtui.charts.map.terminal import draw_map
from s2rtui.charts.shared.axis_scale import Interval, short_number
from s2rtui.charts.shared.base_map_model import map_model
from s2rtui.charts.shared.image_pair_model import instance_model
from s2rtui.charts.shared.image_pair_terminal import draw_instance, instance_layout
from s2rtui.charts.umap.model import umap_frame, umap_model
from s2rtui.charts.umap.terminal import draw_umap
from tests.charts.examples import compare_input, instance_input, map_input, umap_input

SIZES = ((80, 20), (66, 33), (52, 14), (48, 20), (120, 36), (66, 50), (200, 56))
"""Columns and rows of views on screens of 80x24, 120x40 and 200x60."""
OPTIONS = (RenderOptions(), RenderOptions(mode=ColourMode.NONE), RenderOptions(ascii=True))


def ends(scale: Interval | None) -> tuple[str, str]:
    assert scale is not None
    low, high = (short_number(end, 2) for end in scale)
    return low, high


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("size", SIZES)
def test_both_ends_are_labelled(size: tuple[int, int], options: RenderOptions) -> None:
    on_map = map_input(values=np.linspace(0.31, 7.7, 60))
    compared, pair = compare_input(), instance_input()
    embedded = umap_input()
    drawn = (
        (draw_map(on_map, size, options), ends(map_model(on_map).value_range)),
        (draw_umap(embedded, size, options),
         ends(umap_model(embedded, umap_frame(embedded, 9, 4)).value_range)),
        (draw_instance(pair, size, options), ends(instance_model(pair).heat_range)),
    )  # fmt: skip
    if any(panel.what == "depth" for panel in instance_layout(pair, size, options).panels):
        drawn += ((draw_instance(pair, size, options), ends(instance_model(pair).depth_range)),)
    if size[1] >= 18:
        scale = compare_model(compared).scale
        drawn += ((draw_compare(compared, size, options), ends((-scale, scale))),)
        drawn += ((draw_map(on_map, size, options), ends(map_model(on_map).heat_range)),)
    for canvas, (low, high) in drawn:
        rows = [line for line in canvas.lines() if low in line and high in line]
        assert any(line.index(low) < line.rindex(high) for line in rows), "\n".join(canvas.lines())
