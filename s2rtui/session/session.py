"""The session: holds the store and moves from one frozen state to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.gap_history import reader
from s2rstore.language import Node, parse
from s2rstore.language.syntax_tree import Not
from s2rstore.reader import Store
from s2rstore.security.printable_text import printable
from s2rtui.session import generations, navigation, pending_target, start
from s2rtui.session import history as walking
from s2rtui.session.generations import INDEX_MEMORY
from s2rtui.session.heatmaps import with_heat
from s2rtui.session.selection import Selecting
from s2rtui.session.state import HistoryFile, Operator, State
from s2rtui.user_data.notebook import Notebook, Notes

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
        self._told = ""
        self._retired: list[Store] = []
        self._selecting = Selecting()
        self._nights = nights.resolve() if nights else reader.history_path(self.store.path)
        self.state = start.empty(self.store, run, self._history())
        first, told = start.finding(self.store, self.state.run)
        begun = with_heat(self.store, self.selected(self.state, first))
        trouble = self.notebook.error if self.notebook else ""
        self.state = replace(begun, past=(), message=trouble or told, is_error=bool(trouble))

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

    # --- the state -----------------------------------------------------------------------------

    def set(self, state: State) -> State:
        """Make `state` the current one."""
        self.state = state
        self.store.in_use = pending_target.in_use(state)
        return state

    def change(self, **fields: Any) -> State:
        """Change some fields; a message, an error too, belongs to the change that made it."""
        self._told = str(fields.get("message", ""))
        return self.set(replace(self.state, **{"message": "", "is_error": False, **fields}))

    def tell(self, message: str, is_error: bool = False) -> State:
        """Show a message; an error stays until the next change."""
        self._told = printable(message)
        return self.set(replace(self.state, message=self._told, is_error=is_error))

    @property
    def told(self) -> str:
        """What is shown, unless it is about what is selected or awaited."""
        return self.state.message if self.state.message == self._told else ""

    # --- selections ----------------------------------------------------------------------------

    def select(self, expression: str) -> State:
        """Select by an expression. Raises ExpressionError; the state stays as it was."""
        return self.set(self.selected(self.state, expression))

    def choose(self, expression: str | Node) -> State:
        """Join a selection to the present or awaited one by the pending operator, then used up.

        Awaited where a worker has to read for it. Raises ExpressionError; the state stays as it
        was.
        """
        node = parse(expression) if isinstance(expression, str) else expression
        current = parse(pending_target.soon(self.state).expression)
        return navigation.select(self, start.joined(current, self.state.operator, node))

    def renew(self) -> State:
        """The present expression evaluated anew, after saved names have changed their meaning."""
        try:
            return navigation.renew(self)
        except RequestError as error:
            return self.tell(f"{error}: the selection is as it was", is_error=True)

    def complement(self) -> State:
        """All valid instances that are not selected."""
        node = parse(pending_target.soon(self.state).expression)
        return navigation.select(self, node.inner if isinstance(node, Not) else Not(node))

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
        return self.change(operator=operator, message=told[operator])

    def selected(self, state: State, expression: str | Node) -> State:
        """A state after selecting in it, which is not made the current one."""
        return self._selecting.selected(self.store, self.notes, state, expression)

    def kept(self, state: State) -> State:
        """See `Selecting.kept`."""
        return self._selecting.kept(self.store, self.notes, state)

    def undo(self) -> State:
        """Back to the expression before this one."""
        return walking.walk(self, "undo")

    def redo(self) -> State:
        """Forward to the expression that was left by undo."""
        return walking.walk(self, "redo")

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
        return self.change(cursor=iid)

    def change_run(self, steps: int) -> State:
        """To the next run, with the same expression where it still means something."""
        runs, there = self.state.runs, pending_target.bound(self.state)
        present = there.run if there.run in runs else self.state.run
        return self.put_run(runs[(runs.index(present) + steps) % len(runs)])

    def put_run(self, run: str) -> State:
        """To a run by name, with what is selected or awaited, or all where that means nothing."""
        return navigation.move(self, replace(pending_target.bound(self.state), run=run))

    def put_trajectories(self, names: tuple[str, ...] | None) -> State:
        """To some trajectories, None for all; otherwise as `put_run`."""
        return navigation.move(self, replace(pending_target.bound(self.state), trajectories=names))

    def change_trajectory(self) -> State:
        """All trajectories, then each alone."""
        names = self.store.instances.trajectory_names
        options: list[tuple[str, ...] | None] = [None, *((name,) for name in names)]
        present = pending_target.bound(self.state).trajectories
        at = options.index(present) if present in options else -1
        if len(names) == 1:
            return self.tell(f"there is one trajectory: {names[0]}")
        return self.put_trajectories(options[(at + 1) % len(options)])

    # --- generations ---------------------------------------------------------------------------

    def retire(self, store: Store) -> None:
        """Have a store closed that was moved on from, once nobody reads it."""
        self._selecting.forget(store.generation)
        self._retired.append(store)
        if not self.waits:
            self.release()

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
        stamp = reader.file_stamp(self._nights)
        return None if stamp is None else HistoryFile(self._nights, stamp)

    def move_on(self) -> State:
        """See `generations.move_on`."""
        return generations.move_on(self)

    def enter(self, fresh: Store) -> State:
        """See `generations.enter`."""
        return generations.enter(self, fresh)
