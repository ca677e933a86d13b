"""Report of the gap of one run, as JSON data and as text.

It is the same for the same evidence and seed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.gap_history.gate_status import report_outcome
from s2rstore.intervals import LEVEL_TEXT, Interval
from s2rstore.metrics.exchange import exchange_change
from s2rtools.common.command_line import output
from s2rtools.gap.axes import AXES, configured
from s2rtools.gap.axis import Evidence, GapSettings, Measurement, with_interval
from s2rtools.gap.gate.golden_run import GoldenComparison
from s2rtools.gap.gate.verdict import NOTHING, AxisScale, Reference, Verdict

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class GapResult:
    """Measurement and verdict of the requested axes with their `options`, texts by name.

    `scales` are those of the reference, or new ones to be frozen, which do not judge this result.
    """

    measurement: Measurement
    verdict: Verdict
    options: Mapping[str, str]
    scales: Mapping[str, AxisScale]
    reference: Reference | None = None
    golden: GoldenComparison | None = None
    across: Mapping[str, Any] | None = None


def report(evidence: Evidence, settings: GapSettings, result: GapResult) -> Report:
    """The complete report, rounded to nine digits; non-finite values are null."""
    store = evidence.store
    run = store.run(evidence.run)
    verdict, golden, reference = result.verdict, result.golden, result.reference
    content = {
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash},
        "run": run.run,
        "run_key": run.key,
        "model": run.model,
        "model_sha256": run.model and store.models[run.model].sha256,
        "expression": evidence.expression,
        "selected": int(evidence.iids.size),
        "note": store.coverage(run.run).note,
        "drives": [drive.name for drive in evidence.drives],
        "settings": {
            "seed": settings.seed,
            "level": settings.level,
            **_numbers(result.options),
        },
        "axes": [_axis(name, settings, result) for name in result.measurement.measured],
        "absent": dict(result.measurement.absent),
        "inconclusive": dict(result.measurement.inconclusive),
        "across": result.across,
        "exchange": _exchange(evidence),
        "golden": None if golden is None else {
            "outcome": golden.outcome,
            **golden.change.as_columns("change"),
            "margin": golden.margin,
            "n": golden.n,
            "missing": golden.missing,
            "reason": golden.reason,
        },
        "reference": None if reference is None else {
            "sha256": reference.sha256,
            "made_from": dict(reference.made_from),
        },
        "verdict": {
            "outcome": verdict.outcome,
            "threshold": verdict.threshold,
            "worst": verdict.worst,
            **verdict.gap.as_columns("gap"),
            "reason": verdict.reason,
        },
    }  # fmt: skip
    return plain(content)


def _exchange(evidence: Evidence) -> dict[str, Any] | None:
    """The exchange rate of the run before and after its images were changed.

    None where no selected pair is new to the run and to that of its model on unchanged images.
    """
    members = np.zeros(len(evidence.store.instances), dtype=np.bool_)
    members[evidence.iids] = True
    try:
        return exchange_change(evidence.store, evidence.run, members).as_json()
    except RequestError:
        return None


def _numbers(options: Mapping[str, str]) -> dict[str, Any]:
    """The values of all options that are written as --NAME VALUE."""
    axes = configured(options)
    names = [(axis, name) for axis, of in AXES.items() if of.flag is None for name in of.options]
    return {name: getattr(axes[axis], name) for axis, name in names}


def _axis(name: str, settings: GapSettings, result: GapResult) -> dict[str, Any]:
    record, scale = AXES[name], result.scales.get(name)
    measured = result.measurement.measured[name]
    value = measured.bounds(settings.level)
    floor = Interval(measured.floor, measured.floor, measured.floor)
    anchor: dict[str, Any] = {}
    if scale is not None:
        interval = Interval(scale.anchor_low, scale.anchor, scale.anchor_high)
        anchor = {**interval.as_columns("anchor"), "anchor_state": scale.state}
    return {
        "axis": name,
        "measure": record.measure,
        "unit": record.unit,
        **value.as_columns("value"),
        "sample": value.text or None,
        **floor.as_columns("floor"),
        "floor_is": record.floor,
        "n": measured.n,
        **result.verdict.gaps.get(name, NOTHING).as_columns("gap"),
        **anchor,
        "fingerprint": dict(measured.fingerprint),
        "details": dict(measured.details),
        "notes": list(measured.notes),
    }


def plain(value: Any) -> Any:
    """JSON data: numbers rounded to nine digits, non-finite ones as null, tuples as lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value


def gap_text(report: dict[str, Any], with_details: bool = False, frozen: bool = False) -> str:
    """Return the text of a gap report: measured axes, missing axes and the outcome.

    `frozen`: a reference scale or a golden run was written from this report.
    """
    return "\n".join([*_lines(report, with_details), _outcome(report, frozen)])


def _lines(report: dict[str, Any], with_details: bool) -> Iterator[str]:
    model = f"model {report['model']}" if report["model"] else "imported predictions"
    yield (
        f"run {report['run']}, {model}, {report['selected']} instances ({report['expression']})\n"
    )
    yield _axes(report["axes"])
    for axis in report["axes"]:
        yield from _notes(axis)
    for axis in report["axes"] if with_details else ():
        yield f"\n{axis['axis'].upper()}\nfloor {axis['floor_is']}"
        yield from AXES[axis["axis"]].load()().describe(axis["details"])
    for name, reason in (report["absent"] | report["inconclusive"]).items():
        yield f"  {name}: not measured: {reason}"
    if report["across"]:
        yield from _rank_consistency(report["across"], with_details)
    if report["exchange"]:
        yield f"  simulation: {report['exchange']['text']}"
    if report["golden"]:
        yield _golden(report["golden"])
    if report["reference"]:
        source = report["reference"]["made_from"]
        parts = (f"{name} {source.get(name, '?')}" for name in ("dataset", "run", "expression"))
        yield f"  reference scale frozen from {', '.join(parts)}"


def _axes(axes: list[dict[str, Any]]) -> str:
    level = f"({LEVEL_TEXT})"
    names = ("axis", "m", f"value {level}", "floor", "unit", "n", f"G {level}")
    rows = [
        (
            axis["axis"], axis["measure"], with_interval(axis, "value"), _floor(axis), axis["unit"],
            axis["n"], with_interval(axis, "gap", 1),
        )
        for axis in axes
    ]  # fmt: skip
    return output.table(names, rows)


def _floor(axis: dict[str, Any]) -> str:
    """Return the floor; without an interval if it is a constant."""
    if axis["floor_low"] == axis["floor"] == axis["floor_high"]:
        return f"{axis['floor']:g}"
    return with_interval(axis, "floor")


def _notes(axis: dict[str, Any]) -> Iterator[str]:
    """Yield the meaning of G = 100, and the notes."""
    if "anchor" in axis:
        yield (
            f"  {axis['axis']}: G 100 is {with_interval(axis, 'anchor')} {axis['unit']}: "
            f"{axis['anchor_state']}"
        )
    yield from (f"  {axis['axis']}: {note}" for note in axis["notes"])


def _rank_consistency(across: dict[str, Any], with_details: bool) -> Iterator[str]:
    if "refused" in across:
        yield f"  across runs: {across['refused']}"
        return
    correlations = ", ".join(
        f"{name} {'-' if across[name.lower()] is None else format(across[name.lower()], '.2f')}"
        for name in ("Kendall", "Pearson")
    )
    yield (
        f"  across {len(across['runs'])} runs: Spearman {with_interval(across, 'spearman', 2)}, "
        f"about {across['scope']}; of these runs only: {correlations}, MMRV "
        f"{across['mmrv']:.2f} m"
    )
    yield (
        f"  regret of {across['chosen_run']}, which simulation ranks first: "
        f"{with_interval(across, 'regret', 2)} m more real error than {across['best_run']}"
    )
    if not with_details or not across["rooms"]:
        return
    rows = [
        (
            room, within["n"], *(within[name] for name in ("spearman", "kendall", "mmrv")),
            within["chosen_run"], within["best_run"], with_interval(within, "regret", 2),
        )
        for room, within in across["rooms"].items()
    ]  # fmt: skip
    names = ("room", "n", "Spearman", "Kendall", "MMRV m", "by sim", "best", "regret m")
    yield output.table(names, rows)


def _golden(golden: dict[str, Any]) -> str:
    missing = f"{golden['missing']} of its instances are missing" if golden["missing"] else ""
    text = (
        f"golden run: {golden['outcome']}: mean real error changed by "
        f"{with_interval(golden, 'change')} m over {golden['n']} instances, "
        f"margin {golden['margin']:g} m"
    )
    return "; ".join(part for part in (text, missing, golden["reason"]) if part)


def _outcome(report: dict[str, Any], frozen: bool) -> str:
    outcome = report_outcome(report)
    if outcome is None and frozen:
        return "\nnot judged yet: give the frozen files to --reference and --golden"
    if outcome is not None and not report["reference"]:
        return f"\n{outcome}: by the golden run alone; give --reference FILE to judge G as well"
    text = _verdict(report["verdict"])
    if outcome is not None and outcome != report["verdict"]["outcome"]:
        text += f"\n{outcome}: with the golden run"
    return text


def _verdict(verdict: dict[str, Any]) -> str:
    if verdict["worst"] is None:
        return f"\n{verdict['outcome']}: {verdict['reason']}"
    return (
        f"\n{verdict['outcome']}: gap {with_interval(verdict, 'gap', 1)}, "
        f"worst axis {verdict['worst']}; {verdict['reason']}"
    )
