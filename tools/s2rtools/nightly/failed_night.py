"""The report of a night on which nothing could be measured."""

from __future__ import annotations

from s2rstore.errors import InconclusiveError, S2RError
from s2rstore.reader import Store
from s2rtools.nightly.config import Config
from s2rtools.nightly.input_fingerprint import Inputs
from s2rtools.nightly.measurement import Report


def refused(store: Store, config: Config, inputs: Inputs, error: S2RError) -> Report:
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
