"""Notebooks: deleted names, unreadable entries and selections applied to other data."""

import errno
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files.lock_file import LockFile
from s2rstore.files.locks import file_lock
from s2rstore.language.syntax_tree import Saved
from s2rstore.records import Part
from s2rtui.session import navigation, shared_selection
from s2rtui.session.session import Session
from s2rtui.user_data import notebook
from s2rtui.user_data.notebook import Notebook, Notes, SavedSelection
from tests.support.shared_lines import shared_line


@pytest.fixture
def session(tiny_store: Path) -> Session:
    return Session(tiny_store, "vanilla", Notebook)


def test_undo_and_redo_skip_invalid_expressions(session):
    session.select("best15")
    session.writable_notebook.save("gone", shared_selection.current_selection(session.state))
    session.select("curved&@gone")
    session.select("worst15")
    session.writable_notebook.forget("gone")
    state = session.dispatch(navigation.undo)
    assert state.expression == "best15"
    assert "left out: curved & @gone (column 10: no saved selection 'gone'" in state.message
    assert session.dispatch(navigation.redo).expression == "worst15"
    session.writable_notebook.save("gone", shared_selection.current_selection(session.state))
    session.select("@gone")
    session.dispatch(navigation.undo)
    session.writable_notebook.forget("gone")
    state = session.dispatch(navigation.redo)
    assert (state.expression, state.future) == ("worst15", ())
    assert "nothing to redo; left out: @gone" in state.message


def test_an_invalid_expression_does_not_prevent_a_run_change(session):
    session.writable_notebook.save("gone", SavedSelection("all", 1, "vanilla", 40))
    session.select("@gone")
    session.writable_notebook.forget("gone")
    state = session.dispatch(navigation.change_run, 1)
    assert (state.run, state.expression) == ("dataaug", "all")
    assert "@gone cannot be evaluated here" in state.message
    session.set_state(replace(state, node=Saved("gone")))
    state = session.dispatch(navigation.change_trajectory)
    assert (state.trajectories, state.expression) == (("a",), "all")


MIXED_CONTENT = {
    "selections": {
        "good": {"expression": "worst15", "generation": 1, "run": "vanilla", "count": 6},
        "later": {"expression": "worst15 ~ 3", "generation": 1, "run": "vanilla", "count": 6},
        "short": {"expression": "all"},
        "list": [1],
        'say "hi"': {"expression": "all", "generation": 1, "run": "vanilla", "count": 6},
        "endless": {"expression": "all", "generation": float("inf"), "run": "a", "count": 6},
    },
    "remarks": {
        "3": {"tags": ["door"], "note": "dark"}, "four": {"tags": [], "note": "x"},
        "5": {"tags": "door", "note": ""}, "6": None,
    },
    "history": ["all", 7],
    "pinned": {"a": 1},
}  # fmt: skip


def write_notebook(session: Session, **sections: object) -> Path:
    path = session.writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"version": 1, "dataset": "0" * 64, **sections}))
    return path


def test_unreadable_entries_are_kept_and_readable_ones_used(tiny_store, session):
    path = write_notebook(session, **MIXED_CONTENT)
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
    saved = json.loads(path.read_text())
    for section in ("selections", "remarks"):
        for key in set(MIXED_CONTENT[section]) - {"good"}:
            stored, original = saved[section][key], MIXED_CONTENT[section][key]
            assert stored == original or (key == "later" and original.items() <= stored.items())
    assert saved["pinned"] == {"a": 1}
    assert set(Session(tiny_store, notebooks=Notebook).notes.remarks) == {3, 4}


def test_unreadable_entries_are_never_overwritten(tiny_store, session):
    path = write_notebook(session, **MIXED_CONTENT)
    notebook_file = Session(tiny_store, "vanilla", Notebook).writable_notebook
    before = path.read_text()
    with pytest.raises(RequestError, match="unreadable @short"):
        notebook_file.save("short", SavedSelection("all", 1, "vanilla", 40))
    with pytest.raises(RequestError, match="unreadable remark"):
        notebook_file.note(5, "x")
    with pytest.raises(RequestError, match="unreadable remark"):
        notebook_file.toggle_tag([3, 6], "dark")
    assert path.read_text() == before


@pytest.mark.parametrize("section", ["selections", "remarks", "history"])
def test_a_section_of_another_type_is_kept(tiny_store, session, section):
    path = write_notebook(session, **{section: "odd"})
    for _ in range(2):
        session = Session(tiny_store, notebooks=Notebook)
        assert session.notes.unread.count == 1
        session.writable_notebook.note(1, "x")
    assert "odd" in json.loads(path.read_text()).values()


def test_a_saved_selection_on_other_data_shows_a_message(session, tmp_path):
    session.select("worst15")
    session.writable_notebook.save("left hall", shared_selection.current_selection(session.state))
    assert session.select('@"left hall"').message == ""
    message = session.set_run("dataaug").message
    assert '@"left hall": evaluated again: 6 on dataaug, generation 2' in message
    assert "saved: 6 on vanilla, generation 2" in message
    session.set_run("vanilla")
    state = session.dispatch(navigation.set_trajectories, ("a",))
    assert "generation 2, in a; saved: 6" in state.message
    session.dispatch(navigation.set_trajectories, None)
    session.set_state(replace(session.state, generation=3))
    message = session.select('@"left hall" & curved').message
    assert "6 on vanilla, generation 3; saved: 6 on vanilla, generation 2" in message


def test_a_shared_line_restores_its_trajectories(session):
    session.dispatch(navigation.set_trajectories, ("b",))
    session.select("worst15")
    line = shared_line(session)
    assert line.endswith('instances in "b"')
    selected = session.state.selected
    session.dispatch(navigation.set_trajectories, None)
    session.select("all")
    state = session.dispatch(shared_selection.select_text, line)
    assert state.trajectories == ("b",)
    assert (state.selected == selected).all()
    assert state.message == "trajectories b"
    session.select("all")
    elsewhere = line.replace('"b"', '"nowhere"')
    assert session.dispatch(shared_selection.select_text, elsewhere).trajectories == ("b",)
    assert "in nowhere" in session.state.message


def test_waiting_for_a_lock_times_out(session, monkeypatch):
    session.writable_notebook.note(3, "first")
    monkeypatch.setattr(notebook, "_LOCK_SECONDS", 0.1)
    with (
        file_lock(session.writable_notebook.path),
        pytest.raises(RequestError, match="writing lock"),
    ):
        session.writable_notebook.note(3, "second")
    session.writable_notebook.refresh()
    assert session.notes.remarks[3].note == "first"


def test_a_lock_that_cannot_be_made_is_reported(session, monkeypatch):
    def fail_to_create(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(LockFile, "create", fail_to_create)
    with pytest.raises(RequestError, match="lock cannot be opened"):
        session.writable_notebook.note(3, "first")


def test_a_notebook_whose_lock_was_taken_over_is_not_written(session, monkeypatch):
    session.writable_notebook.note(3, "first")
    path = session.writable_notebook.path
    read = Notebook._read

    def read_while_the_lock_is_taken(self: Notebook, parts: Sequence[Part]) -> Notes:
        path.with_name(f".{path.name}.lock").write_text("another holder")
        return read(self, parts)

    monkeypatch.setattr(Notebook, "_read", read_while_the_lock_is_taken)
    before = path.read_bytes()
    with pytest.raises(RequestError, match="writing lock was taken over"):
        session.writable_notebook.note(3, "second")
    assert path.read_bytes() == before
