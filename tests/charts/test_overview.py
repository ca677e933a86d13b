"""The overview: marks, numbers, baseline and scrolling."""

from __future__ import annotations

import pytest

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.charts.overview.layout import overview_layout
from s2rtui.charts.overview.model import overview_model
from s2rtui.charts.overview.terminal import draw_overview
from s2rtui.charts.scene import OverviewRow
from tests.charts.examples import ROWS

SIZE = (70, 10)


def test_the_axis_covers_all_values_with_round_limits() -> None:
    low, high = overview_model(ROWS, 0.72).axis
    assert low <= 0.72
    assert high >= 0.96
    assert (100 * low) % 5 == pytest.approx(0, abs=1e-9)


def test_the_gap_is_drawn_between_real_and_sim() -> None:
    line = draw_overview(ROWS, 0.72, 0, SIZE).lines()[1]
    assert line.index("◇") < line.index("◆")
    assert "━" in line[line.index("◇") : line.index("◆")]


def test_accuracies_are_written_or_n_a() -> None:
    lines = draw_overview(ROWS, 0.72, 0, SIZE).lines()
    assert lines[1].split()[-2:] == ["95.0", "78.0"]
    assert lines[3].split()[-2:] == ["n/a", "n/a"]
    assert "no unseen instance" in lines[3]


def test_the_baseline_has_the_same_column_in_every_line() -> None:
    lines = draw_overview(ROWS, 0.72, None, SIZE).lines()
    columns = {line.index("┊") for line in lines[1:3]}
    assert len(columns) == 1


def test_marks_of_equal_accuracy_are_merged() -> None:
    line = draw_overview([OverviewRow("same", 0.9, 0.9)], None, 0, SIZE).lines()[1]
    assert "◈" in line


def test_selected_line_is_marked_by_glyph_and_ground() -> None:
    canvas = draw_overview(ROWS, 0.72, 1, SIZE)
    assert canvas.char[2, 0] == "▶"
    assert (canvas.bg[2] == DARK.highlight).all()
    assert not (canvas.bg[1] == DARK.highlight).any()


def test_ascii_letters_replace_colours() -> None:
    text = "\n".join(
        draw_overview(ROWS, 0.72, 0, SIZE, RenderOptions(mode=ColourMode.NONE, ascii=True)).lines()
    )
    assert text.isascii()
    assert "S" in text
    assert "R" in text


def test_the_visible_rows_follow_the_selected_run() -> None:
    rows = [OverviewRow(f"run{index}", 0.9, 0.8) for index in range(40)]
    for selected in (0, 17, 39):
        layout = overview_layout(rows, selected, (60, 8))
        assert layout.first <= selected < layout.first + layout.shown
        assert layout.run_at(layout.top) == layout.first
        assert layout.run_at(layout.top + layout.shown) is None


def test_an_overview_without_runs_shows_a_message() -> None:
    assert "no run" in draw_overview([], None, None, SIZE).lines()[0]
