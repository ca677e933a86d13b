"""No view shows a part of a number at any size."""

from __future__ import annotations

import re

import numpy as np
import pytest
from rich.cells import cell_len

from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.charts.errors.terminal import draw_errors
from s2rtui.charts.umap.terminal import draw_umap
from tests.charts.examples import N, errors_input, umap_input
from tests.charts.test_every_size import VIEWS

Written = list[tuple[Canvas, int, int, str]]


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> Written:
    """All texts with their canvas and the cell where they begin."""
    texts: Written = []
    write = Canvas.text

    def text(self, x, y, text, fg=None, bg=None, bold=False, align="left"):
        shift = {"left": 0, "right": cell_len(text), "center": cell_len(text) // 2}[align]
        texts.append((self, x - shift, y, text))
        return write(self, x, y, text, fg, bg, bold, align)

    monkeypatch.setattr(Canvas, "text", text)
    return texts


@pytest.mark.parametrize("name", VIEWS)
def test_no_view_shows_a_part_of_a_number(name: str, written: Written) -> None:
    for size in ((16, 6), (24, 10), (50, 14), (80, 23)):
        VIEWS[name](size, RenderOptions())
        for canvas, x, y, text in written:
            for number in re.finditer(r"[-+]?\d[\d.]*", text):
                columns = range(x + number.start(), x + number.end())
                if not 0 <= y < canvas.height or not text.isascii():
                    continue
                shown = [
                    0 <= column < canvas.width and canvas.char[y, column] == glyph
                    for column, glyph in zip(columns, number[0], strict=True)
                ]
                assert all(shown) or not any(shown), (size, text, canvas.lines()[y])
        written.clear()


@pytest.mark.parametrize("median", [0.018, 0.088, 0.00123, 12.3, 123456.0, 2e-5])
def test_the_median_of_the_errors_is_whole(median: float) -> None:
    errors = np.full(N, median)
    lines = draw_errors(errors_input(sim=errors, real=errors), (60, 12)).lines()
    found = re.findall(r"median (\S+)", "\n".join(lines))
    assert len(found) == 2
    assert all(float(text) == pytest.approx(median, rel=0.05) for text in found)


def test_the_numbers_at_a_umap_are_whole() -> None:
    points = np.linspace(-12.5, -9.5, 2 * N).reshape(N, 2)
    canvas = draw_umap(umap_input(sim=points, real=points), (120, 40))
    texts = {line[:5].strip() for line in canvas.lines()} - {""}
    numbers = {float(text) for text in texts if re.fullmatch(r"-?[\d.]+", text)}
    assert len(numbers) >= 2
    assert all(not text.endswith(".") for text in texts)
    assert len({round(step, 9) for step in np.diff(sorted(numbers))}) == 1
