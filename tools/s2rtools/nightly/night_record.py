"""The record that a night adds to the history."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass

from s2rstore.gap_history.change_check import Change, change_of
from s2rstore.gap_history.gate_status import EXIT_CODES
from s2rstore.gap_history.reader import AxisFigures, History, Night, NightlyEstimate
from s2rstore.intervals import Interval
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.input_fingerprint import Inputs, version
from s2rtools.nightly.measurement import Estimates, Report, exchange_rows
from s2rtools.nightly.report_model import outcome


@dataclass(frozen=True, slots=True)
class NightResult:
    """A night to add; `measured` is the id of the measurement whose figures it reuses."""

    config: NightlyConfig
    inputs: Inputs
    night: datetime.date
    report: Report
    estimates: Estimates = ()
    measured: int | None = None


def is_recorded(night: Night | None, result: NightResult, history: History) -> bool:
    """Whether a record already holds the result."""
    if night is None or night.key != result.inputs.key:
        return False
    if night.evidence_since < _evidence_since(result, history):
        return False  # the night that dated the evidence has been withdrawn
    failure = result.report.get("refused")
    if failure is None or not night.refused:
        return failure is None and not night.refused
    return bool((night.outcome, night.reason) == (failure["outcome"], failure["reason"]))


def night_record(result: NightResult, history: History, now: datetime.datetime) -> Night:
    """The record of a result that is added to `history` at the time `now`."""
    config, report, verdict = result.config, result.report, result.report["verdict"]
    number = history.last_id + 1
    golden = report["golden"] or {}
    since = _evidence_since(result, history)
    age = (result.night - since).days
    change = _change(result, history)
    final_outcome = outcome(report, change, age > config.stale_after)
    return Night(
        id=number,
        name=config.name,
        night=result.night,
        key=result.inputs.key,
        evidence=result.inputs.evidence,
        measured=number if result.measured is None else result.measured,
        dataset=report["dataset"]["name"],
        dataset_hash=report["dataset"]["hash"],
        run=report["run"],
        run_key=report["run_key"],
        model=report["model"],
        expression=report["expression"],
        outcome=final_outcome,
        exit_code=EXIT_CODES[final_outcome],
        headline=verdict["outcome"],
        gap=Interval.from_columns(verdict, "gap"),
        worst=verdict["worst"],
        threshold=verdict["threshold"],
        reason=verdict["reason"],
        change=None if change is None else change.outcome,
        change_reason=None if change is None else change.reason,
        golden=golden.get("outcome"),
        golden_change=Interval.from_columns(golden, "change"),
        golden_margin=golden.get("margin", math.nan),
        evidence_since=since,
        evidence_age=age,
        stale_after=config.stale_after,
        written_at=now.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        axes=_axes(report),
        estimates=_estimates(result, history),
        parts=result.inputs.parts,
        version=version(),
    )


def _evidence_since(result: NightResult, history: History) -> datetime.date:
    """The first night that used the newest part of the evidence."""
    known = history.first_nights(result.config.name)
    return max(min(result.night, known.get(part, result.night)) for part in result.inputs.parts)


def _change(result: NightResult, history: History) -> Change | None:
    """The growth of G over the earlier nights and this one."""
    report = result.report
    past = [
        night for night in history.of_configuration(result.config.name)
        if night.night < result.night and night.measured != result.measured
    ]  # fmt: skip
    gaps = {
        axis["axis"]: (axis["gap"], axis["anchor"])
        for axis in report["axes"]
        if axis.get("gap") is not None and axis.get("anchor") is not None
    }
    return change_of(past, report["dataset"]["name"], report["run"], report["expression"], gaps)


def _axes(report: Report) -> tuple[AxisFigures, ...]:
    measured = [
        AxisFigures(
            axis=each["axis"],
            state="measured",
            measure=each["measure"],
            unit=each["unit"],
            value=Interval.from_columns(each, "value"),
            floor=Interval.from_columns(each, "floor"),
            gap=Interval.from_columns(each, "gap"),
            anchor=each.get("anchor", math.nan),
            n=each["n"],
            note="; ".join(each["notes"]) or None,
        )
        for each in report["axes"]
    ]
    others = [
        AxisFigures(axis, state, note=reason)
        for state in ("inconclusive", "absent")
        for axis, reason in report[state].items()
    ]
    return (*measured, *others)


def _estimates(result: NightResult, history: History) -> tuple[NightlyEstimate, ...]:
    if result.measured is not None:
        measured = (night for night in history.nights if night.measured == result.measured)
        return next(measured).estimates
    return tuple(
        NightlyEstimate(
            row["parameter"], Interval.from_columns(row, "value"), row.get("unit") or "",
            row.get("note"),
        )
        for row in (*result.estimates, *exchange_rows(result.report))
    )  # fmt: skip
