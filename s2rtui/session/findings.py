"""The reducer of the findings view: select the instances of a finding."""

from __future__ import annotations

from dataclasses import replace

from s2rstore.findings import Finding
from s2rtui.session import navigation, selection, targets
from s2rtui.session.context import SessionContext
from s2rtui.session.state import HeatChoice, State


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
        target = targets.with_expression(state, place, finding.node or targets.upcoming(state).node)
        state = navigation.go_to(context, replace(state, operator="replace"), target)
    return state.with_message(finding.message)
