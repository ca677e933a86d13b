"""What a user keeps: names that are gone, files of another making, selections used elsewhere."""

from __future__ import annotations

import errno
import fcntl
import json
from dataclasses import replace
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files.locks import file_lock
from s2rtui.session import Session, navigation, shared_selection
from s2rtui.user_data import notebook
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support.shared_lines import shared_line


@pytest.fixture
def session(tiny_store: Path) -> Session:
    return Session(tiny_store, "vanilla", Notebook)


def test_undo_and_redo_go_past_what_means_nothing_any_more(session: Session) -> None:
    session.select("best15")
    session.writable_notebook.save("gone", shared_selection.current_selection(session.state))
    session.select("@gone & curved")
    session.select("worst15")
    session.writable_notebook.forget("gone")
    state = session.undo()
    assert state.expression == "best15"
    assert "left out: @gone & curved" in state.message
    assert session.redo().expression == "worst15"
    session.writable_notebook.save("gone", shared_selection.current_selection(session.state))
    session.select("@gone")
    session.undo()
    session.writable_notebook.forget("gone")
    state = session.redo()
    assert (state.expression, state.future) == ("worst15", ())
    assert "nothing to redo; left out: @gone" in state.message


def test_undo_says_where_nothing_is_left(session: Session) -> None:
    session.writable_notebook.toggle_tag([1], "door")
    session.set_state(replace(session.state, past=("@door",)))
    session.writable_notebook.toggle_tag([1], "door")
    before = session.state.expression
    state = session.undo()
    assert (state.expression, state.past) == (before, ())
    assert "nothing to undo; left out: @door" in state.message


def test_a_run_is_reached_though_the_expression_means_nothing(session: Session) -> None:
    session.writable_notebook.save("gone", SavedSelection("all", 1, "vanilla", 40))
    session.select("@gone")
    session.writable_notebook.forget("gone")
    state = session.change_run(1)
    assert (state.run, state.expression) == ("dataaug", "all")
    assert "@gone means nothing here" in state.message
    session.set_state(replace(state, expression="@gone"))
    state = session.dispatch(navigation.change_trajectory)
    assert (state.trajectories, state.expression) == (("a",), "all")


ODD = {
    "selections": {
        "good": {"expression": "worst15", "generation": 1, "run": "vanilla", "count": 6},
        "later": {"expression": "worst15 ~ 3", "generation": 1, "run": "vanilla", "count": 6},
        "short": {"expression": "all"},
        "list": [1],
        'say "hi"': {"expression": "all", "generation": 1, "run": "vanilla", "count": 6},
        "endless": {"expression": "all", "generation": float("inf"), "run": "a", "count": 6},
    },
    "remarks": {
        "3": {"tags": ["door"], "note": "dark"},
        "four": {"tags": [], "note": "x"},
        "5": {"tags": "door", "note": ""},
        "6": None,
    },
    "history": ["all", 7],
    "pinned": {"a": 1},
}


def test_what_cannot_be_read_is_kept_and_the_rest_is_used(
    tiny_store: Path, session: Session
) -> None:
    path = session.writable_notebook.path
    content = {"version": 1, "dataset": "0" * 64, **ODD}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
    session = Session(tiny_store, "vanilla", Notebook)
    notes = session.notes
    assert set(notes.selections) == {"good", "later"}
    assert set(notes.remarks) == {3}
    assert notes.unread.count == 4 + 3 + 1
    session.select("@good & @door")
    with pytest.raises(RequestError):
        session.select("@later")
    session.select("worst15")
    session.writable_notebook.save("new", shared_selection.current_selection(session.state))
    session.writable_notebook.note(4, "a mirror")
    session.writable_notebook.forget("good")
    written = json.loads(path.read_text())
    for section in ("selections", "remarks"):
        lost = {"good"} if section == "selections" else set()
        for key in set(ODD[section]) - lost:
            known = written[section][key]
            kept = ODD[section][key]
            assert known == kept or (key == "later" and kept.items() <= known.items())
    assert written["pinned"] == {"a": 1}
    assert set(Session(tiny_store, notebooks=Notebook).notes.remarks) == {3, 4}


def test_nothing_is_written_over_what_cannot_be_read(tiny_store: Path, session: Session) -> None:
    path = session.writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"version": 1, "dataset": "0" * 64, **ODD}))
    book = Session(tiny_store, "vanilla", Notebook).writable_notebook
    before = path.read_text()
    with pytest.raises(RequestError, match="unreadable @short"):
        book.save("short", SavedSelection("all", 1, "vanilla", 40))
    for change in (lambda: book.note(5, "x"), lambda: book.toggle_tag([3, 6], "dark")):
        with pytest.raises(RequestError, match="unreadable remark"):
            change()
    assert path.read_text() == before


@pytest.mark.parametrize("section", ["selections", "remarks", "history"])
def test_a_section_of_another_form_is_kept(
    tiny_store: Path, user_data_folder: Path, section: str
) -> None:
    path = Session(tiny_store, notebooks=Notebook).writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"version": 1, "dataset": "0" * 64, section: "odd"}))
    for _ in range(2):
        session = Session(tiny_store, notebooks=Notebook)
        assert session.notes.unread.count == 1
        session.writable_notebook.note(1, "x")
    assert "odd" in json.loads(path.read_text()).values()


def test_a_saved_name_used_elsewhere_says_so(session: Session, tmp_path: Path) -> None:
    session.select("worst15")
    session.writable_notebook.save("left hall", shared_selection.current_selection(session.state))
    assert session.select('@"left hall"').message == ""
    told = session.set_run("dataaug").message
    assert '@"left hall": evaluated again: 6 on dataaug, generation 2' in told
    assert "saved: 6 on vanilla, generation 2" in told
    session.set_run("vanilla")
    assert (
        "generation 2, in a; saved: 6"
        in session.dispatch(navigation.set_trajectories, ("a",)).message
    )
    session.dispatch(navigation.set_trajectories, None)
    session.set_state(replace(session.state, generation=3))
    told = session.select('@"left hall" & curved').message
    assert "6 on vanilla, generation 3; saved: 6 on vanilla, generation 2" in told


def test_a_shared_line_brings_its_trajectories(session: Session) -> None:
    session.dispatch(navigation.set_trajectories, ("b",))
    session.select("worst15")
    line = shared_line(session)
    assert line.endswith('instances in "b"')
    chosen = session.state.selected
    session.dispatch(navigation.set_trajectories, None)
    session.select("all")
    state = session.dispatch(shared_selection.select_text, line)
    assert state.trajectories == ("b",)
    assert (state.selected == chosen).all()
    assert state.message == "trajectories b"
    session.select("all")
    assert session.dispatch(
        shared_selection.select_text, line.replace('"b"', '"nowhere"')
    ).trajectories == ("b",)
    assert "in nowhere" in session.state.message


def test_a_shared_line_of_another_generation_says_so(session: Session) -> None:
    session.select("worst15")
    line = shared_line(session).replace("generation 2", "generation 7")
    session.select("all")
    past = len(session.state.past)
    state = session.dispatch(shared_selection.select_text, line)
    assert "6 on vanilla, generation 2; saved: 6 on vanilla, generation 7" in state.message
    assert len(state.past) == past + 1


def test_a_lock_that_is_held_is_not_waited_for_long(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.writable_notebook.note(3, "first")
    monkeypatch.setattr(notebook, "_LOCK_SECONDS", 0.1)
    with (
        file_lock(session.writable_notebook.path),
        pytest.raises(RequestError, match="writing lock"),
    ):
        session.writable_notebook.note(3, "second")
    session.writable_notebook.refresh()
    assert session.notes.remarks[3].note == "first"


def test_a_file_system_without_locks_is_told(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_lock(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_lock)
    with pytest.raises(RequestError, match="cannot be locked"):
        session.writable_notebook.note(3, "first")
