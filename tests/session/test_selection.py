"""Selections: operators, undo and redo, saving, sharing and the sorted list."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.language import ExpressionError
from s2rstore.metrics import nearest_neighbours
from s2rtui.app.key_bindings import BY_NAME
from s2rtui.charts.shared.instance_input import NEIGHBOURS
from s2rtui.session import (
    evaluation,
    instance_list,
    navigation,
    selection,
    shared_selection,
)
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import embeddings
from tests.support.shared_lines import shared_line


@pytest.fixture
def session(tiny_store: Path) -> Iterator[Session]:
    opened = Session(tiny_store, notebooks=Notebook)
    yield opened
    opened.close()


def selected_iids(session: Session) -> set[int]:
    return set(np.flatnonzero(session.state.selected).tolist())


OPERATORS = {
    "replace": lambda a, b: b, "intersect": lambda a, b: a & b, "union": lambda a, b: a | b,
    "subtract": lambda a, b: a - b,
}  # fmt: skip


@given(
    steps=st.lists(
        st.tuples(st.sampled_from(sorted(OPERATORS)), st.integers(0, 39), st.integers(0, 39)),
        max_size=6,
    )
)
def test_chains_of_operators_equal_python_sets(shared_session, steps):
    session = shared_session
    session.select("all")
    expected = selected_iids(session)
    for operator, start, end in steps:
        low, high = sorted((start, end))
        if operator != "replace":
            session.dispatch(selection.set_operator, operator)
        session.select(f"ids({low}..{high})")
        expected = OPERATORS[operator](expected, set(range(low, high + 1)))
        assert session.state.operator == "replace"
    assert selected_iids(session) == expected
    session.select(session.state.expression)
    assert selected_iids(session) == expected


@pytest.fixture(scope="module")
def shared_session(tiny_store: Path) -> Iterator[Session]:
    """A session whose selection every example sets first."""
    opened = Session(tiny_store)
    yield opened
    opened.close()


def test_complements_and_operators_are_cancelled_by_their_repetition(session):
    session.dispatch(selection.set_operator, "union")
    assert session.state.operator == "union"
    assert session.dispatch(selection.set_operator, "union").operator == "replace"
    session.select("worst15")
    before = selected_iids(session)
    session.dispatch(selection.complement)
    assert selected_iids(session) == set(range(40)) - before
    assert session.dispatch(selection.complement).expression == "worst15"


def test_an_invalid_expression_keeps_state_and_operator(session):
    session.dispatch(selection.set_operator, "intersect")
    before = session.state
    with pytest.raises(ExpressionError):
        session.select("room:nowhere")
    assert session.state is before


def test_a_combination_that_is_too_long_to_be_typed_is_refused(session):
    session.select(" | ".join(f"gap > {number}" for number in range(200)))
    before = session.state
    for operator in ("union", "intersect"):
        state = session.select("worst15", operator)
        with pytest.raises(ExpressionError, match="more than 200 parts; save some of it"):
            session.select("best15", operator)
        assert session.state is state
        session.set_state(before)


def test_undo_restores_run_trajectories_and_cursor(session):
    def shown() -> tuple[object, ...]:
        state = session.state
        return state.expression, state.run, state.trajectories, state.count_text, state.cursor

    session.select("worst15")
    session.dispatch(navigation.move_cursor, 1)
    steps = [shown()]
    for change in (
        lambda: session.dispatch(navigation.change_trajectory),
        lambda: session.select("best15"),
        lambda: session.dispatch(navigation.change_run, 1),
    ):
        change()
        steps.append(shown())
    assert len(set(steps)) == 4
    for expected in steps[-2::-1]:
        session.dispatch(navigation.undo)
        assert shown() == expected
    for expected in steps[1:]:
        session.dispatch(navigation.redo)
        assert shown() == expected


def test_undo_goes_back_one_expression_and_redo_ends_at_a_new_one(session):
    session.select("worst15")
    session.select("best15")
    assert session.dispatch(navigation.undo).expression == "worst15"
    assert session.dispatch(navigation.redo).expression == "best15"
    assert session.dispatch(navigation.redo).message == "nothing to redo"
    session.dispatch(navigation.undo)
    session.select("none")
    assert session.dispatch(navigation.redo).message == "nothing to redo"
    for _ in range(3):
        session.dispatch(navigation.undo)
    assert session.dispatch(navigation.undo).message == "nothing to undo"


def test_concurrent_sessions_keep_each_other_s_changes(tiny_store):
    first, second = (Session(tiny_store, notebooks=Notebook) for _ in range(2))
    first.writable_notebook.note(3, "  overexposed\nwindow ")
    second.writable_notebook.note(4, "a mirror")
    second.writable_notebook.toggle_tag([3], "window")
    assert second.notes.remarks[3].text == "#window: overexposed window"
    assert set(Session(tiny_store, notebooks=Notebook).notes.remarks) == {3, 4}
    first.writable_notebook.note(3, "")
    assert first.notes.remarks[3].text == "#window"


def test_names_of_selections_and_tags_do_not_collide(session):
    session.writable_notebook.save("a", SavedSelection("all", 1, "vanilla", 40))
    with pytest.raises(RequestError, match="saved selection already"):
        session.writable_notebook.toggle_tag([1], "a")
    session.writable_notebook.toggle_tag([1], "b")
    with pytest.raises(RequestError, match="a tag already"):
        session.writable_notebook.save("b", SavedSelection("all", 1, "vanilla", 40))
    session.writable_notebook.forget("a")
    assert "a" not in session.notes.nodes


def test_invalid_names_are_rejected(session):
    for name in ("", "  ", "x" * 61, 'say "hi"', "back\\slash", "bell\a"):
        with pytest.raises(RequestError, match="name"):
            session.writable_notebook.save(name, SavedSelection("all", 1, "vanilla", 40))


@pytest.mark.parametrize("content", ["", "{}", '{"version": 1}', "[1]", '{"version": 2'])
def test_a_damaged_notebook_is_rejected_and_unchanged(tiny_store, user_data_folder, content):
    path = Session(tiny_store, notebooks=Notebook).writable_notebook.path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    with pytest.raises(RequestError, match="move it away"):
        Session(tiny_store, notebooks=Notebook)
    assert path.read_text() == content


def test_a_tolerant_notebook_is_empty_until_its_file_is_repaired(tiny_store, user_data_folder):
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


def test_a_shared_line_restores_the_selection_or_reports_differences(session):
    session.select("worst15")
    line = shared_line(session)
    session.select("all")
    assert session.dispatch(shared_selection.select_text, line).expression == "worst15"
    assert session.state.message == ""
    changed = line.replace("6 new instances", "9 new instances")
    state = session.dispatch(shared_selection.select_text, changed)
    assert "evaluated again: 6 on vanilla" in state.message
    foreign = line.replace("data set ", "data set fff")
    with pytest.raises(RequestError, match="data set fff"):
        session.dispatch(shared_selection.select_text, foreign)
    assert session.dispatch(shared_selection.select_text, "best15").expression == "best15"


def test_a_shared_line_changes_to_its_run_and_an_invalid_one_changes_nothing(session):
    session.set_run("dataaug")
    session.select("worst15")
    line = shared_line(session)
    session.set_run("vanilla")
    assert session.dispatch(shared_selection.select_text, line).run == "dataaug"
    session.set_run("vanilla")
    line = shared_line(session).replace("run vanilla", "run dataaug")
    invalid = line.replace(session.state.expression, "room:nowhere", 1)
    before = session.state
    with pytest.raises(ExpressionError):
        session.dispatch(shared_selection.select_text, invalid)
    assert session.state is before


def test_the_list_is_sorted(session):
    session.select("all")
    for name, descending in itertools.product(instance_list.COLUMNS, (True, False)):
        state = replace(session.state, sort=name, descending=descending)
        rows = instance_list.order(session.store, state, session.notes)
        steps = np.diff(instance_list.column(session.store, state, name)[rows])
        assert (steps <= 0).all() if descending else (steps >= 0).all(), name
        assert sorted(rows) == sorted(selected_iids(session)), name


def test_moving_through_the_list_stops_at_its_ends(session):
    session.select("worst15")
    rows = instance_list.order(session.store, session.state, session.notes)
    session.set_cursor(int(rows[0]))
    assert session.dispatch(instance_list.move, -1).cursor == rows[0]
    assert session.dispatch(instance_list.move, 2).cursor == rows[2]
    assert session.dispatch(instance_list.move, 1000).cursor == rows[-1]
    session.select("none")
    assert session.dispatch(instance_list.move, 1).message == "nothing is selected"


def test_recursive_names_are_rejected(session):
    notebook = session.writable_notebook
    notebook.save("a", SavedSelection("worst15", 1, "vanilla", 6))
    notebook.save("b", SavedSelection("@a & straight", 1, "vanilla", 3))
    for name in ("a", "b"):
        with pytest.raises(RequestError, match="is used by"):
            notebook.save(name, SavedSelection("@b | all", 1, "vanilla", 40))
    with pytest.raises(RequestError, match="used by @b"):
        notebook.forget("a")
    assert session.notes.selections["a"].expression == "worst15"


@pytest.mark.parametrize("name", instance_list.NAMES)
def test_names_are_sorted_alphabetically(session, name):
    session.select("all")
    truth = session.store.instances
    codes, names = getattr(truth, name), getattr(truth, f"{name}_names")
    state = session.set_state(replace(session.state, sort=name, descending=False))
    rows = instance_list.order(session.store, state, session.notes)
    sorted_names = [names[codes[iid]] for iid in rows if codes[iid] >= 0]
    assert len(set(sorted_names)) > 1
    assert sorted_names == sorted(sorted_names)


@pytest.mark.parametrize("descending", [True, False])
def test_remarks_are_sorted_alphabetically(session, descending):
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


def test_a_run_without_embeddings_cannot_be_searched_for_similar_instances(session):
    before = session.state
    BY_NAME["alike"].do(session)
    assert session.state.message == (
        "run vanilla has no embeddings to compare; `s2r precompute` makes them"
    )
    assert (session.state.is_error, session.state.selected) == (False, before.selected)


@pytest.mark.parametrize("side", ["sim", "real"])
def test_similar_instances_of_the_current_one_are_selected(store_copy, side):
    rng = np.random.default_rng(3)
    points = {side: rng.normal(size=(40, 3)) for side in ("sim", "real")}
    embeddings.add(store_copy, "vanilla", points)
    session = Session(store_copy, "vanilla")
    session.set_cursor(4)
    session.set_state(replace(session.state, heat=replace(session.state.heat, side=side)))
    change = BY_NAME["alike"].do
    change(session)
    nearest, _ = nearest_neighbours.neighbours(session.store, "vanilla", side, 4, NEIGHBOURS)
    assert selected_iids(session) == set(nearest.tolist())
    assert 4 in selected_iids(session)
    session.set_state(replace(session.state, cursor=None))
    change(session)
    assert session.state.message == "no instance to compare with: select some"


@pytest.mark.parametrize("candidates", [1, 4096])
def test_an_unselected_cursor_moves_to_the_worst_instance(session, candidates, monkeypatch):
    monkeypatch.setattr(evaluation, "_RANKED_ERRORS", candidates)
    errors = session.store.run_columns(session.state.run).real.error
    for expression in ("worst15", "best15", "ids(3, 5..9)", "all", "none"):
        session.set_state(replace(session.state, cursor=None))
        state = session.select(expression)
        among = state.selected if state.selected.any() else state.base
        assert state.cursor == np.where(among, errors, -1).argmax(), expression
