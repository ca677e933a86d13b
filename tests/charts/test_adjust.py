"""The slider view: labels, values and units are complete where the panel is wide enough."""

from __future__ import annotations

import pytest

from s2rtools.adjustments import ADJUSTMENTS
from s2rtui.charts.adjust.terminal import SliderLine, draw_sliders, slider_panels

LINES = tuple(
    SliderLine(
        one.name.replace("_", " "), "real", one.lowest, one.highest, one.neutral,
        one.lowest + one.step, one.unit, at == 2,
    )
    for at, one in enumerate(ADJUSTMENTS.values())
)  # fmt: skip


@pytest.mark.parametrize("width", [46, 50, 80])
def test_labels_and_units_are_complete(width: int) -> None:
    rows = draw_sliders(LINES, (width, len(LINES))).lines()
    for line, row in zip(LINES, rows, strict=True):
        assert f" {line.label} " in row
        assert row.rstrip().endswith(f" {line.unit}")


@pytest.mark.parametrize("width", [1, 8, 20, 30, 46])
def test_narrow_sliders_keep_their_track(width: int) -> None:
    panels = slider_panels(LINES, (width, 4))
    assert len(panels) == 4
    assert all(panel.width >= 8 for panel in panels)
    assert "2" in {panel.name for panel in panels}
    draw_sliders(LINES, (width, 4))
