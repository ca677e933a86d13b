"""Selections joined by operators, undone and redone, saved, shared and listed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.language import ExpressionError
from s2rstore.metrics import nearest_neighbours
from s2rstore.records import Side
from s2rtui.app.actions import BY_NAME
from s2rtui.charts.instance.model import NEIGHBOURS
from s2rtui.charts.list.view import ListView
from s2rtui.charts.scene import Resources, Scene
from s2rtui.session import Session, evaluation, instance_list, selection, shared_selection
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import embeddings
from tests.support.shared_lines import shared_line


@pytest.fixture
def session(tiny_store: Path) -> Session:
    return Session(tiny_store, notebooks=Notebook)


def chosen(session: Session) -> set[int]:
    return set(np.flatnonzero(session.state.selected).tolist())


OPERATORS = {
    "replace": lambda a, b: b,
    "intersect": lambda a, b: a & b,
    "union": lambda a, b: a | b,
    "subtract": lambda a, b: a - b,
}


@pytest.mark.parametrize("operator", OPERATORS)
def test_operators_are_set_algebra(session: Session, operator: str) -> None:
    session.select("ids(0..19)")
    session.select("ids(0..19)")
    first = chosen(session)
    session.dispatch(selection.set_operator, operator)
    session.select("ids(10..29)")
    assert chosen(session) == OPERATORS[operator](first, set(range(10, 30)))
    assert session.state.operator == "replace"


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(
        st.tuples(st.sampled_from(sorted(OPERATORS)), st.integers(0, 39), st.integers(0, 39)),
        max_size=6,
    )
)
def test_any_chain_of_operators_agrees_with_python_sets(
    tiny_store: Path, steps: list[tuple[str, int, int]]
) -> None:
    session = Session(tiny_store)
    session.select("all")
    expected = chosen(session)
    for operator, one, two in steps:
        low, high = sorted((one, two))
        if operator != "replace":
            session.dispatch(selection.set_operator, operator)
        session.select(f"ids({low}..{high})")
        expected = OPERATORS[operator](expected, set(range(low, high + 1)))
    assert chosen(session) == expected
    assert chosen(session) == set(np.flatnonzero(session.select(session.state.expression).selected))


def test_an_operator_asked_for_twice_is_dropped(session: Session) -> None:
    session.dispatch(selection.set_operator, "union")
    assert session.state.operator == "union"
    assert session.dispatch(selection.set_operator, "union").operator == "replace"


def test_complement_is_valid_minus_set_and_its_own_inverse(session: Session) -> None:
    session.select("worst15")
    before = chosen(session)
    session.dispatch(selection.complement)
    assert chosen(session) == set(range(40)) - before
    assert session.dispatch(selection.complement).expression == "worst15"


def test_a_wrong_choice_keeps_state_and_operator(session: Session) -> None:
    session.dispatch(selection.set_operator, "intersect")
    before = session.state
    with pytest.raises(ExpressionError):
        session.select("room:nowhere")
    assert session.state is before


def test_redo_goes_forward_until_something_new_is_chosen(session: Session) -> None:
    session.select("worst15")
    session.select("best15")
    session.undo()
    assert session.redo().expression == "best15"
    assert session.redo().message == "nothing to redo"
    session.undo()
    session.select("none")
    assert session.redo().message == "nothing to redo"


def test_the_papers_question_in_three_selections(session: Session) -> None:
    session.select("worst(15%, sim.error)")
    session.dispatch(selection.set_operator, "intersect")
    session.select("best(50%, real.error)")
    session.dispatch(selection.set_operator, "intersect")
    session.select("box(-1000, -1000, 1000, 1000)")
    columns = session.store.run_columns(session.state.run)
    poor = set(np.argsort(-columns.sim.error, kind="stable")[:6].tolist())
    well = set(np.argsort(columns.real.error, kind="stable")[:20].tolist())
    assert chosen(session) == poor & well


def test_saved_selections_and_tags_are_names_of_the_language(session: Session) -> None:
    session.select("worst15")
    worst = chosen(session)
    session.writable_notebook.save("mine", SavedSelection("worst15", 1, "vanilla", 6))
    assert session.writable_notebook.toggle_tag([3, 5], "door")
    session.select("@mine | @door")
    assert chosen(session) == worst | {3, 5}
    assert not session.writable_notebook.toggle_tag([3, 5], "door")
    with pytest.raises(ExpressionError):
        session.select("@door")


def test_two_sessions_of_a_user_keep_both_their_work(tiny_store: Path) -> None:
    first, second = (Session(tiny_store, notebooks=Notebook) for _ in range(2))
    first.writable_notebook.note(3, "  overexposed\nwindow ")
    second.writable_notebook.note(4, "a mirror")
    second.writable_notebook.toggle_tag([3], "window")
    assert second.notes.remarks[3].text == "#window: overexposed window"
    assert set(Session(tiny_store, notebooks=Notebook).notes.remarks) == {3, 4}
    first.writable_notebook.note(3, "")
    assert first.notes.remarks[3].text == "#window"


def test_names_of_selections_and_tags_do_not_collide(session: Session) -> None:
    session.writable_notebook.save("a", SavedSelection("all", 1, "vanilla", 40))
    with pytest.raises(RequestError, match="saved selection already"):
        session.writable_notebook.toggle_tag([1], "a")
    session.writable_notebook.toggle_tag([1], "b")
    with pytest.raises(RequestError, match="a tag already"):
        session.writable_notebook.save("b", SavedSelection("all", 1, "vanilla", 40))
    session.writable_notebook.forget("a")
    assert "a" not in session.notes.nodes


@pytest.mark.parametrize("name", ["", "  ", "x" * 61, 'say "hi"', "back\\slash", "bell\a"])
def test_impossible_names_are_refused(session: Session, name: str) -> None:
    with pytest.raises(RequestError, match="name"):
        session.writable_notebook.save(name, SavedSelection("all", 1, "vanilla", 40))


@pytest.mark.parametrize("content", ["", "{}", '{"version": 1}', "[1]", '{"version": 2'])
def test_a_damaged_notebook_is_refused_and_left_alone(
    tiny_store: Path, user_data_folder: Path, content: str
) -> None:
    path = Session(tiny_store, notebooks=Notebook).writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    with pytest.raises(RequestError, match="move it away"):
        Session(tiny_store, notebooks=Notebook)
    assert path.read_text() == content


def test_a_patient_notebook_is_empty_until_its_file_is_mended(
    tiny_store: Path, user_data_folder: Path
) -> None:
    path = Session(tiny_store, notebooks=Notebook).writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{damaged")
    session = Session(tiny_store, notebooks=partial(Notebook, tolerant=True))
    assert session.state.is_error
    assert session.state.message.startswith(f"{path}: is not JSON (")
    assert "repair it, or move it away" in session.state.message
    with pytest.raises(RequestError, match="is not JSON"):
        session.writable_notebook.note(3, "dark")
    assert path.read_text() == "{damaged"
    path.unlink()
    session.writable_notebook.note(3, "dark")
    assert session.notes.remarks[3].note == "dark"


def test_a_shared_line_selects_the_same_or_says_what_differs(session: Session) -> None:
    session.select("worst15")
    line = shared_line(session)
    session.select("all")
    assert session.dispatch(shared_selection.select_text, line).expression == "worst15"
    assert session.state.message == ""
    changed = line.replace("6 instances", "9 instances")
    assert (
        "evaluated again: 6 on vanilla"
        in session.dispatch(shared_selection.select_text, changed).message
    )
    foreign = line.replace("data set ", "data set fff")
    with pytest.raises(RequestError, match="data set fff"):
        session.dispatch(shared_selection.select_text, foreign)
    assert session.dispatch(shared_selection.select_text, "best15").expression == "best15"


def test_a_shared_line_turns_to_its_run(session: Session) -> None:
    session.set_run("dataaug")
    session.select("worst15")
    line = shared_line(session)
    session.set_run("vanilla")
    assert session.dispatch(shared_selection.select_text, line).run == "dataaug"


@pytest.mark.parametrize("name", instance_list.COLUMNS)
@pytest.mark.parametrize("descending", [True, False])
def test_the_list_is_in_order(session: Session, name: str, descending: bool) -> None:
    session.select("all")
    state = replace(session.state, sort=name, descending=descending)
    rows = instance_list.order(session.store, state, session.notes)
    values = instance_list.column(session.store, state, name)[rows]
    steps = np.diff(values)
    assert (steps <= 0).all() if descending else (steps >= 0).all()
    assert sorted(rows) == sorted(chosen(session))


def test_moving_through_the_list_stays_inside(session: Session) -> None:
    session.select("worst15")
    rows = instance_list.order(session.store, session.state, session.notes)
    session.set_cursor(int(rows[0]))
    assert session.dispatch(instance_list.move, -1).cursor == rows[0]
    assert session.dispatch(instance_list.move, 2).cursor == rows[2]
    assert session.dispatch(instance_list.move, 1000).cursor == rows[-1]
    session.select("none")
    assert session.dispatch(instance_list.move, 1).message == "nothing is selected"


def test_a_name_is_not_saved_as_part_of_itself(session: Session) -> None:
    book = session.writable_notebook
    book.save("a", SavedSelection("worst15", 1, "vanilla", 6))
    book.save("b", SavedSelection("@a & straight", 1, "vanilla", 3))
    for name in ("a", "b"):
        with pytest.raises(RequestError, match="is used by"):
            book.save(name, SavedSelection("@b | all", 1, "vanilla", 40))
    with pytest.raises(RequestError, match="used by @b"):
        book.forget("a")
    assert session.notes.selections["a"].expression == "worst15"


def test_a_wrong_shared_line_changes_nothing(session: Session) -> None:
    session.set_run("vanilla")
    line = shared_line(session).replace("run vanilla", "run dataaug")
    wrong = line.replace(session.state.expression, "room:nowhere", 1)
    before = session.state
    with pytest.raises(ExpressionError):
        session.dispatch(shared_selection.select_text, wrong)
    assert session.state is before


@pytest.mark.parametrize("name", instance_list.NAMES)
def test_names_are_sorted_by_the_alphabet(session: Session, name: str) -> None:
    session.select("all")
    truth = session.store.instances
    codes, names = getattr(truth, name), getattr(truth, f"{name}_names")
    state = session.set_state(replace(session.state, sort=name, descending=False))
    told = [
        names[codes[iid]]
        for iid in instance_list.order(session.store, state, session.notes)
        if codes[iid] >= 0
    ]
    assert len(set(told)) > 1
    assert told == sorted(told)


def test_every_column_of_the_list_can_be_sorted_by(session: Session) -> None:
    names, _ = ListView().numbers(Scene(session.store, session.state, Resources()))
    shown = set(names)
    assert shown == set(instance_list.COLUMNS)
    seen = [session.dispatch(instance_list.sort_by_next_column).sort for _ in instance_list.COLUMNS]
    assert set(seen) == shown


@pytest.mark.parametrize("descending", [True, False])
def test_remarks_are_sorted_by_the_alphabet(session: Session, descending: bool) -> None:
    session.select("all - ids(9)")
    for iid, text in ((30, "beta"), (2, "Gamma"), (9, "aside"), (7, "alpha"), (20, "beta")):
        session.writable_notebook.note(iid, text)
    state = replace(session.state, sort="remark", descending=descending)
    rows = instance_list.order(session.store, state, session.notes).tolist()
    assert rows[:4] == ([2, 20, 30, 7] if descending else [7, 20, 30, 2])
    assert rows[4:] == [iid for iid in range(40) if iid not in (2, 7, 9, 20, 30)]
    session.set_state(state)
    assert session.dispatch(instance_list.sort_by_next_column).sort == instance_list.COLUMNS[0]
    session.set_state(replace(state, sort=instance_list.COLUMNS[-1]))
    assert session.dispatch(instance_list.sort_by_next_column).sort == "remark"


def test_a_run_without_embeddings_knows_nothing_alike(session: Session) -> None:
    before = session.state
    BY_NAME["alike"].do(session)
    assert session.state.message == (
        "run vanilla has no embeddings to compare; `s2r precompute` makes them"
    )
    assert (session.state.is_error, session.state.selected) == (False, before.selected)


@pytest.mark.parametrize("side", ["sim", "real"])
def test_an_instance_leads_to_what_is_seen_alike(store_copy: Path, side: Side) -> None:
    rng = np.random.default_rng(3)
    points = {side: rng.normal(size=(40, 3)) for side in ("sim", "real")}
    embeddings.add(store_copy, "vanilla", points)
    session = Session(store_copy, "vanilla")
    session.set_cursor(4)
    heat = session.state.heat
    assert heat is not None
    session.set_state(replace(session.state, heat=replace(heat, side=side)))
    change = BY_NAME["alike"].do
    assert change is not None
    change(session)
    near, _ = nearest_neighbours.neighbours(session.store, session.state.run, side, 4, NEIGHBOURS)
    assert chosen(session) == set(near.tolist())
    assert 4 in chosen(session)
    session.set_state(replace(session.state, cursor=None))
    change(session)
    assert session.state.message == "no instance to compare with: select some"


@pytest.mark.parametrize("expression", ["worst15", "best15", "ids(3, 5..9)", "all", "none"])
@pytest.mark.parametrize("looked_at", [1, 4096])
def test_a_cursor_that_is_left_behind_goes_to_the_worst(
    session: Session, expression: str, looked_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation, "_RANKED_ERRORS", looked_at)
    session.set_state(replace(session.state, cursor=None))
    state = session.select(expression)
    pool = state.selected if state.selected.any() else state.base
    errors = session.store.run_columns(state.run).real.error
    assert state.cursor == np.where(pool, errors, -1).argmax()
