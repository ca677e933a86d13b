"""Which instances an axis looks at."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rtools.gap.axis_result import Evidence

Iids = NDArray[np.int64]


def selected(evidence: Evidence) -> Iids:
    """The selected iids, ascending and once each. Raises RequestError where one does not exist."""
    iids = np.unique(np.asarray(evidence.iids, dtype=np.int64))
    count = len(evidence.store.instances)
    if iids.size and not 0 <= iids[0] <= iids[-1] < count:
        raise RequestError(f"--select {evidence.expression}: the store holds iids 0 .. {count - 1}")
    return iids


def held_out(evidence: Evidence) -> Iids:
    """Those of the selected that both sides predicted and the model was not trained on."""
    iids = selected(evidence)
    return iids[run_metrics.held_out(evidence.store, evidence.run)[iids]]


def poses(store: Store) -> str:
    """SHA-256 of what the iids mean: equal for other images and other models of the same poses."""
    truth = store.instances
    digest = hashlib.sha256("\n".join(truth.trajectory_names).encode())
    for column in (truth.trajectory, truth.seq, truth.x, truth.y, truth.heading):
        digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def uncomputed(evidence: Evidence) -> str | None:
    """Why a run has no figures yet; None where it has. Raises RequestError for an unknown run."""
    if evidence.store.run(evidence.run).key is None:
        return f"run {evidence.run!r} is not computed yet; run `s2r precompute`"
    return None
