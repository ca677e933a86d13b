"""What a night computes: the gap's report and the simulator's parameters. Imported lazily."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import InconclusiveError
from s2rstore.reader import Store
from s2rtools.nightly.config import NightlyConfig, SysidConfig

if TYPE_CHECKING:
    from s2rtools.sysid import Identification
from s2rstore.errors import S2RError
from s2rtools.nightly.input_fingerprint import Inputs

Report = dict[str, Any]
Estimates = Sequence[Mapping[str, Any]]
"""Per parameter `parameter`, `value`, `value_low`, `value_high`, `unit` and, maybe, `note`."""
Measuring = Callable[[Store, NightlyConfig], Report]
Estimating = Callable[[SysidConfig], Estimates]


def measured(store: Store, config: NightlyConfig) -> Report:
    """The report of `s2r gap` for this configuration."""
    from s2rtools.gap.axis_result import GapSettings
    from s2rtools.gap.gate import gate

    request = gate.GapRequest(
        run=config.run,
        expression=config.select,
        axes=config.axes,
        drives=config.drives,
        rate=config.rate,
        topic=config.topic,
        dynamics=config.dynamics,
        features=config.features,
        reference=config.reference,
        golden=config.golden,
        threshold=config.threshold,
        margin=config.margin,
        settings=GapSettings(config.replicates, config.seed),
    )
    return gate.measured_report(gate.collect_evidence(store, request), request)


def estimated(sysid: SysidConfig) -> Estimates:
    """What `s2r sysid` finds; where the drives are too few, one row that says so."""
    from s2rtools.motion_logs.drives import read_drives
    from s2rtools.sysid import identify

    drives = read_drives(Path(sysid.drives), sysid.topic)
    try:
        return estimates(identify(drives, sysid.settings(), _Silent()))
    except InconclusiveError as error:
        return [{"parameter": sysid.simulator, "note": f"not identified: {error}"}]


def estimates(found: Identification) -> Estimates:
    """A row per parameter, and one for the simulator with all warnings where there are some."""
    notes = dict.fromkeys(found.unsettled, "the search has not settled")
    notes |= dict.fromkeys(found.identifiability.open_names, "not determined by these drives")
    notes |= dict.fromkeys(found.at_ends, "at the end of its range")
    rows: list[Mapping[str, Any]] = [
        {
            "parameter": one.name, "value": one.value, "value_low": one.low,
            "value_high": one.high, "unit": one.unit, "note": notes.get(one.name),
        }
        for one in found.estimates
    ]  # fmt: skip
    if found.warnings:
        rows.append({"parameter": found.space.simulator.name, "note": "; ".join(found.warnings)})
    return rows


class _Silent:
    """Tells nobody how far it is."""

    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


def refused(store: Store, config: NightlyConfig, inputs: Inputs, error: S2RError) -> Report:
    """No axis and no figure; `refused` tells the outcome and the reason.

    Too little evidence is INCONCLUSIVE; a request that does not fit what is there is an ERROR.
    """
    run, reason = store.run(inputs.run), " ".join(str(error).split())
    outcome = "INCONCLUSIVE" if isinstance(error, InconclusiveError) else "ERROR"
    return {
        "refused": {"outcome": outcome, "reason": reason},
        "dataset": {"name": store.dataset.name, "hash": store.dataset.hash},
        "run": run.run, "run_key": run.key, "model": run.model, "expression": config.select,
        "axes": [], "absent": {}, "inconclusive": {}, "golden": None, "reference": None,
        "verdict": {
            "outcome": "INCONCLUSIVE", "threshold": config.threshold, "worst": None, "gap": None,
            "gap_low": None, "gap_high": None, "reason": reason,
        },
    }  # fmt: skip
