"""What a night computes: the gap's report and the simulator's parameters. Imported lazily."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from s2rstore.errors import InconclusiveError
from s2rstore.reader import Store
from s2rtools.nightly.config import Config, Sysid

Report = dict[str, Any]
Estimates = Sequence[Mapping[str, Any]]
"""Per parameter `parameter`, `value`, `value_low`, `value_high`, `unit` and, maybe, `note`."""
Measuring = Callable[[Store, Config], Report]
Estimating = Callable[[Sysid], Estimates]


def measured(store: Store, config: Config) -> Report:
    """The report of `s2r gap` for this configuration."""
    from s2rtools.gap import gate
    from s2rtools.gap.contract import Settings

    request = gate.Request(
        run=config.run,
        expression=config.select,
        axes=config.axes,
        drives=config.drives,
        rate=config.rate,
        features=config.features,
        reference=config.reference,
        golden=config.golden,
        threshold=config.threshold,
        margin=config.margin,
        settings=Settings(config.replicates, config.seed),
    )
    return gate.measured_report(gate.evidence(store, request), request)


def estimated(sysid: Sysid) -> Estimates:
    """What `s2r sysid` finds; where the drives are too few, one row that says so."""
    from s2rtools.logs.drives import read_drives
    from s2rtools.sysid import Settings, identify

    settings = Settings(
        sysid.simulator, sysid.parameters, sysid.fixed, sysid.seeds, seed=sysid.seed,
        evaluations=sysid.evaluations,
    )  # fmt: skip
    try:
        found = identify(read_drives(Path(sysid.drives)), settings, _Silent())
    except InconclusiveError as error:
        return [{"parameter": sysid.simulator, "note": f"not identified: {error}"}]
    return [
        {
            "parameter": one.name, "value": one.value, "value_low": one.low,
            "value_high": one.high, "unit": one.unit,
            "note": "not determined by these drives" if one.open else None,
        }
        for one in found.estimates
    ]  # fmt: skip


class _Silent:
    """Tells nobody how far it is."""

    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...
