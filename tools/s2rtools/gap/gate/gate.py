"""From a request to a report: what the command and the nightly run both do."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.files import layout, safe_files
from s2rstore.language import evaluation
from s2rstore.reader import Store
from s2rtools.gap import axes, defaults
from s2rtools.gap.axes import AXES
from s2rtools.gap.axis_result import Axis, Evidence, GapSettings
from s2rtools.gap.dynamics import options
from s2rtools.gap.gate import golden_run as golden
from s2rtools.gap.gate import reference
from s2rtools.gap.gate.verdict import judge, unjudged
from s2rtools.gap.measure import frozen, measure
from s2rtools.gap.report import Judged, Report, across_report, report
from s2rtools.gap.task.rank_consistency import rank_consistency
from s2rtools.motion_logs import Drive
from s2rtools.motion_logs.drives import read_drives
from s2rtools.motion_logs.store_odometry import odometry


@dataclass(frozen=True, slots=True)
class GapRequest:
    """What to measure and what to judge it by.

    `drives` is a folder, `odometry`, or None for those in the store; `rate` (Hz) is that of
    odometry that was stored without times, `topic` names the poses of ROS bags, `dynamics` are
    words NAME=VALUE of `options`. `anchor_run` is
    the run whose sim images are the visual axis' bad state.
    """

    run: str | None = None
    expression: str = "all"
    axes: tuple[str, ...] = ()
    drives: str | None = None
    rate: float | None = None
    features: Path | None = None
    anchor_run: str | None = None
    topic: str | None = None
    reference: Path | None = None
    golden: Path | None = None
    threshold: float = defaults.THRESHOLD
    margin: float = defaults.MARGIN
    dynamics: tuple[str, ...] = ()
    settings: GapSettings = field(default_factory=GapSettings)

    def __post_init__(self) -> None:
        if not np.isfinite(self.threshold) or self.threshold <= 0:
            raise RequestError(f"--threshold: over 0, not {self.threshold:g}")
        if not np.isfinite(self.margin) or self.margin <= 0:
            raise RequestError(f"--margin: metres over 0, not {self.margin:g}")
        if self.rate is not None and not 0 < self.rate < float("inf"):
            raise RequestError(f"--rate: Hz over 0, not {self.rate:g}")
        for name in self.axes:
            if name not in AXES:
                raise RequestError(f"--axis {name}: one of {', '.join(AXES)}")
        options.axes(self.dynamics)

    @property
    def wanted(self) -> dict[str, Axis]:
        asked = options.axes(self.dynamics)
        names = [name for name in AXES if name in (self.axes or AXES)]
        return {name: asked.get(name) or axes.axis(name) for name in names}


def evidence(store: Store, request: GapRequest) -> Evidence:
    """Raises RequestError for a run that is not computed or a selection of nothing."""
    run = store.run(request.run)
    if not run.key:
        raise RequestError(f"{store.path}: run {run.run} is not computed; run `s2r precompute`")
    chosen = evaluation.select(store, request.expression, run.run)
    if not store.run_columns(run.run).valid.any():
        raise RequestError(
            f"{store.path}: run {run.run} has no instance that both sides predicted; "
            "run `s2r precompute`, or `s2r verify`"
        )
    if not chosen.any():
        raise RequestError(f"--select {request.expression!r}: no instance of run {run.run}")
    iids = np.flatnonzero(chosen).astype(np.int64)
    drives = _drives(store, request)
    return Evidence(store, run.run, iids, request.expression, drives, request.features,
                    request.anchor_run)  # fmt: skip


def judged(found_on: Evidence, request: GapRequest) -> Judged:
    """Measure, and judge by the reference and the golden run where there are some.

    Raises RequestError where an axis that is asked for by its name has no evidence.
    """
    frozen_scale = reference.read(request.reference) if request.reference else None
    accepted = golden.read(request.golden) if request.golden else None
    found = measure(found_on, request.settings, request.wanted)
    for name in request.axes:
        if name in found.absent:
            raise RequestError(f"--axis {name}: cannot be measured: {found.absent[name]}")
    if frozen_scale is None:
        verdict = unjudged(request.threshold)
    else:
        verdict = judge(found, frozen_scale, request.settings, request.threshold)
    compared = None
    if accepted is not None:
        compared = golden.compare(found_on, accepted, request.settings, request.margin)
    ranked = _across(found_on, request)
    scale = frozen_scale.axes if frozen_scale else {}
    return Judged(found, verdict, request.wanted, scale, frozen_scale, compared, ranked)


def measured_report(found_on: Evidence, request: GapRequest) -> Report:
    """The report of `judged`."""
    return report(found_on, request.settings, judged(found_on, request))


def freeze(found_on: Evidence, request: GapRequest, measured: Judged) -> tuple[Judged, str]:
    """What was measured with its scale, and that as a reference's file; the axes without evidence
    are left out.

    Raises InconclusiveError where an axis has too little evidence, RequestError where one has no
    usable anchor: a reference judges all that was asked for, or is not written.
    """
    found = measured.found
    for axis, why in found.inconclusive.items():
        others = " ".join(f"--axis {name}" for name in request.wanted if name != axis)
        told = f"; without it: {others}" if others else ""
        raise InconclusiveError(f"{axis}: {why}{told}")
    store, run = found_on.store, found_on.store.run(found_on.run)
    made_from = {
        "dataset": store.dataset.name,
        "dataset_hash": store.dataset.hash,
        "run": run.run,
        "run_key": run.key,
        "model_sha256": store.models[run.model].sha256,
        "expression": found_on.expression,
    }
    scale = frozen(found, found_on, request.settings, request.wanted)
    return replace(measured, scale=scale), reference.text(scale, made_from)


def _across(found_on: Evidence, request: GapRequest) -> dict[str, object] | None:
    if "task" not in request.wanted:
        return None
    try:
        return across_report(rank_consistency(found_on.store, found_on.iids, request.settings))
    except InconclusiveError as error:
        return {"refused": str(error)}


def _drives(store: Store, request: GapRequest) -> tuple[Drive, ...]:
    wanted = request.drives
    if wanted is None:
        own = safe_files.checked_folder(store.path, layout.DRIVES)
        return () if own is None else tuple(read_drives(own, request.topic))
    if wanted == defaults.ODOMETRY:
        return tuple(odometry(store, request.rate))
    return tuple(read_drives(Path(wanted), request.topic))
