"""The selection pipeline: every change of the selection passes through `select`."""

from __future__ import annotations

from dataclasses import replace

from s2rstore.errors import RequestError
from s2rstore.language import Node, check_size, parse, to_text
from s2rstore.language.syntax_tree import And, Everything, Minus, Not, Or, Saved, leaves
from s2rtui.session import targets, undo_history
from s2rtui.session.context import SessionContext
from s2rtui.session.evaluation import evaluate
from s2rtui.session.state import Operator, State, Target


def select(
    context: SessionContext,
    state: State,
    expression: str | Node,
    operator: Operator | None = None,
) -> State:
    """Combine an expression with the selection by `operator`, by default the pending operator.

    Evaluates it at once, or makes it pending if columns have to be loaded first. Raises
    ExpressionError.
    """
    node = parse(expression) if isinstance(expression, str) else expression
    operator = operator or state.operator
    if operator != "replace":
        node = _combine(undo_history.upcoming(state).node, operator, node)
        check_size(to_text(node))
    planned, pending = targets.plan(context, state, node)
    if planned.loading is not None:
        return defer(replace(state, brush=None, operator="replace"), planned)
    return evaluate(context, state, node, planned.history or (state.past, state.future), pending)


def _combine(current: Node, operator: Operator, new: Node) -> Node:
    """Two selections as one, in the shortest form."""
    if operator == "intersect":
        return new if current == Everything() else And(current, new)
    return Or(current, new) if operator == "union" else Minus(current, new)


def select_suggested(context: SessionContext, state: State) -> State:
    """Select the expression that the message of an empty selection suggests."""
    if state.suggested is None:
        return state.with_message("there is no suggestion: the selection is not empty")
    return select(context, state, state.suggested, "replace")


def complement(context: SessionContext, state: State) -> State:
    """Select all valid instances that are not selected."""
    node = undo_history.upcoming(state).node
    return select(context, state, node.inner if isinstance(node, Not) else Not(node), "replace")


def set_operator(context: SessionContext, state: State, operator: Operator) -> State:
    """Set how the next selection combines with this one; repeating the operator cancels it."""
    if operator == state.operator:
        operator = "replace"
    messages = {
        "replace": "",
        "intersect": "the next selection is intersected with this one",
        "union": "the next selection is added to this one",
        "subtract": "the next selection is subtracted from this one",
    }
    return state.updated(operator=operator, message=messages[operator])


def refresh(context: SessionContext, state: State) -> State:
    """Evaluate the selection and the pending one again after saved selections have changed.

    If the selection can no longer be evaluated, it stays and the message says why.
    """
    result = state
    try:
        if any(isinstance(leaf, Saved) for leaf in leaves(state.node)):
            here = targets.place_of(state)
            if (loading := targets.node_to_load(context, state, here)) is None:
                evaluated = evaluate(context, state, state.node, (state.past, state.future))
                result = replace(keep_input(state, evaluated), pending=state.pending)
            elif state.pending is None:
                return defer(state, replace(here, loading=loading))
        if (target := result.pending) is not None:
            loading = targets.expand_saved_names(context, target.node or state.node)
            result = replace(result, pending=replace(target, loading=loading))
    except RequestError as error:
        return result.with_message(f"{error}: the selection is unchanged", is_error=True)
    return result


def defer(state: State, target: Target) -> State:
    """Make a target pending in place of an earlier one, and name it in the message."""
    loading = to_text(target.node or state.node)
    if target.generation != state.generation:
        loading = f"run {target.run} of generation {target.generation}"
    elif target.run != state.run:
        loading = f"run {target.run}"
    return replace(
        state, pending=target, message=f"loading {loading}", is_error=False, keeps_message=False
    )


def keep_input(before: State, after: State) -> State:
    """`after` with the unfinished brush and the pending operator of `before`."""
    return replace(after, brush=before.brush, operator=before.operator)
