"""Evaluation of a report request: selections, tables and figures become a `Report`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from s2rstore.errors import DamagedStoreError, RequestError, counted
from s2rstore.findings import store_summary
from s2rstore.findings.report import find_all, find_in_selection
from s2rstore.language import Node, parse
from s2rstore.language.syntax_tree import Everything
from s2rstore.metrics import run_metrics
from s2rstore.security.printable_text import printable
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.view import Scene
from s2rtui.export.load_scene import SceneOptions, apply_options, load_scene
from s2rtui.export.report import metric_tables
from s2rtui.export.report.data_uri_images import figure
from s2rtui.export.report.html_page import render_page
from s2rtui.export.report.report_model import (
    Report,
    ReportImage,
    ReportRequest,
    ReportTable,
    RequestedSelection,
    RunPart,
    Section,
    StepCallback,
)
from s2rtui.export.report.worst_instances import worst_instances
from s2rtui.session.error_groups import COUNTS
from s2rtui.session.evaluation import query_of
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.user_data.notebook import ReadNotebook

_SELECTION_VIEWS = ("map", "recall", "errors", "rooms", "orientation")
_WIDE_PIXELS = 1500
_HASH_CHARACTERS = 16


@dataclass(frozen=True, slots=True)
class EvaluatedSelection:
    """A requested selection with its state in each run where it is reported.

    `problem` says why a saved selection cannot be evaluated.
    """

    requested: RequestedSelection
    runs: tuple[str, ...]
    states: tuple[State, ...] = ()
    problem: str = ""


def render_report(
    store: Path, request: ReportRequest, on_step: StepCallback = lambda done, total, step: None
) -> bytes:
    """Return the HTML of a report; equal store, notebook and request give equal bytes.

    Raises RequestError for runs, trajectories or columns that do not exist.
    """
    session = Session(store, None, ReadNotebook)
    try:
        return session_report(session, request, on_step)
    finally:
        session.close()


def session_report(session: Session, request: ReportRequest, on_step: StepCallback) -> bytes:
    """The HTML of a report on a session's open store, whose state it changes."""
    return render_page(build_report(session, request, on_step)).encode()


def build_report(session: Session, request: ReportRequest, on_step: StepCallback) -> Report:
    """Evaluate the selections and draw all figures. Raises RequestError as `render_report`."""
    session.store.require_poses("a report")
    if reason := session.store.missing_run:
        raise RequestError(f"{session.store.path}: {reason}; a report needs a run")
    selections = [_evaluated(session, request, requested) for requested in request.selections]
    done, total = count(), 1 + sum(len(selection.runs) for selection in selections)

    def begin_step(step: str) -> None:
        on_step(next(done), total, step)

    begin_step("overview")
    store, state = session.store, session.state
    names = request.trajectories or store.instances.trajectory_names
    trajectories = ("trajectory " if len(names) == 1 else "trajectories ") + ", ".join(names)
    facts = [
        ("data set", store.dataset.name),
        ("data set hash", store.dataset.hash[:_HASH_CHARACTERS]),
        ("store", f"{store.path.name}, generation {store.generation}"),
        ("instances", f"{len(store.instances)} in {trajectories}"),
        ("population", _population(request)),
        ("accuracy", f"1 − error / {store.dataset.accuracy_scale:.4g} m, at least 0"),
    ]
    overview = _overview_images(session, request)
    sections = [_section(session, request, selection, begin_step) for selection in selections]
    facts += [("note", note) for run in store.runs if (note := store.coverage(run).note)]
    begin_step("")
    caption = "All runs, over the instances that are new to each model"
    return Report(
        title=request.title or f"{store.dataset.name}: simulation and reality",
        subtitle=request.date,
        facts=facts,
        findings=_finding_lines(session, request, selections),
        runs=metric_tables.compared_runs(store, state.runs, None, caption),
        images=overview,
        sections=sections,
        theme="dark" if request.theme == "dark" else "light",
    )


def _evaluated(
    session: Session, request: ReportRequest, requested: RequestedSelection
) -> EvaluatedSelection:
    """Evaluate a selection in its runs. Raises RequestError for one that is not saved."""
    runs = _runs(session, request, requested)
    try:
        node = parse(requested.expression)
        states = tuple(_set_state(session, request, run, node) for run in runs)
    except RequestError as error:
        if requested.saved is None or isinstance(error, DamagedStoreError):
            raise
        return EvaluatedSelection(requested, runs, problem=f"Cannot be evaluated: {error}")
    return EvaluatedSelection(requested, runs, states)


def _finding_lines(
    session: Session, request: ReportRequest, selections: Sequence[EvaluatedSelection]
) -> list[tuple[str, str]]:
    """The findings of the selections, of their runs, and of the first run, in this order.

    Lines, each with the expression that selects its instances; empty where it concerns none.
    """
    store, trajectories = session.store, request.trajectories
    runs = list(dict.fromkeys(run for selection in selections for run in selection.runs))
    lines = [(store_summary.store_line(store, runs[0]), "")]
    for selection in selections:
        requested = selection.requested
        if requested.expression == "all" and trajectories is None:
            continue
        place = " of ".join([requested.title, *([", ".join(trajectories)] if trajectories else [])])
        for state in selection.states:
            selected = state.selected
            if state.with_trained:  # findings are about the new instances
                selected = query_of(
                    store, replace(state, with_trained=False), session.notes
                ).selected
            found = find_in_selection(store, state.run, selected)
            lines += [
                (f"{each.kind} of {state.run} in {place}: {each.line}", each.expression or "")
                for each in found
            ]
    first = session.state.runs[0]
    for run in [*runs, *([first] if first not in runs else [])]:
        mark = "" if run in runs else "not asked for: "
        lines += [
            (f"{mark}{store_summary.finding_line(each)}", each.expression or "")
            for each in find_all(store, run).findings
        ]
    return [(printable(line), expression) for line, expression in lines]


def _runs(
    session: Session, request: ReportRequest, selection: RequestedSelection
) -> tuple[str, ...]:
    for run in request.runs:
        if session.store.run(run).key is None:
            raise RequestError(f"--run {run}: has no results; run `s2r precompute`")
    if request.runs:
        return request.runs
    saved_run = selection.saved.run if selection.saved else ""
    return (saved_run,) if saved_run in session.state.runs else session.state.runs[:1]


def _set_state(
    session: Session, request: ReportRequest, run: str, node: Node, room_names: bool = True
) -> State:
    """Show a selection in a run, with the options of the request."""
    session.set_state(
        replace(session.state, trajectories=request.trajectories, with_trained=request.with_trained)
    )
    session.select(Everything())
    session.set_run(run)
    other = request.other if request.other != run else None
    options = SceneOptions(
        select=node, run=run, trajectories=request.trajectories, other=other,
        with_trained=request.with_trained, heat=request.heat, overlay="off", room_names=room_names,
    )  # fmt: skip
    return apply_options(session, options)


def _population(request: ReportRequest) -> str:
    """Which instances the sections hold, for the facts of the report."""
    if request.with_trained:
        return "with the instances that the models were trained on, which are marked"
    return "the instances that are new to the run: its model was not trained on them"


def _scene(session: Session, *names: str) -> Scene:
    return load_scene(session, *(BY_NAME[name] for name in names), cursor=False)


def _overview_images(session: Session, request: ReportRequest) -> list[ReportImage]:
    """Draw the overview, and the first run compared with the best other run in reality."""

    def real_accuracy(run: str) -> float:
        value = run_metrics.side_metrics(session.store, run, "real").accuracy.value
        return value if value == value else -1.0

    runs = session.state.runs
    first = request.runs[0] if request.runs else runs[0]
    others = [run for run in runs if run != first]
    best = max(others, key=real_accuracy) if others else None
    _set_state(session, replace(request, other=request.other or best), first, Everything(), False)
    scene = _scene(session, "overview", "compare")
    size = (_WIDE_PIXELS, min(1200, 420 + 90 * len(runs)))
    images = [figure(BY_NAME["overview"], scene, request, size)]
    if best is not None:
        compare = BY_NAME["compare"]
        numbers = _numbers(scene, "compare", compare.summary(scene))
        images.append(figure(compare, scene, request, (_WIDE_PIXELS, 640), numbers))
    return images


def _section(
    session: Session,
    request: ReportRequest,
    selection: EvaluatedSelection,
    begin_step: Callable[[str], None],
) -> Section:
    requested, runs = selection.requested, selection.runs
    title = requested.title, requested.expression
    if selection.problem:
        begin_step(f"{requested.title} in {runs[0]}")
        return Section(*title, problem=selection.problem)
    parts: list[RunPart] = []
    facts: list[tuple[str, str]] = []
    table = remarks = None
    store = session.store
    for run, state in zip(runs, selection.states, strict=True):
        begin_step(f"{requested.title} in {run}")
        session.set_state(state)
        facts.append(
            (f"count in {run}" if len(runs) > 1 else "count", f"{state.count_text} instances")
        )
        if not parts:
            facts += _saved_facts(requested, session)
            caption = f"The instances that it selects in {run}, in every run"
            members = state.selected & state.base
            table = metric_tables.compared_runs(store, state.runs, members, caption)
            remarks = metric_tables.remarks(session.notes, state.chosen)
        if state.selected.any():
            parts.append(_part(session, request, run))
    if not parts:
        has_chosen = any(state.chosen.any() for state in selection.states)
        missing = "instance is selected"
        if has_chosen:
            missing = "selected instance has images of both sides"
        return Section(*title, facts, problem=f"No {missing}.")
    comparison = table if len(session.state.runs) > 1 else None
    return Section(*title, facts, comparison, remarks, parts)


def _saved_facts(selection: RequestedSelection, session: Session) -> Iterator[tuple[str, str]]:
    """Yield the state in which a saved selection was saved."""
    saved = selection.saved
    if saved is None:
        return
    view = f" in {', '.join(saved.trajectories)}" if saved.trajectories else ""
    count = counted(saved.count, "instance")
    state = f"{count} of run {saved.run} at generation {saved.generation}"
    population = (
        ""
        if saved.with_trained == session.state.with_trained
        else (", trained ones included" if saved.with_trained else ", new ones only")
    )
    yield "saved", state + view + population
    if saved.run not in session.state.runs:
        yield "run", f"{saved.run} is not in this store; evaluated in {session.state.run}"


def _part(session: Session, request: ReportRequest, run: str) -> RunPart:
    scene = _scene(session, *_SELECTION_VIEWS)
    scene = replace(scene, state=replace(scene.state, grouping=COUNTS))
    state, store = session.state, session.store
    images = []
    for name in _SELECTION_VIEWS:
        numbers = None
        if name in ("recall", "errors", "rooms"):
            numbers = _numbers(scene, name, BY_NAME[name].summary(scene))
        images.append(figure(BY_NAME[name], scene, request, numbers=numbers))
    members = state.selected & state.base
    trained = int((members & state.trained).sum())
    summary = f"{state.count_text} instances."
    if trained:
        summary += (
            f" The model was trained on {trained} of them: they are marked in the figures and left "
            "out of the table."
        )
    examples = worst_instances(scene, state.shown_heat if request.heat else None)
    return RunPart(run, summary, metric_tables.sides(store, run, members), images, examples)


def _numbers(scene: Scene, name: str, caption: str) -> ReportTable:
    names, rows = BY_NAME[name].numbers(scene)

    def cell(value: object) -> str:
        return metric_tables.number(value) if isinstance(value, float | None) else str(value)

    view = BY_NAME[name]
    known = {row: view.row_expression(scene, at) for at, row in enumerate(view.row_names(scene))}
    expressions = [known.get(str(row[0]), "") for row in rows]
    cells = [[cell(value) for value in row] for row in rows]
    return ReportTable(caption, names, cells, expressions=expressions if any(expressions) else ())
