"""Legends are wrapped and marked where cut; every finding is visible in cells and on paper."""

from dataclasses import replace
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from s2rstore.intervals.interval import Bound
from s2rtui.canvas import DARK, Canvas, RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.drawing.legend import (
    colour_bar,
    cut_rows,
    draw_rows,
    fit_rows,
    role_legend,
    text_part,
)
from s2rtui.session.session import Session
from tests.charts.examples import finding_report

OPTIONS = RenderOptions()
words = st.text("abcdefgh", min_size=1, max_size=12)
labels = st.lists(words, min_size=1, max_size=8).map(" ".join)


def drawn(parts: list, width: int, most: int | None = None) -> list[str]:
    rows = cut_rows(fit_rows(parts, width), width, most, OPTIONS)
    canvas = Canvas(width, max(1, len(rows)), OPTIONS)
    draw_rows(canvas, 0, 0, rows)
    return canvas.lines()


@given(st.lists(labels, min_size=1, max_size=6), labels, st.integers(40, 160))
def test_every_word_appears(texts, label, width):
    parts = [text_part(((text, DARK.muted),)) for text in texts]
    parts += colour_bar(label, "m", (0.25, 17.5), OPTIONS, room=width, clipped=True)
    parts.append(role_legend(OPTIONS, sim="simulated", real="real", truth="true position"))
    shown = " ".join(drawn(parts, width)).split()
    wanted = " ".join([*texts, label, "p1 0.25 p99 18 m simulated real true position"]).split()
    assert [word for word in shown if word in wanted] == wanted


@given(st.lists(labels, min_size=1, max_size=9), st.integers(40, 90), st.integers(1, 4))
def test_an_ellipsis_marks_what_is_left_out(texts, width, most):
    parts = [text_part(((text, DARK.muted),)) for text in texts]
    lines = drawn(parts, width, most)
    assert len(lines) <= most
    shown, wanted = " ".join(lines).split(), " ".join(texts).split()
    if shown[-1] == "\u2026":
        assert shown[:-1] == wanted[: len(shown) - 1]
        assert len(shown) <= len(wanted)
    else:
        assert shown == wanted


def test_a_glyph_stays_beside_its_word_and_a_wide_word_is_cut():
    part = role_legend(OPTIONS, sim="simulation", real="reality", truth="ground")
    for width in range(14, part.width):
        for line in drawn([part], width):
            assert not line.rstrip().endswith(tuple("\u25c6\u25c7\u2022"))
    assert cell_len(drawn([text_part((("a" * 30, DARK.muted),))], 20)[0].rstrip()) == 20


def test_rows_of_findings_mark_bounds_beyond_all_values(tiny_store):
    report = finding_report(1)
    interval = SimpleNamespace(bounds=(Bound(0.4, "<"), Bound(9.25, ">")))
    report = replace(report, findings=(replace(report.findings[0], interval=interval),))
    session = Session(tiny_store)
    scene = Scene(session.store, session.state, LoadedData(findings=report))
    names, (row,) = BY_NAME["findings"].numbers(scene)
    values = dict(zip(names, row, strict=True))
    assert (f"{values['low']:.4g}", f"{values['high']:.4g}") == ("<0.4", ">9.25")
