"""Exports of the application: reports, rows and screenshots, and their restrictions."""

import json
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from textual.pilot import Pilot

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.cli import main
from s2rtui.export import rows as exported_rows
from s2rtui.export.exclusive_files import create_exclusive, numbered_paths
from s2rtui.user_data.notebook import SavedSelection
from tests.support.application import press, running
from tests.support.small_figures import draw_small_figures


async def answer(app: S2RApp, pilot: Pilot[None], text: str) -> str:
    app.query_one(QueryInput).value = text
    await press(app, pilot, "enter")
    return app.session.state.message


async def test_reports_contain_saved_selections_or_the_present_one(
    tiny_store, tmp_path, monkeypatch
):
    def failing_report(*_: object) -> None:
        raise ZeroDivisionError("oh\nadvice")

    draw_small_figures(monkeypatch)
    async with running(tiny_store, folder=tmp_path, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "b", "r")
        with monkeypatch.context() as patch:
            patch.setattr("s2rtui.export.report.build_report.session_report", failing_report)
            await press(app, pilot, "E")
        assert "ZeroDivisionError: oh advice" in app.session.state.message
        for _ in range(2):
            app.export.write_report()
        assert app.session.state.message == "a report is being written"
        await settle(app, pilot)
        assert app.session.state.message == f"wrote {tmp_path / 's2r-report-001.html'}"
        assert len(list(tmp_path.glob("*.html"))) == 1
        saved = SavedSelection("worst15", 1, "vanilla", 6)
        app.session.writable_notebook.save("mine", saved)
        await press(app, pilot, "E")
    for number, heading, run in ((1, "<code>best15</code>", "dataaug"), (2, "@mine", "vanilla")):
        text = (tmp_path / f"s2r-report-00{number}.html").read_text(encoding="utf-8")
        assert f"<h2>{heading}</h2>" in text
        assert f"<h3>Run {run}</h3>" in text


async def test_the_exported_rows_equal_those_of_s2r_query(tiny_store, tmp_path):
    async with running(tiny_store, folder=tmp_path) as (app, pilot):
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message.endswith("s2r-selection-001.csv: 6 of 40 instances")
        await press(app, pilot, "F")
        shown = await answer(app, pilot, "mine.json")
        assert shown.endswith("mine.json: 6 of 40 instances")
    out = tmp_path / "by command.json"
    arguments = ["query", str(tiny_store), "worst15", "--with-expression", "--json"]
    assert main([*arguments, "--out", str(out)]) == 0
    assert json.loads((tmp_path / "mine.json").read_text()) == json.loads(out.read_text())


def test_the_rows_of_a_query_equal_those_of_the_sql_back_end(tiny_store, monkeypatch):
    monkeypatch.setattr(exported_rows, "_BLOCK_IIDS", 7)
    columns = ", ".join(exported_rows.COLUMNS)
    with s2rstore.open(tiny_store) as store:
        for expression in ("worst15", "all", "none", "room:right | ids(3, 7)"):
            rows = exported_rows.selected_rows(store, evaluation.query(store, expression))
            text, parameters = evaluation.sql(store, expression)
            query = f"SELECT {columns} FROM pair JOIN ({text}) USING (iid) WHERE run = 'vanilla'"
            assert rows.rows == store.execute(f"{query} ORDER BY iid", parameters)
            assert rows.facts["count"] == len(rows.rows)


async def test_unusable_file_names_are_rejected(tiny_store, tmp_path):
    (tmp_path / "there.csv").write_text("kept")
    async with running(tiny_store, folder=tmp_path, size=(80, 24)) as (app, pilot):
        for name in ("mine.txt", "there.csv", "no/where.json", "no/where.parquet", ""):
            await press(app, pilot, "F")
            await answer(app, pilot, name)
            assert app.session.state.is_error, name
            if app.prompt.is_open:
                await press(app, pilot, "escape")
        for name in ("~nosuchuser/a.csv", "nul\0.csv", "half\ud800.csv"):
            with pytest.raises(RequestError, match="is not a path"):
                app.export.write_selection(name)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["there.csv"]
    assert (tmp_path / "there.csv").read_text() == "kept"


async def test_two_simultaneous_exports_write_two_files(tiny_store, tmp_path, monkeypatch):
    release = Event()
    write_rows = exported_rows.write_rows

    def blocking_write(*arguments: Any) -> None:
        assert release.wait(30)
        write_rows(*arguments)

    monkeypatch.setattr(exported_rows, "write_rows", blocking_write)
    async with running(tiny_store, folder=tmp_path) as (app, pilot):
        await pilot.press("w", "F", "enter", "b", "F")
        line = app.query_one(QueryInput)
        assert line.value == "s2r-selection-002.csv"
        line.value = "s2r-selection-001.csv"
        await pilot.press("enter")
        assert "is being written" in app.session.state.message
        line.value = "s2r-selection-002.csv"
        await pilot.press("enter")
        release.set()
        await settle(app, pilot)
    first, second = (tmp_path / f"s2r-selection-00{n}.csv" for n in (1, 2))
    assert "worst15" in first.read_text()
    assert "best15" in second.read_text()
    assert len(list(tmp_path.iterdir())) == 2 + (tmp_path / "share").exists()


async def test_a_file_made_during_the_export_is_not_overwritten(tiny_store, tmp_path, monkeypatch):
    target, write_rows = tmp_path / "s2r-selection-001.csv", exported_rows.write_rows

    def write_after_other_process(*arguments: Any) -> None:
        target.write_text("another's")
        write_rows(*arguments)

    monkeypatch.setattr(exported_rows, "write_rows", write_after_other_process)
    async with running(tiny_store, folder=tmp_path) as (app, pilot):
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message == f"{target}: exists already; choose another name"
    assert target.read_text() == "another's"
    assert not list(tmp_path.glob(".*csv"))


def test_an_existing_numbered_file_is_skipped(tmp_path):
    names = numbered_paths(tmp_path, "a", ".txt")

    def fill(path: Path) -> None:
        (tmp_path / "a-001.txt").write_text("another's")
        path.write_text("mine")

    assert create_exclusive(next(names), fill, names)[0] == tmp_path / "a-002.txt"
    assert (tmp_path / "a-001.txt").read_text() == "another's"
    assert (tmp_path / "a-002.txt").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


async def test_a_restricted_session_writes_to_the_user_data_only(
    tiny_store, tmp_path, user_data_folder
):
    async with running(tiny_store, folder=tmp_path, restricted=True) as (app, pilot):
        await press(app, pilot, "w")
        for key in ("E", "s", "F"):
            await press(app, pilot, key)
            assert app.session.state.is_error
            assert str(user_data_folder) in app.session.state.message
        await press(app, pilot, "a")
        assert app.session.state.message.startswith("not in a restricted session: adjust")
        assert app.session.state.view != "adjust"
        assert not app.prompt.is_open
        app.output_folder = user_data_folder
        await press(app, pilot, "F")
        assert "restricted" in await answer(app, pilot, str(tmp_path / "a.csv"))
        assert (await answer(app, pilot, "a.csv")).endswith("a.csv: 6 of 40 instances")
        await press(app, pilot, "s")
    assert not list(tmp_path.glob("*.*"))
    assert (user_data_folder / "a.csv").exists()
    assert (user_data_folder / "s2r-001.png").exists()
