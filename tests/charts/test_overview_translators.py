"""Translators below the overview: order, verdicts and gains."""

from __future__ import annotations

from pathlib import Path

import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.charts.overview.translators import block_height, draw_translators, translator_rows
from s2rtui.charts.scene import TranslatorRow

ROWS = (
    TranslatorRow("mkl-real2sim", "real2sim", True, 1.2, (0.84, 1.57), "vanilla"),
    TranslatorRow("fda", "real2sim", True, 0.3, (-0.2, 0.8), "vanilla"),
    TranslatorRow("a-name-that-is-much-too-long", "sim2real", False),
    TranslatorRow("new", "sim2real", None),
)


def test_a_gain_is_claimed_only_where_its_interval_excludes_zero() -> None:
    lines = draw_translators(ROWS, (80, 5), RenderOptions()).lines()
    assert "accepted  gain +1.20 m (0.84 to 1.57) on vanilla" in lines[1]
    assert "no clear gain on vanilla" in lines[2]
    assert "refused" in lines[3]
    assert "not judged" in lines[4]


@pytest.mark.parametrize("size", [(10, 2), (24, 3), (55, 6), (120, 6)])
def test_the_block_fits_every_size(size: tuple[int, int]) -> None:
    canvas = draw_translators(ROWS, size, RenderOptions(mode=ColourMode.NONE, ascii=True))
    lines = canvas.lines()
    assert len(lines) == size[1]
    assert all(len(line) <= size[0] for line in lines)
    assert "\n".join(lines).isascii()


def test_the_header_counts_what_does_not_fit() -> None:
    assert "2 of 4" in draw_translators(ROWS, (60, 3), RenderOptions()).lines()[0]
    assert " of " not in draw_translators(ROWS, (60, 5), RenderOptions()).lines()[0]


def test_runs_come_first_where_space_is_short() -> None:
    assert block_height(ROWS, 4, 20) == 5
    assert block_height(ROWS, 4, 8) == 0
    assert block_height((), 4, 20) == 0


def test_accepted_translators_with_the_largest_gain_come_first(store_copy: Path) -> None:
    for name in ("a", "b", "c"):
        fit_into_store(store_copy, FitRequest("mkl", name, "real2sim"), "")
    with edit(store_copy) as draft:
        for name, accepted, gain in (("a", True, 0.5), ("b", True, 1.5), ("c", False, 9.0)):
            draft.update("translator", {"translator": name}, {"accepted": accepted})
            draft.insert_row(
                "translator_metric",
                {
                    "translator": name, "metric": "error_gain", "reference": "translator",
                    "run": "vanilla", "value": gain, "low": gain - 0.1, "high": gain + 0.1,
                },
            )  # fmt: skip
    with s2rstore.open(store_copy) as store:
        rows = translator_rows(store)
    assert [row.translator for row in rows] == ["b", "a", "c"]
    assert rows[0].interval == pytest.approx((1.4, 1.6))


def test_stores_without_translators_have_no_rows(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store:
        assert translator_rows(store) == ()
