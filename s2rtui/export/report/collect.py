"""From a session to what a report says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from s2rstore.errors import RequestError
from s2rstore.metrics import run_metrics, store_summary
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.view import Scene
from s2rtui.export.report import tables
from s2rtui.export.report.content import Report, ReportImage, ReportTable, RunPart, Section
from s2rtui.export.report.data_uri_images import figure
from s2rtui.export.report.examples import worst
from s2rtui.export.report.request import ReportRequest, RequestedSelection, Told
from s2rtui.export.scene import SceneOptions, described, fed
from s2rtui.session import Session

_SHOWN = ("map", "errors", "rooms", "orientation")
_WIDE = 1500
_HASH = 16


def gather(session: Session, request: ReportRequest, told: Told) -> Report:
    """Evaluate and draw everything. Raises RequestError for what does not exist."""
    plan = [(asked, _runs(session, request, asked)) for asked in request.selections]
    for asked, runs in plan:
        if asked.saved is None:
            for run in runs:
                _staged(session, request, run, asked.expression)
    steps = _Steps(told, 1 + sum(len(runs) for _, runs in plan))
    steps.next("the front page")
    store, state = session.store, session.state
    facts = [
        ("data set", store.dataset.name),
        ("data set hash", store.dataset.hash[:_HASH]),
        ("store", f"{store.path.name}, generation {store.generation}"),
        ("instances", f"{len(store.instances)} in {_trajectories(request, session)}"),
        ("accuracy", f"1 − error / {store.dataset.accuracy_scale:.4g} m, at least 0"),
    ]
    front = _front(session, request)
    sections = [_section(session, request, asked, runs, steps) for asked, runs in plan]
    steps.next("")
    caption = "All runs, over the instances that are new to each model"
    return Report(
        title=request.title or f"{store.dataset.name}: simulation and reality",
        subtitle=request.date,
        facts=facts,
        findings=_findings(session),
        runs=tables.compared(store, state.runs, None, caption),
        pictures=front,
        sections=sections,
    )


def _findings(session: Session) -> list[str]:
    """Without the figures of single runs, which have a table."""
    runs = tuple(f"  {run}: " for run in session.store.runs)
    return [
        line.strip() for line in store_summary.lines(session.store) if not line.startswith(runs)
    ]


class _Steps:
    """Counts what is done and says what comes next."""

    def __init__(self, told: Told, total: int) -> None:
        self._told, self._total, self._done = told, total, -1

    def next(self, what: str) -> None:
        self._done += 1
        self._told(self._done, self._total, what)


def _trajectories(request: ReportRequest, session: Session) -> str:
    names = request.trajectories or session.store.instances.trajectory_names
    return ("trajectory " if len(names) == 1 else "trajectories ") + ", ".join(names)


def _runs(session: Session, request: ReportRequest, asked: RequestedSelection) -> tuple[str, ...]:
    """The runs that a selection is shown in."""
    for run in request.runs:
        if session.store.run(run).key is None:
            raise RequestError(f"--run {run}: not computed yet; run `s2r precompute`")
    if request.runs:
        return request.runs
    kept = asked.saved.run if asked.saved else ""
    return (kept,) if kept in session.state.runs else session.state.runs[:1]


def _staged(
    session: Session, request: ReportRequest, run: str, expression: str, room_names: bool = True
) -> None:
    """The session at a selection in a run."""
    session.set_state(replace(session.state, trajectories=request.trajectories))
    session.select("all")
    session.set_run(run)
    other = request.other if request.other != run else None
    wanted = SceneOptions(
        select=expression, run=run, trajectories=request.trajectories, other=other,
        heat=request.heat, overlay="off", room_names=room_names,
    )  # fmt: skip
    described(session, wanted)


def _drawn(session: Session, *names: str) -> Scene:
    """The scene for some views, without a cursor."""
    views = [BY_NAME[name] for name in names]
    return fed(session, *views, cursor=False)


def _front(session: Session, request: ReportRequest) -> list[ReportImage]:
    """The overview, and two runs compared: the first, and the best other one in reality."""
    runs = session.state.runs
    first = request.runs[0] if request.runs else runs[0]
    others = [run for run in runs if run != first]
    best = max(others, key=lambda run: _real(session, run)) if others else None
    _staged(session, replace(request, other=request.other or best), first, "all", False)
    scene = _drawn(session, "overview", "compare")
    size = (_WIDE, min(1200, 420 + 90 * len(runs)))
    found = [figure(BY_NAME["overview"], scene, request.dark, size)]
    if best is not None:
        compare = BY_NAME["compare"]
        numbers = _numbers(scene, "compare", compare.words(scene))
        found.append(figure(compare, scene, request.dark, (_WIDE, 640), numbers))
    return found


def _real(session: Session, run: str) -> float:
    value = run_metrics.headline(session.store, run, "real").accuracy.value
    return value if value == value else -1.0


def _section(
    session: Session,
    request: ReportRequest,
    asked: RequestedSelection,
    runs: tuple[str, ...],
    steps: _Steps,
) -> Section:
    parts: list[RunPart] = []
    facts: list[tuple[str, str]] = []
    table = remarks = None
    for run in runs:
        steps.next(f"{asked.title} in {run}")
        try:
            _staged(session, request, run, asked.expression)
        except RequestError as error:
            return Section(asked.title, asked.expression, problem=f"Not evaluated: {error}")
        state, store = session.state, session.store
        facts.append((f"count in {run}" if len(runs) > 1 else "count", f"{state.count} instances"))
        if not parts:
            facts += _saved(asked, session)
            caption = f"The instances that it selects in {run}, in every run"
            table = tables.compared(store, state.runs, state.selected & state.base, caption)
            remarks = tables.remarks(session.notes, state.selected)
        if state.selected.any():
            parts.append(_part(session, request, run))
    if not parts:
        return Section(asked.title, asked.expression, facts, problem="Nothing is selected.")
    shown = table if len(session.state.runs) > 1 else None
    return Section(asked.title, asked.expression, facts, shown, remarks, parts)


def _saved(asked: RequestedSelection, session: Session) -> Iterator[tuple[str, str]]:
    """How a saved selection differs from when it was saved."""
    kept = asked.saved
    if kept is None:
        return
    view = f" in {', '.join(kept.trajectories)}" if kept.trajectories else ""
    told = f"{kept.count} instances of run {kept.run} at generation {kept.generation}"
    yield "saved", told + view
    if kept.run not in session.state.runs:
        yield "run", f"{kept.run} is not in this store; evaluated in {session.state.run}"


def _part(session: Session, request: ReportRequest, run: str) -> RunPart:
    scene = _drawn(session, *_SHOWN)
    state, store = session.state, session.store
    pictures = []
    for name in _SHOWN:
        numbers = None
        if name in ("errors", "rooms"):
            numbers = _numbers(scene, name, BY_NAME[name].words(scene))
        pictures.append(figure(BY_NAME[name], scene, request.dark, numbers=numbers))
    heat = state.heat if request.heat else None
    return RunPart(
        run,
        _summary(session, run),
        tables.sides(store, run, state.selected & state.base),
        pictures,
        worst(scene, heat),
    )


def _summary(session: Session, run: str) -> str:
    """How many, and how many of them the model has learned from."""
    state = session.state
    known = state.selected & state.base & ~run_metrics.held_out(session.store, run)
    told = f"{state.count} instances."
    if known.any():
        told += (
            f" The model was trained on {int(known.sum())} of them: they are in the figures "
            "and left out of the table."
        )
    return told


def _numbers(scene: Scene, name: str, caption: str) -> ReportTable:
    names, rows = BY_NAME[name].numbers(scene)
    return ReportTable(caption, names, [[_cell(value) for value in row] for row in rows])


def _cell(value: object) -> str:
    return tables.number(value) if isinstance(value, float) else str(value)
