"""Translators below the overview: order, verdicts and gains."""

from dataclasses import replace

import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.charts.overview.translators import (
    MOST_READ,
    block_height,
    draw_translators,
    ordered,
    translator_rows,
)
from s2rtui.charts.overview.view import VIEW
from s2rtui.charts.scene import LoadedData, Scene, TranslatorGain, TranslatorRow
from s2rtui.session import Session

ROWS = (
    TranslatorRow("mkl-real2sim", "real2sim", True,
                  (TranslatorGain("vanilla", 1.2, (0.84, 1.57)),)),
    TranslatorRow("fda", "real2sim", True,
                  (TranslatorGain("vanilla", 0.3, (-0.2, 0.8)),
                   TranslatorGain("other", -0.5, (-0.9, -0.1)),
                   TranslatorGain("shifted", 0.4, (0.1, 0.7), trained=True))),
    TranslatorRow("a-name-that-is-much-too-long", "sim2real", False),
    TranslatorRow("new", "sim2real", None),
)  # fmt: skip


def test_a_gain_is_claimed_only_where_its_interval_excludes_zero():
    lines = draw_translators(ROWS, "vanilla", (80, 5), RenderOptions()).lines()
    assert "accepted  gain +1.20 m (0.84 to 1.57) on vanilla" in lines[1]
    assert "no clear gain on vanilla" in lines[2]
    assert "refused" in lines[3]
    assert "not judged" in lines[4]


@pytest.mark.parametrize("size", [(10, 2), (24, 3), (55, 6), (120, 6)])
def test_the_block_fits_every_size(size):
    canvas = draw_translators(
        ROWS, "vanilla", size, RenderOptions(mode=ColourMode.NONE, ascii=True)
    )
    lines = canvas.lines()
    assert len(lines) == size[1]
    assert all(len(line) <= size[0] for line in lines)
    assert "\n".join(lines).isascii()


def test_the_block_counts_and_cuts_what_does_not_fit():
    (line,) = draw_translators(ROWS[:1], "vanilla", (50, 2), RenderOptions()).lines()[1:]
    assert line.rstrip().endswith("(0.84 to …")
    assert "2 of 4" in draw_translators(ROWS, "vanilla", (60, 3), RenderOptions()).lines()[0]
    assert " of " not in draw_translators(ROWS, "vanilla", (60, 5), RenderOptions()).lines()[0]
    assert block_height(ROWS, 4, 20) == 5
    assert block_height(ROWS, 4, 8) == 0
    assert block_height((), 4, 20) == 0


def test_gains_are_those_of_the_present_run_and_name_the_metric():
    row = ROWS[1]
    assert row.gain_text("vanilla") == "no clear gain on vanilla; harms other"
    assert row.gain_text("other") == "gain -0.50 m (-0.90 to -0.10) on other"
    assert row.gain_text("shifted") == (
        "training gain +0.40 m (0.10 to 0.70) of shifted; harms other"
    )
    assert row.gain_text("unjudged") == "harms other"


def test_the_present_run_decides_what_the_view_shows(tiny_store):
    gains = (TranslatorGain("vanilla", 1.0, (0.5, 1.5)), TranslatorGain("dataaug", 2.0, (1.5, 2.5)))
    resources = LoadedData(translators=(TranslatorRow("mkl", "real2sim", True, gains),))
    session = Session(tiny_store)
    scenes = [
        Scene(session.store, replace(session.state, run=run), resources)
        for run in ("vanilla", "dataaug")
    ]
    session.close()
    texts = ["\n".join(VIEW.draw(scene, (90, 30), RenderOptions()).lines()) for scene in scenes]
    assert "+1.00 m" in texts[0]
    assert "+2.00 m" not in texts[0]
    assert "+2.00 m" in texts[1]
    assert VIEW.cache_key(scenes[0]) != VIEW.cache_key(scenes[1])
    assert "gain +2.00 m (1.50 to 2.50) on dataaug" in VIEW.summary(scenes[1])


def test_accepted_translators_with_the_largest_gain_come_first(store_copy):
    for name in ("a", "b", "c"):
        fit_into_store(store_copy, FitRequest("mkl", name, "real2sim"), "")
    figures = (
        ("a", True, "error_gain", "vanilla", 0.5), ("b", True, "error_gain", "vanilla", 1.5),
        ("c", False, "error_gain", "vanilla", 9.0), ("a", True, "error_gain", "dataaug", 5.0),
        ("a", True, "trained_error_gain", "vanilla", 7.0),
    )  # fmt: skip
    with edit(store_copy) as draft:
        for name, accepted, metric, run, gain in figures:
            draft.update("translator", {"translator": name}, {"accepted": accepted})
            draft.insert_row(
                "translator_metric",
                {
                    "translator": name, "metric": metric, "reference": "translator",
                    "run": run, "value": gain, "low": gain - 0.1, "high": gain + 0.1,
                },
            )  # fmt: skip
    with s2rstore.open(store_copy) as store:
        rows = translator_rows(store)
    assert [row.translator for row in ordered(rows, "vanilla")] == ["b", "a", "c"]
    assert [row.translator for row in ordered(rows, "dataaug")] == ["a", "b", "c"]
    (a,) = (row for row in rows if row.translator == "a")
    assert [(gain.run, gain.value, gain.trained) for gain in a.gains] == [
        ("dataaug", 5.0, False), ("vanilla", 0.5, False), ("vanilla", 7.0, True),
    ]  # fmt: skip
    assert a.gains[0].interval == pytest.approx((4.9, 5.1))


def test_the_number_of_gains_that_are_read_is_limited(store_copy):
    fit_into_store(store_copy, FitRequest("mkl", "t", "real2sim"), "")
    with edit(store_copy) as draft:
        draft.rows(
            "INSERT INTO translator_metric (translator, metric, reference, run, value) "
            "SELECT 't', 'error_gain', 'translator', 'run' || range, 0 FROM range(5000)"
        )
    with s2rstore.open(store_copy) as store:
        (row,) = translator_rows(store)
    assert len(row.gains) == MOST_READ
