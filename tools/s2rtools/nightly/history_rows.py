"""Rows of the history: those that a night adds, and the search for existing ones."""

from __future__ import annotations

import datetime
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from s2rstore.gap_history import reader
from s2rstore.gap_history.change_check import Change, change_of
from s2rstore.gap_history.gate_status import EXIT_CODES
from s2rstore.gap_history.reader import History, Night
from s2rstore.gap_history.writer import Rows
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.input_fingerprint import Inputs, version
from s2rtools.nightly.measurement import Estimates, Report
from s2rtools.nightly.report_model import outcome

_FIGURES = ("value", "floor", "gap")
_SUFFIXES = ("", "_low", "_high", "_reason")


@dataclass(frozen=True, slots=True)
class NightResult:
    """A night to add; `measured` is the id of the measurement whose figures it reuses."""

    config: NightlyConfig
    inputs: Inputs
    night: datetime.date
    report: Report
    estimates: Estimates = ()
    measured: int | None = None


def read_or_empty(path: Path) -> History:
    """The history, empty where the file does not exist."""
    return reader.read(path) if path.exists() else History()


def counting_night(history: History, name: str, night: datetime.date) -> Night | None:
    """The valid row of a night, which is the last one written; None if there is none."""
    return next((each for each in history.of_configuration(name) if each.night == night), None)


def equal_measurement(history: History, key: str) -> int | None:
    """Id of the successful measurement with the same key, if there is one."""
    return next((n.measured for n in history.nights if n.key == key and not n.refused), None)


def is_recorded(night: Night | None, result: NightResult, history: History) -> bool:
    """Whether a row already holds the result."""
    if night is None or night.key != result.inputs.key:
        return False
    if night.evidence_since < max(_first_nights(result, history).values()):
        return False  # the night that dated the evidence has been withdrawn
    failure = result.report.get("refused")
    if failure is None or not night.refused:
        return failure is None and not night.refused
    return bool((night.outcome, night.reason) == (failure["outcome"], failure["reason"]))


def rows(result: NightResult, history: History, now: datetime.datetime) -> Rows:
    """The rows that a result adds to each table."""
    number = history.last_id + 1
    measured = number if result.measured is None else result.measured
    first_nights = _first_nights(result, history)
    added: Rows = {
        "night": [_night_row(result, history, max(first_nights.values()), number, measured, now)],
        "recorded": [
            {"name": result.config.name, "part": part, "night": night}
            for part, night in first_nights.items()
            if history.recorded.get((result.config.name, part)) != night
        ],
    }
    if result.measured is None:
        report = json.dumps(result.report, indent=1, sort_keys=True, allow_nan=False)
        added["axis"] = [{"measured": number, **row} for row in _axis_rows(result.report)]
        added["estimate"] = [
            {"measured": number, "position": position, **row}
            for position, row in enumerate(result.estimates)
        ]
        added["report"] = [{"measured": number, "report": report, "version": version()}]
    return added


def _first_nights(result: NightResult, history: History) -> dict[str, datetime.date]:
    """The first night that used each part of the evidence."""
    name, night = result.config.name, result.night
    return {
        part: min(night, history.recorded.get((name, part), night)) for part in result.inputs.parts
    }


def _night_row(
    result: NightResult, history: History, since: datetime.date, number: int, measured: int,
    now: datetime.datetime,
) -> dict[str, Any]:  # fmt: skip
    config, report, verdict = result.config, result.report, result.report["verdict"]
    golden = report["golden"] or {}
    age = (result.night - since).days
    change = _change(result, history)
    final_outcome = outcome(report, change, age > config.stale_after)
    return {
        "id": number,
        "name": config.name,
        "night": result.night,
        "key": result.inputs.key,
        "evidence": result.inputs.evidence,
        "measured": measured,
        "dataset": report["dataset"]["name"],
        "dataset_hash": report["dataset"]["hash"],
        "run": report["run"],
        "run_key": report["run_key"],
        "model": report["model"],
        "expression": report["expression"],
        "outcome": final_outcome,
        "exit_code": EXIT_CODES[final_outcome],
        "headline": verdict["outcome"],
        **{f"gap{end}": verdict.get(f"gap{end}") for end in _SUFFIXES},
        "worst": verdict["worst"],
        "threshold": verdict["threshold"],
        "reason": verdict["reason"],
        "change": change and change.outcome,
        "change_reason": change and change.reason,
        "golden": golden.get("outcome"),
        **{f"golden_change{end}": golden.get(f"change{end}") for end in _SUFFIXES},
        "golden_margin": golden.get("margin"),
        "evidence_since": since,
        "evidence_age": age,
        "stale_after": config.stale_after,
        "written_at": now.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }


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


def _axis_rows(report: Report) -> list[dict[str, Any]]:
    axis_rows: list[dict[str, Any]] = []
    for each in report["axes"]:
        figures = {
            f"{name}{end}": each.get(f"{name}{end}") for name in _FIGURES for end in _SUFFIXES
        }
        note = "; ".join(each["notes"]) or None
        fields = {name: each.get(name) for name in ("axis", "measure", "unit", "anchor", "n")}
        axis_rows.append({**fields, **figures, "state": "measured", "note": note})
    for state in ("inconclusive", "absent"):
        for name, reason in report[state].items():
            axis_rows.append({"axis": name, "state": state, "note": reason})
    return [{"position": position, **row} for position, row in enumerate(axis_rows)]
