"""HTML reports: self-contained, consistent with the store and deterministic."""

import asyncio
import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rstore.metrics import pose_metrics, run_metrics
from s2rtui.cli import main
from s2rtui.export.report.build_report import render_report
from s2rtui.export.report.report_model import ReportRequest, RequestedSelection
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import chromium, tiny
from tests.support.small_figures import draw_small_figures

WORST = ReportRequest((RequestedSelection("worst15"),), runs=("dataaug",), theme="light")
VOID_TAGS = ("img", "meta", "source", "br", "hr", "input", "link")


class Page(HTMLParser):
    """Parsed HTML: tags with attributes and tables as rows of texts; checks the nesting of tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.texts: list[tuple[str, str]] = []
        self._caption = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID_TAGS:
            self.open.append(tag)
        if tag == "tr":
            self.tables[self._caption].append([])
        if tag in ("td", "th"):
            self.tables[self._caption][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open:
            return
        if self.open[-1] == "caption":
            self._caption = data
            self.tables[data] = []
        elif self.open[-1] in ("td", "th"):
            self.tables[self._caption][-1][-1] += data
        elif data.strip():
            self.texts.append((self.open[-1], data.strip()))

    def elements(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]

    def texts_in(self, tag: str) -> list[str]:
        return [text for name, text in self.texts if name == tag]


@pytest.fixture(scope="module")
def html(tiny_store: Path) -> str:
    return render_report(tiny_store, WORST).decode()


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


@pytest.fixture
def small_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    draw_small_figures(monkeypatch)


def test_a_report_is_self_contained(html, page):
    assert page.elements("script") == [{}]
    script = html.partition("<script>")[2].partition("</script>")[0]
    digest = b64encode(sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in html
    assert not page.elements("link")
    addresses = [a.get("src") or a.get("href") or a.get("srcset") for _, a in page.tags]
    assert all(a.startswith(("data:image/", "#")) for a in addresses if a)
    assert not re.search(r"url\(|@import|https?://|onload|onclick", html)
    assert "default-src 'none'" in html


def test_a_report_is_accessible_without_images(page):
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    images = page.elements("img")
    assert len(images) == 2 + 5 + 3 * 4
    assert all(re.search(r"\d", str(image["alt"])) for image in images)
    assert all(image["width"] and image["height"] for image in images)
    assert all(cell["scope"] in ("row", "col") for cell in page.elements("th"))
    assert page.elements("html")[0]["lang"] == "en"
    anchors = {a["id"] for _, a in page.tags if "id" in a}
    assert {str(link["href"])[1:] for link in page.elements("a")} <= anchors


def test_the_numbers_equal_those_of_the_store(tiny_store, page):
    with s2rstore.open(tiny_store) as store:
        selected = evaluation.select(store, "worst15", "dataaug")
        held_out_selected = selected & run_metrics.population(store, "dataaug")
        columns, truth = store.run_columns("dataaug"), store.instances
        held_out = run_metrics.population(store, "dataaug")
        centre = truth.x[held_out].mean(), truth.y[held_out].mean()
        distances = np.hypot(
            truth.x[held_out_selected] - centre[0], truth.y[held_out_selected] - centre[1]
        )
        chance = pose_metrics.accuracy(distances, store.dataset.accuracy_scale).mean()
        table = page.tables["Run dataaug on the selection"]
        for row, part in zip(table[1:], (columns.sim, columns.real), strict=True):
            accuracy = part.accuracy[held_out_selected].mean()
            turns = np.degrees(part.heading_error[held_out_selected])
            held = (part.error[held_out_selected] <= 1) & (turns <= 10)
            assert row[1] == f"{np.median(part.error[held_out_selected]):.2f} m"
            assert row[2] == f"{np.median(turns):.1f}°"
            assert row[3].startswith(f"{100 * held.mean():.1f} %")
            assert row[5].startswith(f"{100 * accuracy:.1f} %")
            assert row[6] == f"{100 * chance:.1f} %"
            assert row[8] == f"{part.error[held_out_selected].max():.2f} m"
            assert row[9:] == [str(int(held_out_selected.sum())), "0"]
        assert 0 < held_out_selected.sum() == selected.sum()
        assert f"{int(selected.sum())} of 40 instances" in page.texts_in("dd")
        worst = np.flatnonzero(selected)[np.argsort(-columns.real.error[selected])][:3]
    assert page.texts_in("h5") == [f"Instance {iid}" for iid in worst]
    assert f"tiny.s2r, generation {_generation(tiny_store)}" in page.texts_in("dd")
    assert "0" * 16 in page.texts_in("dd")


def test_all_runs_are_compared_on_the_same_instances(tiny_store, page):
    with s2rstore.open(tiny_store) as store:
        selected = evaluation.select(store, "worst15", "dataaug")
        rows = page.tables["The instances that it selects in dataaug, in every run"]
        for row in rows[1:]:
            real = run_metrics.side_metrics(store, row[0], "real", selected)
            assert row[8].startswith(f"{100 * real.accuracy.value:.1f} %")
            assert row[2] == f"{real.median_error:.2f} m"
    assert [row[0] for row in rows[1:]] == list(tiny.RUNS)


def test_a_report_is_deterministic_and_has_a_date_only_on_request(tiny_store, html):
    assert render_report(tiny_store, WORST).decode() == html
    assert not re.search(r"20\d\d-\d\d", re.sub(r"base64,[^\"]+", "", html))


@pytest.mark.usefixtures("small_figures")
def test_dark_figures_are_used_on_dark_screens(tiny_store):
    request = ReportRequest((RequestedSelection("ids(3)"),))
    page = Page(render_report(tiny_store, request).decode())
    sources = page.elements("source")
    assert len(sources) == 2 + 5
    assert all(
        str(s["media"]).startswith("screen and (prefers-color-scheme: dark)") for s in sources
    )


@pytest.mark.usefixtures("small_figures")
def test_a_report_contains_saved_selections_tags_and_notes(tiny_store, tmp_path):
    notebook = Notebook("0" * 64)
    notebook.save("bad", SavedSelection("worst(4, real.error)", 1, "dataaug", 9))
    notebook.save("gone", SavedSelection("room:cellar", 1, "vanilla", 3))
    notebook.save("empty", SavedSelection("real.error < 0", 1, "vanilla", 0))
    with s2rstore.open(tiny_store) as store:
        iid = int(np.argmax(store.run_columns("dataaug").real.error))
    notebook.toggle_tag([iid], "door")
    notebook.note(iid, "<script>alert(1)</script> & more")
    out = tmp_path / "r.html"
    words = ("--theme", "light", "--date", "1 March", "--title", "A & B <i>")
    assert main(["report", str(tiny_store), "--out", str(out), *words]) == 0
    page = Page(out.read_text(encoding="utf-8"))
    assert page.texts_in("h1") == ["A & B <i>"]
    assert "1 March" in page.texts_in("p")
    assert page.texts_in("h2") == ["All runs", "@bad", "@empty", "@gone"]
    assert "9 instances of run dataaug at generation 1" in page.texts_in("dd")
    assert "4 of 40 instances" in page.texts_in("dd")
    assert page.texts_in("h3") == ["Run dataaug"]
    assert page.tables["Tags and notes"][1:] == [
        [str(iid), "door", "<script>alert(1)</script> & more"]
    ]
    assert page.texts_in("blockquote") == ["<script>alert(1)</script> & more"]
    assert page.texts_in("li").count("#door") == 1
    assert len(page.elements("script")) == 1
    texts = page.texts_in("p")
    assert sum("cellar" in text or "No instance" in text for text in texts) == 2


@pytest.mark.usefixtures("small_figures")
def test_expressions_runs_and_saved_selections_can_be_requested(tiny_store, tmp_path):
    Notebook("0" * 64).save("mine", SavedSelection("ids(1)", 1, "vanilla", 1))
    out = tmp_path / "r.html"
    words = ("--theme", "light", "--select", "ids(2)")
    arguments = ["report", str(tiny_store), "--out", str(out), *words]
    assert main([*arguments, "--run", "dataaug", "--run", "vanilla"]) == 0
    page = Page(out.read_text(encoding="utf-8"))
    assert page.texts_in("h3") == ["Run dataaug", "Run vanilla"]
    assert main([*arguments, "--saved"]) == 0
    page = Page(out.read_text(encoding="utf-8"))
    assert page.texts_in("h2") == ["All runs", "@mine"]
    assert page.texts_in("h3") == ["Run vanilla", "Run vanilla"]


@pytest.mark.usefixtures("small_figures")
def test_a_store_with_one_run_has_no_comparison(tmp_path):
    path = tiny.build(tmp_path / "one.s2r", runs=("only",))
    selections = RequestedSelection("none"), RequestedSelection("all")
    page = Page(render_report(path, ReportRequest(selections, theme="light")).decode())
    assert len(page.elements("img")) == 1 + 5 + 3 * 4
    assert "No instance is selected." in page.texts_in("p")


@pytest.mark.usefixtures("small_figures")
def test_a_requested_heatmap_is_drawn_on_the_images(tiny_store):
    plain = ReportRequest((RequestedSelection("ids(3)"),), theme="light")
    requests = replace(plain, heat="occlusion:rgb"), plain
    with_heat, without = (Page(render_report(tiny_store, r).decode()) for r in requests)
    assert any("occlusion rgb" in text for text in with_heat.texts_in("figcaption"))
    assert not any("occlusion" in text for text in without.texts_in("figcaption"))
    sources = [[image["src"] for image in page.elements("img")] for page in (with_heat, without)]
    assert sources[0] != sources[1]


def test_an_invalid_request_prints_one_line(tiny_store, tmp_path, s2r, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words, expected in (
        ("--out a.html", "--select"),
        ("--out a.pdf --select all", ".html"),
        ("--out a.html --select rubbish", "rubbish"),
        ("--out a.html --select all --run nobody", "nobody"),
        ("--out a.html --select all --heat nothing", "--heat"),
        ("--out a.html --select all --trajectory c", "--trajectory"),
        ("--out a.html --select all --with nobody", "--with"),
        ("--out no/a.html --select none", "there is no folder"),
    ):
        lines = s2r("report", tiny_store, *words.split()).checked(2).err.splitlines()
        (error,) = (line for line in lines if line.startswith("s2r:"))
        assert expected in error
        assert not list(tmp_path.glob("a.*")), words


def test_an_unknown_name_is_rejected_before_drawing(tiny_store):
    request = ReportRequest((RequestedSelection("all"), RequestedSelection("@nobody")))
    with pytest.raises(RequestError, match=r"no saved selection 'nobody', nor any other$"):
        render_report(tiny_store, request, lambda *_: pytest.fail("a step is started"))


def _generation(path: Path) -> int:
    with s2rstore.open(path) as store:
        return store.generation


@pytest.mark.usefixtures("small_figures")
def test_findings_lead_with_the_run_and_selection_that_were_asked_for(tmp_path):
    """Findings of the first run, if it was not asked for, come last and say so."""
    path = tiny.build(tmp_path / "s.s2r", 40)
    request = ReportRequest((RequestedSelection("seq >= 10"),), runs=("dataaug",))
    page = Page(render_report(path, request).decode())
    expressions = [text for text in page.texts_in("code") if text.startswith("room:")]
    with s2rstore.open(path) as store:
        assert all(evaluation.select(store, each, "dataaug").any() for each in expressions)
    assert expressions
    found = page.texts_in("li")
    found = [line for line in found if re.match("(not asked for: )?(worst|best|largest)", line)]
    assert found[0].startswith("worst room of dataaug in seq >= 10: ")
    marked = [line.startswith("not asked for: ") for line in found]
    assert marked == sorted(marked)
    assert any(marked)
    assert all((" of vanilla: " in line) == mark for line, mark in zip(found, marked, strict=True)
               if "best run" not in line)  # fmt: skip
    first = ReportRequest((RequestedSelection("all"),))
    assert "not asked for" not in render_report(path, first).decode()


@pytest.mark.skipif(chromium.missing_program() is not None, reason="needs chromium")
async def test_a_click_on_a_head_sorts_the_rows_and_another_one_reverses_them(html, tmp_path):
    file = tmp_path / "r.html"
    file.write_text(html, encoding="utf-8")
    rows = """[...document.querySelector("#front tbody").rows].map(
        (row) => parseFloat(row.cells[2].textContent))"""
    click = "document.querySelector('#front thead').rows[0].cells[2].click()"
    async with chromium.browser(tmp_path / "profile") as page:
        await page.open(file.as_uri())
        while len(await page.evaluate(rows) or ()) < 2:
            await asyncio.sleep(0.05)
        stored = await page.evaluate(rows)
        for order in (sorted(stored, reverse=True), sorted(stored)):
            await page.evaluate(click)
            assert await page.evaluate(rows) == order
        assert not page.failures
