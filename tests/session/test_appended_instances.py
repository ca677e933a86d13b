"""A session and the user's notes on a store to which instances are appended."""

from functools import partial
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import check
from s2rtui.session import navigation, shared_selection
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support.appended import append_trajectory
from tests.support.copies import copy_store

N = 40
"""Instances of the tiny store; its trajectories are a and b."""


@pytest.fixture
def notebooks(tmp_path: Path) -> partial[Notebook]:
    return partial(Notebook, folder=tmp_path / "notes")


def test_an_open_session_notices_the_instances_and_says_so(store_copy):
    session = Session(store_copy)
    session.select("real.error > 0.5")
    before = session.state
    append_trajectory(store_copy, "a0", 5)
    assert session.apply_updates(session.read_updates())
    assert session.state.newest == before.generation + 1
    state = session.open_newest_generation()
    assert state.message.startswith(f"generation {state.generation}; 5 instances added")
    assert state.selected.size == state.base.size == N + 5
    assert state.expression == before.expression
    assert (state.selected[:N] == before.selected).all()
    assert not state.selected[N:].any()  # not computed for any run yet
    session.set_cursor(N + 2)
    assert session.dispatch(navigation.move_cursor, 1).cursor in range(N)
    session.close()


def test_notes_tags_and_selections_are_found_again(store_copy, notebooks):
    session = Session(store_copy, notebooks=notebooks)
    notebook = session.writable_notebook
    session.select("ids(3, 4)")
    notebook.save("mine", shared_selection.current_selection(session.state))
    notebook.note(3, "a cable")
    notebook.toggle_tag([4], "seen")
    line = shared_selection.shared_text(
        shared_selection.current_selection(session.state), session.store.identity
    )
    session.close()
    append_trajectory(store_copy, "a0", 5)
    session = Session(store_copy, notebooks=notebooks)
    assert session.store.identity != session.store.dataset.hash
    assert set(session.notes.selections) == {"mine"}
    assert session.notes.remarks[3].note == "a cable"
    assert session.select("@seen").selected.nonzero()[0].tolist() == [4]
    state = session.dispatch(shared_selection.select_text, line)
    assert state.selected.nonzero()[0].tolist() == [3, 4]
    assert "saved: 2 on vanilla, generation 2" in state.message
    session.close()


def test_another_data_set_in_the_place_of_the_store_is_refused(store_copy):
    session = Session(store_copy)
    with edit(store_copy) as draft:
        draft.update("dataset", {"name": "tiny"}, {"hash": "2" * 64})
    state = session.open_newest_generation()
    assert "holds another data set" in state.message
    session.close()


def test_verify_notes_runs_of_fewer_parts(store_copy):
    append_trajectory(store_copy, "a0", 5)
    report = check(store_copy)
    notes = [note for note in report.notes if "computed for" in note]
    assert (report.damages, len(notes)) == ((), 2)
    assert notes[0].startswith("run vanilla: computed for 40 of 45 instances")


def test_notes_on_instances_of_another_copy_are_kept_but_not_applied(
    store_copy, tmp_path, notebooks
):
    copy = copy_store(store_copy, tmp_path / "copy.s2r")
    append_trajectory(store_copy, "a0", 5)
    append_trajectory(copy, "other", 3)
    first = Session(store_copy, notebooks=notebooks)
    notebook = first.writable_notebook
    for iid in (3, N + 1):
        notebook.note(iid, f"note on {iid}")
        notebook.toggle_tag([iid], "seen")
    notebook.save("common", SavedSelection("ids(3)", 1, "vanilla", 1))
    notebook.save("late", SavedSelection(f"ids({N + 1})", 1, "vanilla", 1))
    notebook.save("worst", SavedSelection("worst15", 1, "vanilla", 6))
    second = Session(copy, notebooks=notebooks)
    assert second.store.identity == first.store.identity
    assert set(second.notes.remarks) == {3}
    assert set(second.notes.selections) == {"common", "worst"}
    assert second.notes.unread.count == 0
    second.writable_notebook.note(N + 1, "of the copy")
    with pytest.raises(RequestError, match="another copy of this store"):
        second.writable_notebook.save("late", SavedSelection("all", 1, "vanilla", 40))
    notebook.refresh()
    assert first.notes.remarks[N + 1].note == f"note on {N + 1}"
    assert first.notes.remarks[N + 1].tags == ("seen",)
    assert set(first.notes.selections) == {"common", "late", "worst"}
    second.writable_notebook.refresh()
    assert second.notes.remarks[N + 1].note == "of the copy"
    first.close()
    second.close()


def test_notes_of_an_appended_part_are_found_while_the_session_is_open(store_copy, notebooks):
    session = Session(store_copy, notebooks=notebooks)
    append_trajectory(store_copy, "a0", 5)
    session.open_newest_generation()
    session.writable_notebook.note(N + 2, "late")
    session.close()
    append_trajectory(store_copy, "a1", 2)
    again = Session(store_copy, notebooks=notebooks)
    assert again.notes.remarks[N + 2].note == "late"
    again.close()


def test_a_refused_generation_leaves_the_notes_of_the_present_one(store_copy, notebooks):
    session = Session(store_copy, notebooks=notebooks)
    append_trajectory(store_copy, "a0", 5)
    later = Session(store_copy, notebooks=notebooks)
    later.writable_notebook.note(N + 2, "late")

    def refuse(context: object, state: object) -> None:
        raise RequestError("refused")

    with pytest.raises(RequestError):
        session.dispatch(refuse, store=later.store)
    session.writable_notebook.refresh()
    assert not session.notes.remarks
    later.close()
    session.close()
