"""The layout of the overview, and its panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from rich.cells import cell_len

from s2rtui.canvas import PlotArea, Point, Size
from s2rtui.charts.overview.model import OverviewLines, overview_model
from s2rtui.charts.scene import OverviewRow
from s2rtui.drawing.scale import Interval

NUMBERS = 12
"""Columns of the two numbers at the right."""
CURSOR_NUMBERS = 7
"""Columns of the cursor's numbers beside them."""
MOST = 12
"""Most rows per run, the lines to the next run included."""


@dataclass(frozen=True, slots=True)
class OverviewLayout:
    """Columns of name, chart and numbers; rows of the runs.

    Run `first` is at row `top`, each further one `step` rows below. `cursor_numbers`: width of the
    cursor's numbers at the right edge, 0 for none.
    """

    name: int
    chart: int
    chart_width: int
    numbers: int
    top: int
    first: int
    shown: int
    axis_rows: int
    step: int = 1
    cursor_numbers: int = 0

    def row_of(self, index: int) -> int:
        """The row of a run."""
        return self.top + (index - self.first) * self.step

    @property
    def height(self) -> int:
        """Number of rows from the first run to the last one."""
        return (self.shown - 1) * self.step + 1

    def run_at(self, y: int) -> int | None:
        """The index of the run that is nearest to row `y`."""
        offset = y - self.top
        index = (offset + self.step // 2) // self.step
        return self.first + index if offset >= 0 and 0 <= index < self.shown else None

    def column(self, value: float, axis: Interval) -> int:
        """The column of an accuracy, clipped to the axis."""
        last = self.chart_width - 1
        place = round(axis_share(value, axis) * last)
        return self.chart + min(last, max(0, place))


def axis_share(value: float, axis: Interval) -> float:
    """An accuracy as a fraction of the axis."""
    return (value - axis[0]) / (axis[1] - axis[0])


def overview_layout(
    rows: Sequence[OverviewRow],
    selected: int | None,
    size: Size,
    lines: OverviewLines | None = None,
) -> OverviewLayout:
    """Lay out the parts; if not all runs fit, the window follows `selected`."""
    width, height = size
    longest = max((cell_len(row.run) for row in rows), default=0)
    numbers = NUMBERS if width >= 24 else 0
    name = max(0, min(longest, 24, (width - numbers) // 3))
    chart_width = max(0, width - 2 - name - 1 - numbers)
    if chart_width < 8:
        name, chart_width = max(0, width - 2 - numbers), 0
    has_cursor = lines is not None and lines.cursor is not None
    cursor_numbers = CURSOR_NUMBERS if has_cursor and chart_width >= 27 else 0
    chart_width -= cursor_numbers
    top = 1 if height >= 4 else 0
    axis_rows = 2 if chart_width and height - top - 2 >= min(2, len(rows)) else 0
    space = max(1, height - top - axis_rows)
    shown = min(len(rows), space)
    step = 1
    if lines is not None and chart_width and shown == len(rows) > 1:
        step = max(1, min(MOST, (space - 1) // (shown - 1)))
    first = 0
    if selected is not None and len(rows) > space:
        first = min(max(0, selected - space // 2), len(rows) - space)
    numbers_at = width - numbers - cursor_numbers
    return OverviewLayout(
        name, name + 3, chart_width, numbers_at, top, first, shown, axis_rows, step, cursor_numbers
    )


def overview_panels(
    rows: Sequence[OverviewRow],
    baseline: float | None,
    selected: int | None,
    size: Size,
    lines: OverviewLines | None = None,
) -> tuple[PlotArea, ...]:
    """One range of accuracies per visible run, named like the run.

    With lines, the leftmost column includes all accuracies below the axis.
    """
    width, height = max(1, size[0]), max(1, size[1])
    layout = overview_layout(rows, selected, (width, height), lines)
    if not layout.chart_width:
        return ()
    model = overview_model(rows, baseline, lines)
    panels = []
    for index in range(layout.first, layout.first + layout.shown):
        held = [
            y for y in range(layout.top, layout.top + layout.height) if layout.run_at(y) == index
        ]
        place = layout.chart, held[0], layout.chart_width, len(held)
        to_data = partial(_to_data, layout, model.axis, held[0], lines is not None)
        to_cells = partial(_to_cells, layout, model.axis, held[0])
        panels.append(PlotArea(model.rows[index].run, "range", *place, to_data, to_cells))
    return tuple(panels)


def row_in_panel(panel: PlotArea, index: int, runs: int) -> int:
    """The row of run `index` of `runs` in its panel, which reaches half-way to the next runs."""
    if index == 0:
        return panel.y
    return panel.y + (panel.height - 1 if index == runs - 1 else panel.height // 2)


def _to_data(
    layout: OverviewLayout, axis: Interval, top: int, open_below: bool, column: float, row: float
) -> Point:
    at = column - layout.chart
    if open_below and at < 1:
        return 0.0, row - top
    share = (at - 0.5) / max(1, layout.chart_width - 1)
    return axis[0] + share * (axis[1] - axis[0]), row - top


def _to_cells(layout: OverviewLayout, axis: Interval, top: int, value: float, row: float) -> Point:
    last = layout.chart_width - 1
    place = min(float(last), max(0.0, axis_share(value, axis) * last))
    return layout.chart + 0.5 + place, row + top
