"""Exports of the application: reports, rows and screenshots, and their restrictions."""

from __future__ import annotations

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
from s2rtui.app.messages import BackgroundFailed
from s2rtui.app.pilot import settle
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.canvas import RenderOptions
from s2rtui.cli import main
from s2rtui.export.exclusive_files import create_exclusive, numbered_paths
from s2rtui.export.rows import formats, selected_instances
from s2rtui.jobs.background_thread import wait_until_idle
from s2rtui.security import Permissions
from s2rtui.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection


def make_app(store: Path, folder: Path, restricted: bool = False) -> S2RApp:
    access = Permissions.for_store(store, restricted)
    app = S2RApp(Session(store, notebooks=Notebook), RenderOptions(), folder, access)
    app.load_scheduler.debounce_seconds = 0.001
    return app


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)


async def answer(app: S2RApp, pilot: Pilot[None], text: str) -> str:
    app.query_one(QueryInput).value = text
    await press(app, pilot, "enter")
    return app.session.state.message


async def test_the_report_contains_saved_selections(tiny_store: Path, tmp_path: Path) -> None:
    notebook = Notebook("0" * 64)
    notebook.save("mine", SavedSelection("worst15", 1, "dataaug", 6))
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(100, 30)) as pilot:
        await settle(app, pilot)
        await pilot.press("E")
        await pilot.press("E")
        await settle(app, pilot)
        assert app.session.state.message == f"wrote {tmp_path / 's2r-report-001.html'}"
        assert len(list(tmp_path.glob("*.html"))) == 1
        await press(app, pilot, "E")
    text = (tmp_path / "s2r-report-001.html").read_text(encoding="utf-8")
    assert "<h2>@mine</h2>" in text
    assert "<h3>Run dataaug</h3>" in text
    assert (tmp_path / "s2r-report-002.html").read_text(encoding="utf-8") == text


async def test_the_report_contains_the_current_selection(tiny_store: Path, tmp_path: Path) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "b", "r", "E")
    text = (tmp_path / "s2r-report-001.html").read_text(encoding="utf-8")
    assert "<h2><code>best15</code></h2>" in text
    assert "<h3>Run dataaug</h3>" in text


async def test_the_exported_rows_equal_those_of_s2r_query(tiny_store: Path, tmp_path: Path) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message.endswith("s2r-selection-001.csv: 6 of 40 instances")
        await press(app, pilot, "F")
        shown = await answer(app, pilot, "mine.json")
        assert shown.endswith("mine.json: 6 of 40 instances")
    out = tmp_path / "by command.json"
    arguments = [
        "query",
        str(tiny_store),
        "worst15",
        "--with-expression",
        "--json",
        "--out",
        str(out),
    ]
    assert main(arguments) == 0
    assert json.loads((tmp_path / "mine.json").read_text()) == json.loads(out.read_text())


@pytest.mark.parametrize("expression", ["worst15", "all", "none", "room:right | ids(3, 7)"])
def test_rows_of_a_selection_equal_rows_of_its_expression(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch, expression: str
) -> None:
    monkeypatch.setattr(selected_instances, "_BLOCK_IIDS", 7)
    with s2rstore.open(tiny_store) as store:
        expected = selected_instances.selected_rows(store, expression)
        selected = evaluation.select(store, expression)
        monkeypatch.setattr(evaluation, "sql", lambda *_: 1 / 0)
        assert selected_instances.selected_rows(store, expression, selected=selected) == expected


def test_an_unexpected_error_is_shown_in_one_line(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    messages: list[BackgroundFailed] = []
    app.post, app._running = messages.append, True

    def failing_job() -> None:
        raise MemoryError("out of memory\nadvice")

    app.jobs.start(failing_job, "a.csv is not written")
    assert wait_until_idle(5.0)
    assert [message.text for message in messages] == [
        "a.csv is not written (MemoryError: out of memory advice)"
    ]


@pytest.mark.parametrize("name", ["mine.txt", "there.csv", "no/where.json", "no/where.parquet", ""])
async def test_an_unusable_file_name_is_rejected(
    tiny_store: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / "there.csv").write_text("kept")
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "F")
        await answer(app, pilot, name)
        assert app.session.state.is_error
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["there.csv"]
    assert (tmp_path / "there.csv").read_text() == "kept"


@pytest.mark.parametrize("name", ["~nosuchuser/a.csv", "nul\0.csv", "half\ud800.csv"])
async def test_an_invalid_path_is_rejected(tiny_store: Path, tmp_path: Path, name: str) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        with pytest.raises(RequestError, match="is not a path"):
            app.export.write_selection(name)


async def test_two_simultaneous_exports_write_two_files(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    release = Event()
    write_rows = formats.write_rows

    def blocking_write(*arguments: Any) -> None:
        assert release.wait(30)
        write_rows(*arguments)

    monkeypatch.setattr(formats, "write_rows", blocking_write)
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
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


async def test_a_file_created_during_the_export_is_not_overwritten(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, write_rows = tmp_path / "s2r-selection-001.csv", formats.write_rows

    def write_after_other_process(*arguments: Any) -> None:
        target.write_text("another's")
        write_rows(*arguments)

    monkeypatch.setattr(formats, "write_rows", write_after_other_process)
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message == f"{target}: exists already; choose another name"
    assert target.read_text() == "another's"
    assert not list(tmp_path.glob(".*csv"))


async def test_a_report_can_be_repeated_after_an_error(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing_report(*_: object) -> None:
        raise ZeroDivisionError("oh")

    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        with monkeypatch.context() as patch:
            patch.setattr("s2rtui.export.report.build_report.session_report", failing_report)
            await press(app, pilot, "E")
        assert "ZeroDivisionError: oh" in app.session.state.message
        await press(app, pilot, "E")
        assert app.session.state.message == f"wrote {tmp_path / 's2r-report-001.html'}"


def test_an_existing_numbered_file_is_skipped(tmp_path: Path) -> None:
    names = numbered_paths(tmp_path, "a", ".txt")

    def fill(path: Path) -> None:
        (tmp_path / "a-001.txt").write_text("another's")
        path.write_text("mine")

    assert create_exclusive(next(names), fill, names)[0] == tmp_path / "a-002.txt"
    assert (tmp_path / "a-001.txt").read_text() == "another's"
    assert (tmp_path / "a-002.txt").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


async def test_a_restricted_session_writes_only_to_the_user_data_folder(
    tiny_store: Path, tmp_path: Path, user_data_folder: Path
) -> None:
    app = make_app(tiny_store, tmp_path, restricted=True)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "w")
        for key in ("E", "s", "F"):
            await press(app, pilot, key)
            assert app.session.state.is_error
            assert str(user_data_folder) in app.session.state.message
        assert not app.prompt.is_open
        app.output_folder = user_data_folder
        await press(app, pilot, "F")
        assert "restricted" in await answer(app, pilot, str(tmp_path / "a.csv"))
        assert (await answer(app, pilot, "a.csv")).endswith("a.csv: 6 of 40 instances")
        await press(app, pilot, "s")
    assert not list(tmp_path.glob("*.*"))
    assert (user_data_folder / "a.csv").exists()
    assert (user_data_folder / "s2r-001.png").exists()
