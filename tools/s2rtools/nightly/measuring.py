"""What a night computes: the gap's report and the simulator's parameters. Imported lazily."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.nightly.config import Config, Sysid

Report = dict[str, Any]
Estimates = Sequence[Mapping[str, Any]]
"""Per parameter `parameter`, `value`, `value_low`, `value_high`, `unit` and, maybe, `note`."""
Measuring = Callable[[Store, Config], Report]
Estimating = Callable[[Sysid, Store], Estimates]


def measured(store: Store, config: Config) -> Report:
    """The report of `s2r gap` for this configuration."""
    from s2rtools.gap import gate
    from s2rtools.gap.contract import Settings

    request = gate.Request(
        run=config.run,
        expression=config.select,
        axes=config.axes,
        drives=config.drives,
        features=config.features,
        reference=config.reference,
        golden=config.golden,
        threshold=config.threshold,
        margin=config.margin,
        settings=Settings(config.replicates, config.seed),
    )
    return gate.measured_report(gate.evidence(store, request), request)


def estimated(sysid: Sysid, store: Store) -> Estimates:
    """What `s2r sysid` finds; raises RequestError where it is not installed."""
    try:
        found = importlib.import_module("s2rtools.sysid.nightly")
    except ModuleNotFoundError as error:
        raise RequestError(f"[sysid]: needs {error.name}, which is not installed") from error
    estimates: Estimates = found.estimates(
        sysid.simulator, sysid.parameters, sysid.drives, sysid.seed, store
    )
    return estimates
