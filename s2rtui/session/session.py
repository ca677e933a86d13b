"""The session holds an open store and the one frozen state that reducers replace."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import compute_progress
from s2rstore.files.planned_poses import read_planned_poses
from s2rstore.findings import largest_room
from s2rstore.gap_history import reader
from s2rstore.index.population import INCLUDE_HINT
from s2rstore.language import Node
from s2rstore.language.syntax_tree import Everything, Extreme, Field
from s2rstore.reader import Store
from s2rstore.records import NO_RUN
from s2rstore.security.printable_text import printable
from s2rtui.session import navigation, selection, targets
from s2rtui.session.context import BasePopulations, Reducer, SessionContext
from s2rtui.session.heatmaps import with_heat
from s2rtui.session.run_comparison import runs_in_use
from s2rtui.session.state import HistoryFile, Operator, State
from s2rtui.user_data.notebook import Notebook, Notes

INDEX_MEMORY = "128MB"
"""DuckDB's memory limit: columns are read one by one, so the index itself needs little."""
NotebookFactory = Callable[[str], Notebook]


@dataclass(frozen=True, slots=True)
class StoreUpdates:
    """What is published now: the number of the generation, and the gap history.

    `can_follow`: whether the session can go on in it by itself. `computing`: the progress of a
    process that computes in the store, empty without one.
    """

    generation: int
    history: HistoryFile | None
    can_follow: bool = False
    computing: str = ""


class Session:
    """One user's analysis of one store. Only `dispatch` replaces the state."""

    def __init__(
        self,
        path: Path | str,
        run: str | None = None,
        notebooks: NotebookFactory | None = None,
        gap_history: Path | None = None,
        with_trained: bool = False,
        generation: int | None = None,
        poses: Path | None = None,
    ) -> None:
        """Open a store on a run (default: the first computed one) and select its worst room.

        Without a computed run, all images are selected.

        `notebooks` opens the notebook of a store by its identity; without it nothing is saved.
        `gap_history` overrides the history file of the store, `generation` the published one.
        `with_trained` includes the instances that the models were trained on. `poses` is a CSV file
        of planned poses, which the map shows. Set `defers_loading` if background workers read
        columns; then call `close_retired_stores` when they are idle. Raises RequestError if the
        store, the run or the history file does not exist.
        """
        if gap_history is not None and not gap_history.is_file():
            raise RequestError(f"--history {gap_history}: no such file; `s2r nightly` writes one")
        planned = read_planned_poses(poses) if poses is not None else ()
        self.store: Store = s2rstore.open(path, INDEX_MEMORY, generation)
        self.notebook = notebooks(self.store.identity) if notebooks else None
        if self.notebook:
            self.notebook.use_parts(self.store.parts)
        self.defers_loading = False
        self._retired: list[Store] = []
        self._is_branch = False
        self._is_pinned = generation is not None
        self._examined = self.store.generation, False
        self._base_populations = BasePopulations()
        self._gap_history = gap_history.resolve() if gap_history else None
        initial = _initial_state(self.store, run, self._history_file())
        self._state = replace(initial, with_trained=with_trained, planned=planned)
        error = self.notebook.error if self.notebook else ""
        self.dispatch(_select_finding, error)

    @property
    def state(self) -> State:
        """The current state."""
        return self._state

    @property
    def notes(self) -> Notes:
        """The user's saved selections, notes and tags as of the last read."""
        return self.notebook.notes if self.notebook else Notes()

    @property
    def writable_notebook(self) -> Notebook:
        """The notebook; raises RequestError if the session has none."""
        if self.notebook is None:
            raise RequestError("this session has no notebook: nothing can be saved")
        return self.notebook

    def branch(self) -> Session:
        """An independent session on the same open store and notes, for a background thread.

        It starts on the first run with everything selected, and closes nothing.
        """
        branch = copy(self)
        branch.defers_loading, branch._is_branch = False, True
        branch._base_populations, branch._retired = BasePopulations(), []
        initial = _initial_state(self.store, None, self.state.history)
        branch._state = with_heat(self.store, initial)
        return branch

    def close(self) -> None:
        """Close all stores."""
        self.store.close()
        self.close_retired_stores()

    def dispatch(
        self, reducer: Reducer, *arguments: Any, store: Store | None = None, **options: Any
    ) -> State:
        """Replace the state by `reducer(context, state, *arguments, **options)`.

        `store` is a newer generation: the reducer runs on it, and it becomes the session's store.
        If the reducer raises, state and store stay as they are.
        """
        opened = store or self.store
        notes = self.notebook.notes_for(opened.parts) if self.notebook else self.notes
        context = SessionContext(opened, notes, self._base_populations, self.defers_loading)
        state = reducer(context, self._state, *arguments, **options)
        if opened is not self.store:
            if self.notebook:
                self.notebook.use_parts(opened.parts)
            self._base_populations.drop_generation(self.store.generation)
            self._retired.append(self.store)
            self.store = opened
        self._state = state
        if not self._is_branch:
            self.store.in_use = runs_in_use(state)
        return state

    def set_state(self, state: State) -> State:
        """Replace the state by another one of this session."""
        return self.dispatch(lambda context, present: state)

    def show_message(self, text: str, is_error: bool = False) -> State:
        """Show a message; an error stays until the next action."""
        return self.dispatch(lambda context, state: state.with_message(text, is_error))

    # --- shorthands for reducers -----------------------------------------------------------------

    def select(self, expression: str | Node, operator: Operator | None = None) -> State:
        """See `selection.select`."""
        return self.dispatch(selection.select, expression, operator)

    def set_cursor(self, iid: int) -> State:
        """See `navigation.set_cursor`."""
        return self.dispatch(navigation.set_cursor, iid)

    def set_run(self, run: str) -> State:
        """See `navigation.set_run`."""
        return self.dispatch(navigation.set_run, run)

    # --- generations -----------------------------------------------------------------------------

    def open_newest_generation(self) -> State:
        """Continue in the newest generation, at once or once it is loaded."""
        store, state = self.store, self.state
        waits = self.defers_loading and store.files.is_remote
        newest = state.newest if waits else store.latest_generation()
        if newest == store.generation:
            return self.show_message("this is the newest generation")
        is_large = len(store.instances) > targets.SMALL_STORE
        if waits or (self.defers_loading and is_large):
            target = replace(targets.final(state), generation=newest)
            return self.dispatch(navigation.go_to, target)
        return self._enter(s2rstore.open(store.path, INDEX_MEMORY), navigation.enter_generation)

    def complete_pending(self, fresh: Store | None = None) -> State:
        """Show the pending target, now loaded; `fresh` is its store if the generation is newer."""
        if fresh is not None:
            return self._enter(fresh, navigation.complete_pending)
        return self.dispatch(navigation.complete_pending)

    def _enter(self, fresh: Store, reducer: Reducer) -> State:
        """Replace the store by a newer generation; a store that is refused is closed."""
        if reason := navigation.refuse_generation(fresh, self.store):
            fresh.close()
            return self.dispatch(navigation.cancel_pending, reason)
        try:
            state = self.dispatch(reducer, store=fresh)
        except BaseException:
            fresh.close()
            raise
        if not self.defers_loading:
            self.close_retired_stores()
        return state

    def close_retired_stores(self) -> None:
        """Close the stores of earlier generations; call it while no worker reads them."""
        while self._retired:
            self._retired.pop().close()

    def read_updates(self) -> StoreUpdates:
        """What is published now; for any thread, because a server may take long to answer."""
        generation = self.store.latest_generation()
        if self._examined[0] != generation:
            self._examined = generation, self._can_follow(generation)
        progress = compute_progress.read(self.store.files)
        computing = "" if progress is None else printable(progress.text)
        return StoreUpdates(generation, self._history_file(), self._examined[1], computing)

    def _can_follow(self, generation: int) -> bool:
        """Whether another generation has the same instances, and is not refused."""
        store = self.store
        if self._is_pinned or generation == store.generation:
            return False
        try:
            with s2rstore.open(store.path, INDEX_MEMORY, generation) as fresh:
                is_refused = bool(navigation.refuse_generation(fresh, store))
                return fresh.parts == store.parts and not is_refused
        except (RequestError, OSError):  # the error is shown when the user opens it
            return False

    def follow(self, updates: StoreUpdates) -> bool:
        """Continue in a newer generation with the same instances; whether there is one.

        The message stays where that is possible at once. The first computed run is shown as on the
        first screen, if nothing was selected before. Not while something is pending, and not in a
        session that was opened on a certain generation.
        """
        state = self.state
        if not updates.can_follow or updates.generation == self.store.generation or state.pending:
            return False
        self.open_newest_generation()
        if self.state.pending is not None or self.state.is_error:
            return True
        if state.run == NO_RUN and self.state.run != NO_RUN:
            if not self.state.past:
                self.dispatch(_select_finding, "")
        else:
            self.dispatch(
                lambda context, present: replace(
                    present,
                    message=state.message,
                    is_error=state.is_error,
                    keeps_message=state.keeps_message,
                )
            )
        return True

    def apply_updates(self, updates: StoreUpdates) -> bool:
        """Put what is published now into the state; whether any of it is new."""
        newest, history = updates.generation, updates.history
        if (newest, history) == (self.state.newest, self.state.history):
            return False
        self.dispatch(lambda context, state: replace(state, newest=newest, history=history))
        return True

    def _history_file(self) -> HistoryFile | None:
        if self._gap_history is None:
            stored = self.store.gap_history()
            return None if stored is None else HistoryFile(*stored)
        stamp = reader.file_stamp(self._gap_history)
        return None if stamp is None else HistoryFile(self._gap_history, stamp)


def _initial_state(store: Store, run: str | None, history: HistoryFile | None) -> State:
    """The state on a run before anything is selected; raises RequestError if it is not computed."""
    name = NO_RUN if run is None and store.missing_run else store.run_name(run)
    if name != NO_RUN and store.run(name).key is None:
        raise RequestError(f"run {name!r}: not computed yet; run `s2r precompute`")
    everything = np.ones(len(store.instances), dtype=np.bool_)
    state = State(
        generation=store.generation,
        newest=store.generation,
        runs=navigation.computed_runs(store),
        run=name,
        trajectories=None,
        node=Everything(),
        selected=everything,
        base=everything,
        trained=np.zeros_like(everything),
        chosen=everything,
        cursor=None,
        heat=None,
        history=history,
    )
    if not store.missing_run:
        return state
    centre = "map" if store.has_poses else "list"
    return replace(state, view="instance", centre=centre, sort="iid", descending=False)


def _select_finding(context: SessionContext, state: State, error: str) -> State:
    """Select the first screen's finding, the room with the worst errors in reality.

    `error` is shown in place of the finding's description if it is not empty.
    """
    if reason := context.store.missing_run:
        state = replace(selection.select(context, state, "all", "replace"), past=())
        message = f"{reason}; 3 shows an image, 8 the list"
        if not context.store.has_poses:
            message = "images without poses: `3` shows an image, `8` the list, `/` selects"
        return replace(state, message=error or message, is_error=bool(error))
    node: Node = Extreme("worst", 15, True, Field("real.error"))
    message = "the worst 15 % in reality"
    if (found := _worst_room(context.store, state.run)) is not None:
        node, message = found
    state = with_heat(context.store, selection.select(context, state, node, "replace"))
    if not state.base.any():
        message = f"no instance is new to the run: {INCLUDE_HINT}"
    return replace(state, past=(), message=error or message, is_error=bool(error))


def _worst_room(store: Store, run: str) -> tuple[Node, str] | None:
    """The expression and the description of the room with the largest errors.

    Whether it is evident is tested for the findings, which come later: the first screen waits for
    no interval.
    """
    largest = largest_room(store, run)
    if largest is None:
        return None
    group, median, n = largest
    text = f"worst room: {group.name}, median real error {median:.2f} m, n {n} new"
    return group.node, f"{text} (I says whether it is evident)"
