"""Files written from the application: reports, rows, the screen; and where none may be written."""

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


async def test_a_report_of_what_is_saved(tiny_store: Path, tmp_path: Path) -> None:
    book = Notebook("0" * 64)
    book.save("mine", SavedSelection("worst15", 1, "dataaug", 6))
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


async def test_a_report_of_the_present_selection(tiny_store: Path, tmp_path: Path) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "b", "r", "E")
    text = (tmp_path / "s2r-report-001.html").read_text(encoding="utf-8")
    assert "<h2><code>best15</code></h2>" in text
    assert "<h3>Run dataaug</h3>" in text


async def test_the_selection_is_written_as_the_command_writes_it(
    tiny_store: Path, tmp_path: Path
) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message.endswith("s2r-selection-001.csv: 6 instances")
        await press(app, pilot, "F")
        told = await answer(app, pilot, "mine.json")
        assert told.endswith("mine.json: 6 instances")
    out = tmp_path / "by command.json"
    words = ["query", str(tiny_store), "worst15", "--with-expression", "--json", "--out", str(out)]
    assert main(words) == 0
    assert json.loads((tmp_path / "mine.json").read_text()) == json.loads(out.read_text())


@pytest.mark.parametrize("expression", ["worst15", "all", "none", "room:right | ids(3, 7)"])
def test_rows_of_what_is_selected_are_those_of_its_expression(
    tiny_store: Path, monkeypatch: pytest.MonkeyPatch, expression: str
) -> None:
    monkeypatch.setattr(selected_instances, "_BLOCK_IIDS", 7)
    with s2rstore.open(tiny_store) as store:
        wanted = selected_instances.selected_rows(store, expression)
        chosen = evaluation.select(store, expression)
        monkeypatch.setattr(evaluation, "sql", lambda *_: 1 / 0)
        assert selected_instances.selected_rows(store, expression, selected=chosen) == wanted


def test_a_fault_is_told_in_one_line(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    told: list[BackgroundFailed] = []
    app.post, app._running = told.append, True

    def broken() -> None:
        raise MemoryError("out of memory\nadvice")

    app.jobs.start(broken, "a.csv is not written")
    assert wait_until_idle(5.0)
    assert [each.text for each in told] == [
        "a.csv is not written (MemoryError: out of memory advice)"
    ]


@pytest.mark.parametrize("name", ["mine.txt", "there.csv", "no/where.json", "no/where.parquet", ""])
async def test_a_file_that_cannot_be_is_refused(
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
async def test_what_is_no_path_is_refused(tiny_store: Path, tmp_path: Path, name: str) -> None:
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        with pytest.raises(RequestError, match="is not a path"):
            app.export.write_selection(name)


async def test_two_writes_at_a_time_are_two_files(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = Event()
    slow = formats.write_rows

    def slowly(*words: Any) -> None:
        assert go_on.wait(30)
        slow(*words)

    monkeypatch.setattr(formats, "write_rows", slowly)
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
        go_on.set()
        await settle(app, pilot)
    first, second = (tmp_path / f"s2r-selection-00{n}.csv" for n in (1, 2))
    assert "worst15" in first.read_text()
    assert "best15" in second.read_text()
    assert len(list(tmp_path.iterdir())) == 2 + (tmp_path / "share").exists()


async def test_a_name_that_was_taken_meanwhile_is_not_replaced(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, slow = tmp_path / "s2r-selection-001.csv", formats.write_rows

    def meanwhile(*words: Any) -> None:
        target.write_text("another's")
        slow(*words)

    monkeypatch.setattr(formats, "write_rows", meanwhile)
    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        await press(app, pilot, "w", "F", "enter")
        assert app.session.state.message == f"{target}: exists already; choose another name"
    assert target.read_text() == "another's"
    assert not list(tmp_path.glob(".*csv"))


async def test_a_report_can_be_tried_again_after_a_fault(
    tiny_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fault(*_: object) -> None:
        raise ZeroDivisionError("oh")

    app = make_app(tiny_store, tmp_path)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        with monkeypatch.context() as patch:
            patch.setattr("s2rtui.export.report.build_report.session_report", fault)
            await press(app, pilot, "E")
        assert "ZeroDivisionError: oh" in app.session.state.message
        await press(app, pilot, "E")
        assert app.session.state.message == f"wrote {tmp_path / 's2r-report-001.html'}"


def test_a_numbered_file_takes_the_next_name(tmp_path: Path) -> None:
    names = numbered_paths(tmp_path, "a", ".txt")

    def fill(path: Path) -> None:
        (tmp_path / "a-001.txt").write_text("another's")
        path.write_text("mine")

    assert create_exclusive(next(names), fill, names)[0] == tmp_path / "a-002.txt"
    assert (tmp_path / "a-001.txt").read_text() == "another's"
    assert (tmp_path / "a-002.txt").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 2


async def test_a_restricted_session_writes_in_its_own_folder(
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
        assert (await answer(app, pilot, "a.csv")).endswith("a.csv: 6 instances")
        await press(app, pilot, "s")
    assert not list(tmp_path.glob("*.*"))
    assert (user_data_folder / "a.csv").exists()
    assert (user_data_folder / "s2r-001.png").exists()
