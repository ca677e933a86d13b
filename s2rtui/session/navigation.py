"""Move the session: cursor, run, trajectories, generation, finding, and steps of the history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from s2rstore.errors import RequestError, counted
from s2rstore.findings import Finding
from s2rstore.index.catalog import NO_POSES
from s2rstore.language import Node
from s2rstore.language.syntax_tree import Everything
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import NO_RUN
from s2rtui.session import (
    adjusting,
    saved_selection_diff,
    selection,
    targets,
    undo_history,
    view_settings,
)
from s2rtui.session.context import SessionContext
from s2rtui.session.evaluation import evaluate
from s2rtui.session.heatmaps import with_heat
from s2rtui.session.selection import defer, keep_input
from s2rtui.session.state import HeatChoice, History, State, Target
from s2rtui.session.undo_history import Direction


def computed_runs(store: Store) -> tuple[str, ...]:
    """The runs that have predictions."""
    return tuple(name for name, record in store.runs.items() if record.key)


def move_cursor(context: SessionContext, state: State, steps: int) -> State:
    """Move by instances of the selection, or of the base population if nothing is selected.

    From an instance outside of it, the first step leads to the nearest one in that direction.
    """
    members = np.flatnonzero(state.chosen if state.chosen.any() else state.base)
    if not members.size:
        return state.with_message("no instance in view")
    at = int(np.searchsorted(members, -1 if state.cursor is None else state.cursor))
    if steps > 0 and (at == members.size or members[at] != state.cursor):
        at -= 1  # `at` is the next instance already
    return set_cursor(context, state, int(members[(at + steps) % members.size]))


def move_to_end(context: SessionContext, state: State, last: bool) -> State:
    """Move to the first or the last instance of those that `move_cursor` visits."""
    members = np.flatnonzero(state.chosen if state.chosen.any() else state.base)
    if not members.size:
        return state.with_message("no instance in view")
    return set_cursor(context, state, int(members[-1 if last else 0]))


def play_on(context: SessionContext, state: State) -> State:
    """Move to the next instance, if there is one, and keep the message."""
    moved = move_cursor(context, state, 1)
    if state.cursor is not None and (moved.cursor is None or moved.cursor <= state.cursor):
        return state
    return replace(moved, message=state.message, is_error=state.is_error)


def set_cursor(context: SessionContext, state: State, iid: int) -> State:
    """Move to an instance."""
    return state.updated(cursor=iid)


def change_run(context: SessionContext, state: State, steps: int) -> State:
    """Show the next run, counted from the pending one."""
    if not state.runs:
        reason = context.store.missing_run
        no_poses = reason == NO_POSES
        return state.with_message(f"{reason}, so there are no runs" if no_poses else reason)
    target = targets.final(state)
    present = target.run if target.run in state.runs else state.run
    index = (state.runs.index(present) + steps) % len(state.runs)
    return set_run(context, state, state.runs[index])


def set_run(context: SessionContext, state: State, run: str) -> State:
    """Show a run with the selected or pending expression, or all if that cannot be evaluated.

    Its row is chosen in the table of runs.
    """
    target = replace(targets.final(state), run=run)
    return go_to(context, view_settings.choose_row(context, state, "overview", None), target)


def set_trajectories(context: SessionContext, state: State, names: tuple[str, ...] | None) -> State:
    """Show some trajectories, None for all; the expression is kept as by `set_run`."""
    return go_to(context, state, replace(targets.final(state), trajectories=names))


def change_trajectory(context: SessionContext, state: State) -> State:
    """Cycle through all trajectories together and each alone."""
    names = context.store.instances.trajectory_names
    options: list[tuple[str, ...] | None] = [None, *((name,) for name in names)]
    if len(names) == 1:
        return state.with_message(f"there is one trajectory: {names[0]}")
    present = targets.final(state).trajectories
    at = options.index(present) if present in options else -1
    return set_trajectories(context, state, options[(at + 1) % len(options)])


def toggle_trained(context: SessionContext, state: State) -> State:
    """Include or leave out the instances that the models were trained on; keep the expression.

    A message says so where the shown run has none that could be included.
    """
    target = targets.final(state)
    included = not target.with_trained
    result = go_to(context, state, replace(target, with_trained=included))
    message = replace(result, with_trained=included).population_message
    if included and state.pending is None and not state.trained.any():
        message = _nothing_to_include(context.store, state)
    return (
        result
        if result.is_error
        else result.with_message("; ".join(part for part in (message, result.message) if part))
    )


def _nothing_to_include(store: Store, state: State) -> str:
    """Why the shown run has no trained instances in view, in one line."""
    if not state.run:
        return store.missing_run or "there are no runs, so there are no trained instances"
    if not run_metrics.knows_training_set(store, state.run):
        return f"nothing to include: the store does not say what run {state.run} was trained on"
    return f"nothing to include: {state.population_message}"


def go_to(context: SessionContext, state: State, target: Target) -> State:
    """Show a target as the next step of the history, keeping brush and operator.

    A target that is not loaded becomes pending. Until then the nearest loaded place is shown: the
    run, or the trajectories alone.
    """
    target = replace(target, history=undo_history.next_history(state, target))
    if (loading := _node_to_load(context, state, target)) is None:
        return keep_input(state, _settle(context, state, target))
    here, place = targets.place_of(state), targets.place_of(target)
    for nearer in (place, replace(here, trajectories=target.trajectories)):
        if nearer != here and _node_to_load(context, state, nearer) is None:
            state = keep_input(state, _settle(context, state, nearer))
            break
    return defer(state, replace(target, loading=loading))


def _node_to_load(context: SessionContext, state: State, target: Target) -> Node | None:
    """See `targets.node_to_load`; `all` replaces an expression that cannot be evaluated."""
    try:
        return targets.node_to_load(context, state, target)
    except RequestError:
        return targets.node_to_load(context, state, replace(target, node=Everything()))


def select_at(context: SessionContext, state: State, target: Target) -> State:
    """Show a target with its own history, at once or once it is loaded.

    Raises RequestError if the expression cannot be evaluated there.
    """
    if (loading := targets.node_to_load(context, state, target)) is None:
        return _evaluate_at(context, state, target)
    return defer(replace(state, brush=None, operator="replace"), replace(target, loading=loading))


def complete_pending(context: SessionContext, state: State) -> State:
    """Show the pending target, now loaded; the unfinished brush, operator and message are kept."""
    if context.store.generation != state.generation:
        result = enter_generation(context, state)
    elif state.pending is not None:
        result = keep_input(state, _settle(context, state, state.pending))
    else:
        return state
    return _with_earlier_message(state, result)


def _with_earlier_message(before: State, after: State) -> State:
    """`after` with the message of an action in `before` in front of its message."""
    if not (before.keeps_message and before.message):
        return after
    return replace(
        after,
        message="; ".join(part for part in (before.message, after.message) if part),
        is_error=before.is_error or after.is_error,
        keeps_message=not after.message,
    )


def cancel_pending(context: SessionContext, state: State, reason: str) -> State:
    """Stay at the present place and say why."""
    return replace(state, pending=None).with_message(reason, is_error=True)


def enter_generation(context: SessionContext, state: State) -> State:
    """Continue in the context's store, a newer generation, at the pending or present target."""
    store, runs = context.store, computed_runs(context.store)
    target = targets.final(state)
    base = replace(
        state,
        generation=store.generation,
        newest=store.generation,
        runs=runs,
        run=state.run if state.run in runs else next(iter(runs), NO_RUN),
        compared_run=state.compared_run if state.compared_run in runs else None,
    )
    result = _settle(context, base, target)
    if target.run in runs:
        result = keep_input(state, result)
    count = len(store.instances) - state.selected.size
    added = f"{counted(count, 'instance')} added" if count > 0 else ""
    parts = (f"generation {store.generation}", added, result.message)
    return replace(result, message="; ".join(part for part in parts if part), keeps_message=False)


def refuse_generation(fresh: Store, present: Store) -> str:
    """Why a session cannot continue in a newer generation; empty if it can."""
    if fresh.missing_run and not present.missing_run:
        return "the newest generation has no computed run: reopen the store"
    if fresh.identity != present.identity:
        return "the newest generation holds another data set: reopen the store"
    return ""


def _settle(context: SessionContext, base: State, target: Target) -> State:
    """The state at a target, from one of the same generation as the store.

    A pending expression that cannot be evaluated there is left out, and the message says why.
    """
    try:
        return _evaluate_at(context, base, target)
    except RequestError as error:
        place = targets.place_of(target)
        if place != targets.place_of(targets.place_of(base)):
            place = replace(place, history=target.history)
        result = _evaluate_at(context, base, place)
        past, future = (
            tuple(step for step in steps if step.node != target.node)
            for steps in (result.past, result.future)
        )
        return replace(result, past=past, future=future, message=str(error), is_error=True)


def _evaluate_at(context: SessionContext, base: State, target: Target) -> State:
    """Evaluate at a target; raises RequestError if its expression cannot be evaluated."""
    run = target.run if target.run in base.runs else base.run
    place = replace(
        base,
        run=run,
        trajectories=target.trajectories,
        with_trained=target.with_trained,
        cursor=base.cursor if target.cursor is None else target.cursor,
        pending=None,
    )
    history = target.history or (base.past, base.future)
    if target.node is None:
        result = _evaluate_present(context, place, history)
    else:
        result = evaluate(context, place, target.node, history)
    if target.saved is not None:
        message = saved_selection_diff.describe_move(result, base, target.saved)
        result = replace(result, message=message)
    return adjusting.follow_run(context, with_heat(context.store, result))


def _evaluate_present(context: SessionContext, state: State, history: History) -> State:
    """Evaluate the present expression in a new place, or select all if that fails."""
    try:
        return evaluate(context, state, state.node, history)
    except RequestError as error:
        result = evaluate(context, state, Everything(), history)
        message = f"all selected: {state.expression} cannot be evaluated here ({error})"
        return replace(result, message=message)


def open_finding(context: SessionContext, state: State, finding: Finding) -> State:
    """Select the instances of a finding in its run, with the heatmap, run and grouping it names.

    Findings are about the new instances of all trajectories, so these are shown.
    """
    if finding.heat is not None:
        side = state.heat.side if state.heat else "real"
        state = replace(state, heat=HeatChoice(*finding.heat, side), overlay="run")
    if finding.grouping is not None:
        state = replace(state, grouping=finding.grouping)
    if finding.other is not None and finding.other in state.runs:
        state = replace(state, compared_run=finding.other)
    place = replace(
        targets.place_of(targets.final(state)),
        run=finding.run,
        trajectories=None,
        with_trained=False,
    )
    is_here = place == targets.place_of(state)
    if is_here and finding.node is not None:
        state = selection.select(context, state, finding.node, "replace")
    elif not is_here:
        target = targets.with_expression(
            state, place, finding.node or undo_history.upcoming(state).node
        )
        state = go_to(context, replace(state, operator="replace"), target)
    return state.with_message(finding.message)


def undo(context: SessionContext, state: State) -> State:
    """Show the previous step of the history that can still be evaluated."""
    return _walk_history(context, state, "undo")


def redo(context: SessionContext, state: State) -> State:
    """Show the next step of the history that can still be evaluated."""
    return _walk_history(context, state, "redo")


def _walk_history(context: SessionContext, state: State, direction: Direction) -> State:
    """Skip expressions that cannot be evaluated any more and name them in the message."""
    present, skipped = undo_history.upcoming(state), []
    for step, target in undo_history.walk(state, direction):
        try:
            result = select_at(context, state, target)
        except RequestError as error:
            skipped.append(f"left out: {step.expression} ({error})")
            continue
        changed = "" if step.with_trained == present.with_trained else result.population_message
        message = "; ".join(part for part in (result.message, changed, *skipped) if part)
        return replace(result, message=message)
    if present is state:
        state = replace(state, past=()) if direction == "undo" else replace(state, future=())
    return state.with_message("; ".join((f"nothing to {direction}", *skipped)))
