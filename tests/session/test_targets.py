"""Deferred loading gives the same state as synchronous loading, whatever keys are pressed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.index import column_loader
from s2rstore.language import parse
from s2rstore.language.syntax_tree import Everything
from s2rstore.metrics import nearest_neighbours
from s2rtui.app.key_bindings import ACTIONS
from s2rtui.loaders import store_data
from s2rtui.session import navigation, shared_selection, targets
from s2rtui.session.session import Session
from s2rtui.session.state import State, Step
from s2rtui.user_data.notebook import Notebook
from tests.support import embeddings, tiny

RUNS = ("vanilla", "b", "c")
Key = Callable[[Session], object]
_COMMENT = '  # data set {}, generation {}, run b, 3 instances in "a"'
_ACTIONS = {action.name: action.do for action in ACTIONS if action.do is not None}


def paste_shared_selection(session: Session) -> object:
    comment = _COMMENT.format(session.store.dataset.hash, session.state.generation)
    return session.dispatch(shared_selection.select_text, "worst(3, real.loss)" + comment)


PENDING_ACTIONS: dict[str, Key] = {
    "typed": lambda s: s.dispatch(shared_selection.select_text, "real.loss > 0.3"),
    "saved": lambda s: s.dispatch(shared_selection.select_text, "@costly & all"),
    "pasted": paste_shared_selection,
    "run": lambda s: s.dispatch(navigation.change_run, 1),
    "undo": lambda s: s.dispatch(navigation.undo),
    "redo": lambda s: s.dispatch(navigation.redo),
    "alike": lambda s: s.select("like(20, 6)"),
    "other run": lambda s: s.select('worst(3, run("c").real.error)'),
}


@dataclass(repr=False)
class SessionPair:
    """A session with deferred loading and one that loads synchronously, in the same state."""

    deferred: Session
    direct: Session
    worker: bool = False

    def begin(self) -> None:
        """Reset both sessions: loaded data of the first screen, entries to undo and redo."""
        for session in (self.deferred, self.direct):
            session.defers_loading = False
            session.set_state(self.first(session))
            selected = session.select("best15")
            past = (
                Step(Everything(), "b"),
                Step(parse("real.loss > 0.1"), "vanilla", trajectories=("a",)),
                Step(parse("real.loss > 0.2"), "vanilla"),
            )
            future = Step(parse("curved"), "c"), Step(parse("real.loss < 1"), "vanilla")
            session.set_state(replace(selected, past=past, future=future))
        store = self.deferred.store
        store._columns.drop(lambda key: "loss" in key or key[:2] in (("run", "b"), ("run", "c")))
        store.selection_cache.clear()
        targets.load_columns(store, targets.place_of(self.deferred.state), lambda: True)
        self.deferred.defers_loading = True

    def first(self, session: Session) -> State:
        state = session.state
        return replace(
            state, run="vanilla", trajectories=None, pending=None, past=(), future=(), cursor=20,
            operator="replace", brush=None, compared_run=None, heat=None, adjust=None, viewports=(),
            sort="real.error", descending=True, overlay="off", map_mode="colour",
            dims_unseen_floor=False,
        )  # fmt: skip

    def press(self, key: Key) -> None:
        """Press a key in both sessions with the cursor at the same instance."""
        cursor = self.deferred.state.cursor
        self.direct.set_state(replace(self.direct.state, cursor=cursor))
        key(self.deferred)
        key(self.direct)

    def arrive(self) -> None:
        """Complete pending loads until none is left."""
        for _ in range(4):
            if (state := self.deferred.state).pending is None:
                return
            self.worker = True
            request = SimpleNamespace(is_current=lambda: True)
            store_data.read_run(self.deferred.store, state, request)
            self.worker = False
            self.deferred.complete_pending()
        raise AssertionError("the load never completes")

    def assert_equal(self) -> None:
        deferred, synchronous = self.deferred.state, self.direct.state
        for name in ("run", "trajectories", "expression", "operator", "sort", "past", "future"):
            assert getattr(deferred, name) == getattr(synchronous, name), name
        assert np.array_equal(deferred.selected, synchronous.selected)
        assert np.array_equal(deferred.base, synchronous.base)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SessionPair]:
    """Reads of the deferred session fail outside its worker."""
    folder = tmp_path_factory.mktemp("waiting")
    path = tiny.build(folder / "s.s2r", runs=RUNS)
    points = np.random.default_rng(1).normal(size=(40, 2))
    for number, run in enumerate(RUNS):
        embeddings.add(path, run, {"sim": points * number, "real": points + number})
    sessions = SessionPair(
        *(Session(path, notebooks=lambda identity: Notebook(identity, folder)) for _ in range(2))
    )
    for session in (sessions.deferred, sessions.direct):
        session.select("real.loss > 0.15")
        session.writable_notebook.save("costly", shared_selection.current_selection(session.state))
    predicted, neighbours = column_loader._predicted, nearest_neighbours.neighbours
    store = sessions.deferred.store

    def checked(read, owner):
        def checked_read(reader, *rest):
            may_read = sessions.worker or not sessions.deferred.defers_loading
            assert reader is not owner or may_read, rest
            return read(reader, *rest)

        return checked_read

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(targets, "SMALL_STORE", 0)
        patch.setattr(column_loader, "_predicted", checked(predicted, store._column_loader))
        patch.setattr(nearest_neighbours, "neighbours", checked(neighbours, store))
        yield sessions
    for session in (sessions.deferred, sessions.direct):
        session.close()


@pytest.mark.parametrize(
    "action",
    [
        pytest.param(name, marks=() if name in ("typed", "run") else pytest.mark.deep)
        for name in PENDING_ACTIONS
    ],
)
def test_each_key_during_a_pending_load_gives_the_synchronous_state(pair, action):
    for name, key in _ACTIONS.items():
        pair.begin()
        pair.press(PENDING_ACTIONS[action])
        assert pair.deferred.state.pending is not None
        pair.press(key)
        pair.arrive()
        try:
            pair.assert_equal()
        except AssertionError as error:
            raise AssertionError(f"{action}, {name}: {error}") from error


_KEYS = [
    "next_run", "previous_run", "trajectory", "undo", "redo", "complement", "intersect", "union",
    "subtract", "worst_real", "alike", "other_run", "next_instance",
]  # fmt: skip


@given(
    st.sampled_from(sorted(PENDING_ACTIONS)),
    st.lists(st.sampled_from(_KEYS), min_size=2, max_size=5),
)
def test_several_keys_during_a_pending_load_give_the_synchronous_state(pair, action, names):
    pair.begin()
    pair.press(PENDING_ACTIONS[action])
    for name in names:
        pair.press(_ACTIONS[name])
    pair.arrive()
    pair.assert_equal()
