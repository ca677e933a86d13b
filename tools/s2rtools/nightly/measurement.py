"""Measurements of a night: the report of the gap and the simulator's identified parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import InconclusiveError, S2RError, one_line
from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rtools.gap.gate import gate
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.input_fingerprint import Inputs

if TYPE_CHECKING:
    from s2rtools.sysid.identify import Identification

Report = dict[str, Any]
Estimates = Sequence[Mapping[str, Any]]
"""Rows with `parameter`, `value`, `value_low`, `value_high`, `unit` and optionally `note`."""
Measuring = Callable[[Store, NightlyConfig], Report]
Estimating = Callable[[NightlyConfig], Estimates]


def measure_gap(store: Store, config: NightlyConfig) -> Report:
    """The report of `s2r gap` for this configuration."""
    return gate.measured_report(gate.collect_evidence(store, config.request), config.request)


def estimate_parameters(config: NightlyConfig) -> Estimates:
    """Parameters as `s2r sysid` identifies them, none without the section [sysid].

    For too few drives, one row with the reason.
    """
    from s2rtools.motion_logs.drives import read_drives
    from s2rtools.sysid.identify import identify

    sysid = config.sysid
    if sysid is None:
        return ()
    drives = read_drives(Path(sysid.drives), config.request.topic)
    try:
        return estimate_rows(identify(drives, sysid.settings(), _NoProgress()))
    except InconclusiveError as error:
        return [{"parameter": sysid.simulator, "note": f"not identified: {error}"}]


def estimate_rows(result: Identification) -> Estimates:
    """One row per parameter, and one for the simulator with all warnings."""
    notes = dict.fromkeys(result.unsettled, "the search did not converge")
    notes |= dict.fromkeys(result.identifiability.undetermined, "not determined by these drives")
    notes |= dict.fromkeys(result.at_ends, "at the end of its range")
    rows: list[Mapping[str, Any]] = [
        {
            "parameter": one.name, "value": one.value, "value_low": one.low,
            "value_high": one.high, "unit": one.unit, "note": notes.get(one.name),
        }
        for one in result.estimates
    ]  # fmt: skip
    if result.warnings:
        rows.append({"parameter": result.space.simulator.name, "note": "; ".join(result.warnings)})
    return rows


def exchange_rows(report: Report) -> Estimates:
    """Rows of the known exchange rates of a report, before and after its images were changed."""
    exchange = report.get("exchange") or {}
    names = {"after": "exchange rate", "before": "exchange rate before the changes"}
    found = {key: exchange.get(key) or {} for key in names}
    return [
        {
            "parameter": names[key], "value": rate["value"], "value_low": rate["low"],
            "value_high": rate["high"], "unit": "1", "note": exchange["changes"] or None,
        }
        for key, rate in found.items() if rate.get("low") is not None
    ]  # fmt: skip


class _NoProgress:
    """A progress reporter that shows nothing."""

    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


def failed_report(store: Store, config: NightlyConfig, inputs: Inputs, error: S2RError) -> Report:
    """Report of a night without a measurement; `refused` holds the outcome and the reason.

    Too little evidence is INCONCLUSIVE; a request that does not fit the store is an ERROR.
    """
    request = config.request
    run, reason = store.run(inputs.run), one_line(error)
    outcome = "INCONCLUSIVE" if isinstance(error, InconclusiveError) else "ERROR"
    return {
        "refused": {"outcome": outcome, "reason": reason},
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash},
        "run": run.run, "run_key": run.key, "model": run.model, "expression": request.expression,
        "axes": [], "absent": {}, "inconclusive": {}, "golden": None, "reference": None,
        "verdict": {
            "outcome": "INCONCLUSIVE", "threshold": request.threshold, "worst": None,
            **Interval.unknown().as_columns("gap"), "reason": reason,
        },
    }  # fmt: skip
