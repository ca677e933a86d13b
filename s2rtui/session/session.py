"""The session: holds the store and moves from one frozen state to the next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore import findings, selection
from s2rstore.errors import RequestError
from s2rstore.language import Node, base_population, mask, parse, to_text
from s2rstore.language.nodes import Extreme, Field, Named
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.plots.frame import panned, zoomed
from s2rtui.session.heat import choices
from s2rtui.session.state import OVERLAYS, HeatChoice, MapMode, State, View

_HISTORY = 100


class Session:
    """One user's analysis of one store; every transition gives the new state."""

    def __init__(self, path: Path | str, run: str | None = None) -> None:
        """Raises RequestError where there is no store or no computed run."""
        self.store: Store = s2rstore.open(path)
        self._retired: Store | None = None
        self.state = self._first_state(run)

    def close(self) -> None:
        self.store.close()
        if self._retired is not None:
            self._retired.close()

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
        )
        state = self._with_heat(self._selected(state, self._finding(chosen.run)))
        return replace(state, past=(), message=self._finding_text(chosen.run))

    def _finding(self, run: str) -> Node:
        """The first screen's selection: the room where reality is worst."""
        rooms = findings.regions(self.store, run)
        if not rooms:
            return Extreme("worst", 15, True, Field("real.error"))
        return Named(Field("room"), rooms[0].room)

    def _finding_text(self, run: str) -> str:
        rooms = findings.regions(self.store, run)
        if not rooms:
            return "the worst 15 % in reality"
        worst = rooms[0]
        return (
            f"worst region: {worst.room}, median error {worst.real_median:.2f} m real, "
            f"{worst.sim_median:.2f} m sim, {worst.n} instances new to the model"
        )

    def _set(self, state: State) -> State:
        self.state = state
        return state

    def tell(self, message: str, is_error: bool = False) -> State:
        """Show a message; an error stays until the next change."""
        return self._set(replace(self.state, message=message, is_error=is_error))

    def select(self, expression: str) -> State:
        """Select by an expression. Raises ExpressionError; the state stays as it was."""
        return self._set(self._selected(self.state, expression))

    def _selected(self, state: State, expression: str | Node) -> State:
        node = parse(expression) if isinstance(expression, str) else expression
        context = selection.context(self.store, state.run, state.trajectories)
        chosen = mask(node, context)
        past = state.past
        text = to_text(node)
        if text != state.expression:
            past = (*past, state.expression)[-_HISTORY:]
        made = replace(
            state,
            expression=text,
            selected=chosen,
            base=base_population(context),
            past=past,
            message="" if chosen.any() else "nothing is selected",
            is_error=False,
        )
        return replace(made, cursor=self._kept_cursor(made))

    def _kept_cursor(self, state: State) -> int | None:
        """The cursor where it is still inside, else the selection's worst real error."""
        pool = state.selected if state.selected.any() else state.base
        if state.cursor is not None and pool[state.cursor]:
            return state.cursor
        members = np.flatnonzero(pool)
        if not members.size:
            return None
        errors = self.store.run_columns(state.run).real.error[members]
        return int(members[int(np.argmax(np.nan_to_num(errors, nan=-1.0)))])

    def undo(self) -> State:
        """Back to the expression before this one."""
        if not self.state.past:
            return self.tell("nothing to undo")
        *past, last = self.state.past
        return self._set(replace(self._selected(self.state, last), past=tuple(past)))

    def move_cursor(self, steps: int) -> State:
        """To the next instance of the selection (of all, where none is selected)."""
        state = self.state
        members = np.flatnonzero(state.selected if state.selected.any() else state.base)
        if not members.size:
            return self.tell("no instance in view")
        at = int(np.searchsorted(members, -1 if state.cursor is None else state.cursor))
        cursor = int(members[(at + steps) % members.size])
        return self._set(replace(state, cursor=cursor, message="", is_error=False))

    def change_run(self, steps: int) -> State:
        """To the next run, with the same expression where it still means something."""
        runs = self.state.runs
        name = runs[(runs.index(self.state.run) + steps) % len(runs)]
        state = self._selected(replace(self.state, run=name), self.state.expression)
        return self._set(self._with_heat(state))

    def change_trajectory(self) -> State:
        """All trajectories, then each alone."""
        names = self.store.instances.trajectory_names
        options: list[tuple[str, ...] | None] = [None, *((name,) for name in names)]
        following = options[(options.index(self.state.trajectories) + 1) % len(options)]
        if len(names) == 1:
            return self.tell(f"there is one trajectory: {names[0]}")
        return self._set(
            self._selected(replace(self.state, trajectories=following), self.state.expression)
        )

    def _with_heat(self, state: State) -> State:
        """The same heat where the run has it, else the run's first."""
        options = choices(self.store, state.run)
        side: Side = state.heat.side if state.heat else "real"
        wanted = (state.heat.kind, state.heat.mode) if state.heat else None
        if not options:
            return replace(state, heat=None)
        kind, mode = wanted if wanted in options else options[0]
        return replace(state, heat=HeatChoice(kind, mode, side))

    def change_heat(self, steps: int) -> State:
        """The next heatmap kind."""
        return self._change_heat(steps, same_kind=False)

    def change_mode(self) -> State:
        """The next mode of the same kind."""
        return self._change_heat(1, same_kind=True)

    def _change_heat(self, steps: int, same_kind: bool) -> State:
        heat = self.state.heat
        options = choices(self.store, self.state.run)
        if heat is None or not options:
            return self.tell(f"run {self.state.run} has no heatmaps; `s2r precompute` makes them")
        if same_kind:
            modes = [mode for kind, mode in options if kind == heat.kind]
            mode = modes[(modes.index(heat.mode) + 1) % len(modes)]
            made = replace(heat, mode=mode)
        else:
            kinds = list(dict.fromkeys(kind for kind, _ in options))
            kind = kinds[(kinds.index(heat.kind) + steps) % len(kinds)]
            made = replace(heat, kind=kind, mode=next(m for k, m in options if k == kind))
        return self._set(replace(self.state, heat=made, message=made.label, is_error=False))

    def change_side(self) -> State:
        """The side whose heat lies on the map."""
        if self.state.heat is None:
            return self.tell("no heatmaps")
        side: Side = "sim" if self.state.heat.side == "real" else "real"
        heat = replace(self.state.heat, side=side)
        return self._set(replace(self.state, heat=heat, message=f"heat of the {side} side"))

    def change_overlay(self) -> State:
        """No heat on the map, that of the instance, that of the whole run."""
        if self.state.heat is None:
            return self.tell("no heatmaps")
        overlay = OVERLAYS[(OVERLAYS.index(self.state.overlay) + 1) % len(OVERLAYS)]
        told = {"off": "heat off", "instance": "heat of this instance", "run": "heat of the run"}
        return self._set(
            replace(self.state, overlay=overlay, message=told[overlay], is_error=False)
        )

    def change_map_mode(self) -> State:
        mode: MapMode = "full" if self.state.map_mode == "colour" else "colour"
        told = "sim, truth and real" if mode == "full" else "truth coloured by the shift"
        return self._set(replace(self.state, map_mode=mode, message=f"map: {told}", is_error=False))

    def show(self, view: View) -> State:
        return self._set(replace(self.state, view=view))

    def zoom(self, factor: float) -> State:
        """Around the cursor; 0 shows the whole map."""
        if factor == 0:
            return self._set(replace(self.state, viewport=None))
        view = self.state.viewport or self.store.dataset.bounds
        truth, cursor = self.store.instances, self.state.cursor
        centre = None if cursor is None else (float(truth.x[cursor]), float(truth.y[cursor]))
        return self._set(replace(self.state, viewport=zoomed(view, factor, centre)))

    def pan(self, across: float, down: float) -> State:
        """By shares of what is in view."""
        view = self.state.viewport or self.store.dataset.bounds
        moved = panned(view, across, down, self.store.dataset.y_down)
        return self._set(replace(self.state, viewport=moved))

    def _retire(self, store: Store) -> None:
        """Close a store only at the next change: a worker may still be reading it."""
        if self._retired is not None:
            self._retired.close()
        self._retired = store

    def notice(self) -> bool:
        """Look for a newer generation; True where there is one that was not known."""
        newest = self.store.latest_generation()
        if newest == self.state.newest:
            return False
        self._set(replace(self.state, newest=newest))
        return True

    def move_on(self) -> State:
        """Open the newest generation, keeping run and expression where they still exist."""
        if self.store.latest_generation() == self.store.generation:
            return self.tell("this is the newest generation")
        old, state = self.store, self.state
        self.store = s2rstore.open(old.path)
        runs = tuple(name for name, record in self.store.runs.items() if record.key)
        run = state.run if state.run in runs else runs[0]
        fresh = replace(
            state,
            generation=self.store.generation,
            newest=self.store.generation,
            runs=runs,
            run=run,
        )
        try:
            made = self._selected(fresh, state.expression)
        except RequestError:
            made = self._selected(fresh, "all")
        self._retire(old)
        told = f"generation {self.store.generation}"
        return self._set(replace(self._with_heat(made), message=told))
