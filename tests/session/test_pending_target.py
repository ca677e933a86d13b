"""What waits for a worker: no key drops it, and it ends as if all had been read at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.index import column_loader
from s2rstore.metrics import nearest_neighbours
from s2rtui.app.actions import ACTIONS
from s2rtui.loaders import store_data
from s2rtui.session import Session, navigation, pending_target, selection, shared_selection
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notebook
from tests.support import embeddings, tiny

RUNS = ("vanilla", "b", "c")
Key = Callable[[Session], object]
_FACTS = '  # data set {}, generation {}, run b, 3 instances in "a"'
_REST = {action.name: action.do for action in ACTIONS if action.do is not None}


def pasted(session: Session) -> object:
    facts = _FACTS.format(session.store.dataset.hash, session.state.generation)
    return session.dispatch(shared_selection.select_text, "worst(3, real.loss)" + facts)


BEGUN: dict[str, Key] = {
    "typed": lambda s: s.dispatch(shared_selection.select_text, "real.loss > 0.3"),
    "saved": lambda s: s.dispatch(shared_selection.select_text, "@costly & all"),
    "pasted": pasted,
    "run": lambda s: s.dispatch(navigation.change_run, 1),
    "undo": lambda s: s.dispatch(selection.undo),
    "redo": lambda s: s.dispatch(selection.redo),
    "alike": lambda s: s.select("like(20, 6)"),
    "other run": lambda s: s.select('worst(3, run("c").real.error)'),
}


@dataclass
class Pair:
    """A session that waits for its worker and one that reads at once, in the same state."""

    waiting: Session
    direct: Session
    worker: bool = False

    def begin(self) -> None:
        """Nothing is at hand but what the first screen shows; there is a past and a future."""
        for session in (self.waiting, self.direct):
            session.defers_loading = False
            session.set_state(self.first(session))
            made = session.select("best15")
            past = ("all", "real.loss > 0.1", "real.loss > 0.2")
            session.set_state(replace(made, past=past, future=("curved", "real.loss < 1")))
        store = self.waiting.store
        store._columns.drop(lambda key: "loss" in key or key[:2] in (("run", "b"), ("run", "c")))
        store.evaluated.clear()
        pending_target.load_columns(
            store, pending_target.current_target(self.waiting.state), lambda: True
        )
        self.waiting.defers_loading = True

    def first(self, session: Session) -> State:
        state = session.state
        return replace(
            state, run="vanilla", trajectories=None, pending=None, past=(), future=(), cursor=20,
            operator="replace", brush=None, other=None, heat=None, adjust=None, viewport=None,
            sort="real.error", descending=True, overlay="off", map_mode="colour", clip=False,
        )  # fmt: skip

    def press(self, key: Key) -> None:
        """With the cursor where the screen shows it."""
        cursor = self.waiting.state.cursor
        self.direct.set_state(replace(self.direct.state, cursor=cursor))
        key(self.waiting)
        key(self.direct)

    def arrive(self) -> None:
        """The worker reads what is awaited until nothing is."""
        for _ in range(4):
            if (state := self.waiting.state).pending is None:
                return
            self.worker = True
            store_data.read_run(self.waiting.store, state, Wanted())
            self.worker = False
            self.waiting.complete_pending()
        raise AssertionError("it is never there")

    def agree(self) -> None:
        one, two = self.waiting.state, self.direct.state
        for name in ("run", "trajectories", "expression", "operator", "sort", "past", "future"):
            assert getattr(one, name) == getattr(two, name), name
        assert np.array_equal(one.selected, two.selected)
        assert np.array_equal(one.base, two.base)


class Wanted:
    """A caller that never loses interest."""

    def is_current(self) -> bool:
        return True


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    """Reading by the session that waits fails anywhere but in its worker."""
    folder = tmp_path_factory.mktemp("waiting")
    path = tiny.build(folder / "s.s2r", runs=RUNS)
    points = np.random.default_rng(1).normal(size=(40, 2))
    for number, run in enumerate(RUNS):
        embeddings.add(path, run, {"sim": points * number, "real": points + number})
    made = Pair(*(Session(path, notebooks=lambda own: Notebook(own, folder)) for _ in range(2)))
    for session in (made.waiting, made.direct):
        session.select("real.loss > 0.15")
        session.writable_notebook.save("costly", shared_selection.current_selection(session.state))
    predicted, neighbours, own = (
        column_loader._predicted,
        nearest_neighbours.neighbours,
        made.waiting.store,
    )

    def read(loader, *rest):
        assert loader is not own._column_loader or made.worker or not made.waiting.defers_loading, (
            rest
        )
        return predicted(loader, *rest)

    def near(store, *rest):
        assert store is not own or made.worker or not made.waiting.defers_loading, rest
        return neighbours(store, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pending_target, "SMALL_STORE", 0)
        patch.setattr(column_loader, "_predicted", read)
        patch.setattr(nearest_neighbours, "neighbours", near)
        yield made
    for session in (made.waiting, made.direct):
        session.close()


@pytest.mark.parametrize("what", BEGUN)
def test_every_key_leaves_what_waits_as_if_it_had_not_waited(pair: Pair, what: str) -> None:
    for name, key in _REST.items():
        pair.begin()
        pair.press(BEGUN[what])
        assert pair.waiting.state.pending is not None
        pair.press(key)
        pair.arrive()
        try:
            pair.agree()
        except AssertionError as error:
            raise AssertionError(f"{what}, {name}: {error}") from error


_KEYS = [
    "next_run", "previous_run", "trajectory", "undo", "redo", "complement", "intersect", "union",
    "subtract", "worst_real", "alike", "other_run", "next_instance",
]  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(sorted(BEGUN)), st.lists(st.sampled_from(_KEYS), min_size=2, max_size=5))
def test_so_do_several(pair: Pair, what: str, names: list[str]) -> None:
    pair.begin()
    pair.press(BEGUN[what])
    for name in names:
        pair.press(_REST[name])
    pair.arrive()
    pair.agree()
