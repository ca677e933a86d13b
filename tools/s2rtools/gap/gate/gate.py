"""The gate: from a request to a report, for `s2r gap` and the nightly run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.files import layout, safe_files
from s2rstore.language import evaluation
from s2rstore.reader import Store
from s2rtools.gap.axes import AXES, MARGIN, ODOMETRY, THRESHOLD, configured
from s2rtools.gap.axis import Axis, Evidence, GapSettings, measure
from s2rtools.gap.gate import golden_run as golden
from s2rtools.gap.gate.verdict import freeze_scale, judge, read_reference, reference_text, unjudged
from s2rtools.gap.report import GapResult, Report, report
from s2rtools.motion_logs import Drive
from s2rtools.motion_logs.drives import odometry, read_drives


@dataclass(frozen=True, slots=True)
class GapRequest:
    """A request to measure and judge the gap; most fields are options of `s2r gap`.

    `drives` is a folder, `odometry`, or None for the drives of the store; `rate` (Hz) applies to
    odometry without stored times; `topic` carries the poses in ROS bags; `options` are texts of
    options of the axes by name; `anchor_run` is the run whose sim images are the bad state.
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
    threshold: float = THRESHOLD
    margin: float = MARGIN
    options: Mapping[str, str] = field(default_factory=dict)
    settings: GapSettings = field(default_factory=GapSettings)

    def __post_init__(self) -> None:
        for option, unit, value in (
            ("threshold", "a number", self.threshold),
            ("margin", "metres", self.margin),
            ("rate", "Hz", self.rate),
        ):
            if value is not None and not 0 < value < np.inf:
                raise RequestError(f"--{option}: expected {unit} above 0, got {value:g}")
        for name in self.axes:
            if name not in AXES:
                raise RequestError(f"--axis {name}: expected one of {', '.join(AXES)}")
        configured(self.options)

    @property
    def requested_axes(self) -> dict[str, Axis]:
        every = configured(self.options)
        return {name: axis for name, axis in every.items() if name in (self.axes or AXES)}


def collect_evidence(store: Store, request: GapRequest) -> Evidence:
    """Evidence of a request. Raises RequestError for uncomputed runs and empty selections.

    The expression selects among all instances, because axes without a model use all of them; the
    others leave out the trained instances (`instance_selection.held_out`).
    """
    run = store.run(request.run)
    if not run.key:
        raise RequestError(f"{store.path}: run {run.run} is not computed; run `s2r precompute`")
    chosen = evaluation.query(store, request.expression, run.run, with_trained=True).selected
    if not store.run_columns(run.run).valid.any():
        raise RequestError(
            f"{store.path}: run {run.run} has no instance that both sides predicted; "
            "run `s2r precompute`, or `s2r verify`"
        )
    if not chosen.any():
        raise RequestError(f"--select {request.expression!r}: selects no instance of run {run.run}")
    iids = np.flatnonzero(chosen).astype(np.int64)
    return Evidence(store, run.run, iids, request.expression, _drives(store, request),
                    request.features, request.anchor_run)  # fmt: skip


def judge_gap(evidence: Evidence, request: GapRequest) -> GapResult:
    """Measure the gap and judge it by the reference and the golden run of the request.

    Raises RequestError where an axis that is requested by name has no evidence.
    """
    settings, axes = request.settings, request.requested_axes
    frozen = read_reference(request.reference) if request.reference else None
    accepted = golden.read(request.golden) if request.golden else None
    measurement = measure(evidence, settings, axes)
    for name in request.axes:
        if name in measurement.absent:
            raise RequestError(f"--axis {name}: cannot be measured: {measurement.absent[name]}")
    verdict = unjudged(request.threshold)
    if frozen is not None:
        verdict = judge(measurement, frozen, settings, request.threshold)
    comparison = None
    if accepted is not None:
        comparison = golden.compare(evidence, accepted, settings, request.margin)
    comparisons = (axis.compare_runs(evidence, settings) for axis in axes.values())
    across = next((each for each in comparisons if each is not None), None)
    scales = frozen.axes if frozen else {}
    return GapResult(measurement, verdict, request.options, scales, frozen, comparison, across)


def measured_report(evidence: Evidence, request: GapRequest) -> Report:
    """The report of `judge_gap`."""
    return report(evidence, request.settings, judge_gap(evidence, request))


def freeze(evidence: Evidence, request: GapRequest, measured: GapResult) -> tuple[GapResult, str]:
    """The result with its scales, and the text of a reference file, without absent axes.

    Raises InconclusiveError where an axis has too little evidence, and RequestError where one has
    no usable anchor: a reference judges all requested axes, or is not written.
    """
    measurement = measured.measurement
    for axis, reason in measurement.inconclusive.items():
        others = " ".join(f"--axis {name}" for name in request.requested_axes if name != axis)
        hint = f"; to leave it out: {others}" if others else ""
        raise InconclusiveError(f"{axis}: {reason}{hint}")
    store, run = evidence.store, evidence.store.run(evidence.run)
    made_from = {
        "dataset": store.dataset.name,
        "dataset_hash": store.dataset.hash,
        "run": run.run,
        "run_key": run.key,
        "model_sha256": run.model and store.models[run.model].sha256,
        "expression": evidence.expression,
    }
    settings, requested = request.settings, request.requested_axes
    scales = {
        name: freeze_scale(name, result, requested[name].anchor(evidence, settings))
        for name, result in measurement.measured.items()
    }
    return replace(measured, scales=scales), reference_text(scales, made_from)


def _drives(store: Store, request: GapRequest) -> tuple[Drive, ...]:
    if request.drives is None:
        folder = safe_files.checked_folder(store.path, layout.DRIVES)
        return () if folder is None else tuple(read_drives(folder, request.topic))
    if request.drives == ODOMETRY:
        return tuple(odometry(store, request.rate))
    return tuple(read_drives(Path(request.drives), request.topic))
