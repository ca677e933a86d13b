"""The session: holds the store and moves from one frozen state to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore import history, selection
from s2rstore.errors import RequestError
from s2rstore.extremes import largest
from s2rstore.language import MaskContext, Node, base_population, mask, parse, to_text
from s2rstore.language.nodes import Not
from s2rstore.reader import Store
from s2rtui.notebook import Notebook, Notes
from s2rtui.session import anew, loading
from s2rtui.session.begin import finding, joined
from s2rtui.session.heat import with_heat
from s2rtui.session.state import HistoryFile, Operator, State

HISTORY = 100
INDEX_MEMORY = "128MB"
"""Columns are read one by one, so the index itself needs little."""
Notebooks = Callable[[str], Notebook]


class Session:
    """One user's analysis of one store; every transition gives the new state."""

    def __init__(
        self,
        path: Path | str,
        run: str | None = None,
        notebooks: Notebooks | None = None,
        nights: Path | None = None,
    ) -> None:
        """`notebooks` opens a data set's notebook by its hash; without it nothing is kept.

        `nights` is a history of the gap (default: the store's own). `waits` says that workers read
        the stores, awaited runs among them (see `loading`), and that somebody calls `release`.
        Raises RequestError where there is no store, no computed run, or not the history that was
        named.
        """
        if nights is not None and not nights.is_file():
            raise RequestError(f"--history {nights}: no such file; `s2r nightly` writes one")
        self.store: Store = s2rstore.open(path, INDEX_MEMORY)
        self.notebook = notebooks(self.store.dataset.hash) if notebooks else None
        self.waits = False
        self._retired: list[Store] = []
        self._bases: dict[tuple[object, ...], NDArray[np.bool_]] = {}
        self._nights = nights or history.path_in(self.store.path)
        self.state = self._first_state(run)

    @property
    def notes(self) -> Notes:
        """The user's things as they were read last."""
        return self.notebook.notes if self.notebook else Notes()

    @property
    def book(self) -> Notebook:
        """The notebook. Raises RequestError where nothing is kept."""
        if self.notebook is None:
            raise RequestError("nothing is kept in this session")
        return self.notebook

    def close(self) -> None:
        self.store.close()
        self.release()

    def _first_state(self, run: str | None) -> State:
        chosen = self.store.run(run)
        if chosen.key is None:
            raise RequestError(f"run {chosen.run!r}: not computed yet; run `s2r precompute`")
        n = len(self.store.instances)
        state = State(
            generation=self.store.generation,
            newest=self.store.generation,
            runs=tuple(name for name, record in self.store.runs.items() if record.key),
            run=chosen.run,
            trajectories=None,
            expression="all",
            selected=np.ones(n, dtype=np.bool_),
            base=np.ones(n, dtype=np.bool_),
            cursor=None,
            heat=None,
            history=self._history(),
        )
        first, told = finding(self.store, chosen.run)
        state = with_heat(self.store, self._selected(state, first))
        return replace(state, past=(), message=told)

    # --- the state -----------------------------------------------------------------------------

    def set(self, state: State) -> State:
        """Make `state` the current one."""
        self.state = state
        self.store.in_use = loading.in_use(state)
        return state

    def tell(self, message: str, is_error: bool = False) -> State:
        """Show a message; an error stays until the next change."""
        return self.set(replace(self.state, message=message, is_error=is_error))

    # --- selections ----------------------------------------------------------------------------

    def select(self, expression: str) -> State:
        """Select by an expression. Raises ExpressionError; the state stays as it was."""
        return self.set(self._selected(self.state, expression))

    def choose(self, expression: str | Node) -> State:
        """Join a selection to the present one by the pending operator, which is then used up.

        Raises ExpressionError; the state stays as it was.
        """
        node = parse(expression) if isinstance(expression, str) else expression
        current = parse(self.state.expression)
        return self.set(self._selected(self.state, joined(current, self.state.operator, node)))

    def renew(self) -> State:
        """The present expression evaluated anew, after saved names have changed their meaning."""
        if "@" not in self.state.expression:
            return self.state
        try:
            return self.select(self.state.expression)
        except RequestError as error:
            return self.tell(f"{error}: the selection is as it was", is_error=True)

    def complement(self) -> State:
        """All valid instances that are not selected."""
        node = parse(self.state.expression)
        return self.set(
            self._selected(self.state, node.inner if isinstance(node, Not) else Not(node))
        )

    def expect(self, operator: Operator) -> State:
        """How the next selection joins this one; asked for twice, it is dropped again."""
        if operator == self.state.operator:
            operator = "replace"
        told = {
            "replace": "",
            "intersect": "the next selection is intersected with this one",
            "union": "the next selection is added to this one",
            "subtract": "the next selection is taken out of this one",
        }
        made = replace(self.state, operator=operator, message=told[operator], is_error=False)
        return self.set(made)

    def _selected(self, state: State, expression: str | Node) -> State:
        node = parse(expression) if isinstance(expression, str) else expression
        context = selection.context(self.store, state.run, state.trajectories, self.notes.nodes)
        chosen = mask(node, context)
        past, future = state.past, state.future
        text = to_text(node)
        if text != state.expression:
            past, future = (*past, state.expression)[-HISTORY:], ()
        told = ["" if chosen.any() else "nothing is selected"]
        told.append(anew.told(node, state, context, self.notes))
        made = replace(
            state,
            expression=text,
            selected=chosen,
            base=self._base(state, context),
            past=past,
            future=future,
            operator="replace",
            brush=None,
            message="; ".join(part for part in told if part),
            is_error=False,
        )
        return replace(made, cursor=self._kept_cursor(made))

    def _base(self, state: State, context: MaskContext) -> NDArray[np.bool_]:
        """The base population; the same array for as long as it holds the same."""
        key = (self.store.generation, state.run, state.trajectories)
        if key not in self._bases:
            found = base_population(context)
            known = (base for base in self._bases.values() if np.array_equal(base, found))
            self._bases[key] = next(known, found)
        return self._bases[key]

    def _kept_cursor(self, state: State) -> int | None:
        """The cursor where it is still inside, else the selection's worst real error."""
        pool = state.selected if state.selected.any() else state.base
        if state.cursor is not None and pool[state.cursor]:
            return state.cursor
        return largest(self.store.run_columns(state.run).real.error, pool)

    def undo(self) -> State:
        """Back to the expression before this one."""
        return self._walk(self.state.past, "undo")

    def redo(self) -> State:
        """Forward to the expression that was left by undo."""
        return self._walk(self.state.future, "redo")

    def _walk(self, texts: tuple[str, ...], what: str) -> State:
        """To the last of some expressions that still means something here; the rest is told."""
        before, left, lost = self.state, list(texts), [""]
        while left:
            text = left.pop()
            try:
                made = self._selected(before, text)
            except RequestError as error:
                lost.append(f"left out: {text} ({error})")
                continue
            told = "; ".join(part for part in (made.message, *lost) if part)
            past, future = tuple(left), (*before.future, before.expression)
            if what == "redo":
                past, future = (*before.past, before.expression), tuple(left)
            return self.set(replace(made, past=past, future=future, message=told))
        kept = replace(before, past=() if what == "undo" else before.past)
        self.set(replace(kept, future=() if what == "redo" else kept.future))
        return self.tell("; ".join((f"nothing to {what}", *lost[1:])))

    # --- moving --------------------------------------------------------------------------------

    def move_cursor(self, steps: int) -> State:
        """To the next instance of the selection (of all, where none is selected)."""
        state = self.state
        members = np.flatnonzero(state.selected if state.selected.any() else state.base)
        if not members.size:
            return self.tell("no instance in view")
        at = int(np.searchsorted(members, -1 if state.cursor is None else state.cursor))
        return self.put_cursor(int(members[(at + steps) % members.size]))

    def put_cursor(self, iid: int) -> State:
        """To one instance."""
        return self.set(replace(self.state, cursor=iid, message="", is_error=False))

    def change_run(self, steps: int) -> State:
        """To the next run, with the same expression where it still means something."""
        runs, awaited = self.state.runs, self.state.awaited
        present = awaited.run if awaited and awaited.run in runs else self.state.run
        return self.put_run(runs[(runs.index(present) + steps) % len(runs)])

    def put_run(self, run: str) -> State:
        """To a run by name; where its columns have yet to be read, it is awaited."""
        awaited = self.state.awaited
        if awaited and awaited.generation != self.state.generation:
            return loading.expect(self, run, awaited.generation)
        if self.waits and run != self.state.run and not loading.is_ready(self.store, run):
            return loading.expect(self, run, self.state.generation)
        loading.give_up(self)
        return self.turn_to(run)

    def turn_to(self, run: str) -> State:
        """To a run by name, now; all is selected where the expression means nothing there."""
        state = self._kept(replace(self.state, run=run))
        return self.set(with_heat(self.store, state))

    def put_trajectories(self, names: tuple[str, ...] | None) -> State:
        """To some trajectories, None for all."""
        return self.set(self._kept(replace(self.state, trajectories=names)))

    def _kept(self, state: State) -> State:
        """The expression evaluated in another situation, or all where it means nothing there."""
        try:
            return self._selected(state, state.expression)
        except RequestError as error:
            made = self._selected(state, "all")
            told = f"all selected: {state.expression} means nothing here ({error})"
            return replace(made, message=told)

    def change_trajectory(self) -> State:
        """All trajectories, then each alone."""
        names = self.store.instances.trajectory_names
        options: list[tuple[str, ...] | None] = [None, *((name,) for name in names)]
        present = self.state.trajectories
        at = options.index(present) if present in options else -1
        if len(names) == 1:
            return self.tell(f"there is one trajectory: {names[0]}")
        return self.put_trajectories(options[(at + 1) % len(options)])

    # --- generations ---------------------------------------------------------------------------

    def release(self) -> None:
        """Close the stores that were moved on from: call it when no worker reads."""
        while self._retired:
            self._retired.pop().close()

    def notice(self) -> bool:
        """Look for a newer generation and new nights; True where one was not known."""
        newest, nights = self.store.latest_generation(), self._history()
        if (newest, nights) == (self.state.newest, self.state.history):
            return False
        self.set(replace(self.state, newest=newest, history=nights))
        return True

    def _history(self) -> HistoryFile | None:
        stamp = history.stamp(self._nights)
        return None if stamp is None else HistoryFile(self._nights, stamp)

    def move_on(self) -> State:
        """Open the newest generation, keeping run and expression where they still exist."""
        if self.store.latest_generation() == self.store.generation:
            return self.tell("this is the newest generation")
        if self.waits and len(self.store.instances) > loading.AT_ONCE:
            awaited = self.state.awaited.run if self.state.awaited else self.state.run
            return loading.expect(self, awaited, self.store.latest_generation())
        return self.enter(s2rstore.open(self.store.path, INDEX_MEMORY))

    def enter(self, fresh_store: Store) -> State:
        """Go on in a newer generation; brush and operator stay where the run does."""
        old, state = self.store, self.state
        runs = tuple(name for name, record in fresh_store.runs.items() if record.key)
        if fresh_store.dataset.hash != old.dataset.hash or not runs:
            fresh_store.close()
            what = "has no computed run" if not runs else "holds another data set"
            return self.tell(f"the newest generation {what}: open it anew", is_error=True)
        run = state.run if state.run in runs else runs[0]
        fresh = replace(
            state,
            generation=fresh_store.generation,
            newest=fresh_store.generation,
            runs=runs,
            run=run,
            other=state.other if state.other in runs else None,
            awaited=None,
        )
        self.store = fresh_store
        try:
            made = with_heat(self.store, self._kept(fresh))
        except BaseException:
            self.store = old
            fresh_store.close()
            raise
        self._bases = {key: base for key, base in self._bases.items() if key[0] != old.generation}
        self._retired.append(old)
        if not self.waits:
            self.release()
        if run == state.run:
            made = replace(made, brush=state.brush, operator=state.operator)
        told = (f"generation {self.store.generation}", made.message)
        return self.set(replace(made, message="; ".join(part for part in told if part)))
