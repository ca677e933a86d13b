"""What a run shows about its errors: new instances, and real images that it was trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError, RequestError
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SPLITS
from s2rtools.data_collection.pose_similarity import Codes, Floats, Poses

_HARM_KIND, _HARM_PLANE = "harm", "position"
_HARM_ROWS = 256


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Errors of the k instances that are new to a run, and the r real images it was trained on.

    `iids`, `rooms`, `real_error`, `sim_error` (metres) and `novelty` are (k,), `poses` (k, 3) those
    of the real images. `novelty` is the outlier score of the real image, 1 for the median. `harm`
    (k,) in metres is None where the store has no heatmaps of it. `trained_poses` (r, 3) and
    `trained_rooms` (r,) belong to training images of the real domain.
    """

    iids: NDArray[np.intp]
    poses: Poses
    rooms: Codes
    real_error: Floats
    sim_error: Floats
    novelty: Floats
    harm: Floats | None
    trained_poses: Poses
    trained_rooms: Codes

    def __len__(self) -> int:
        return len(self.iids)


def read_evidence(store: Store, run: str) -> Evidence:
    """The evidence of a computed run.

    Instances that the model was trained on, on either side, tell nothing about its errors and are
    left out. Raises RequestError where no instance is new to the run.
    """
    columns, truth = store.run_columns(run), store.instances
    poses = store.poses(store.run(run).real_domain)
    known = np.isfinite(poses).all(axis=1)
    new = run_metrics.population(store, run) & known & np.isfinite(columns.real.error)
    if not new.any():
        raise RequestError(
            f"run {run}: trained on all instances, so no real error is known; "
            "ingest images that are new to it"
        )
    trained = known & (columns.real.split == SPLITS.index("train"))
    novelty = columns.real.outlier[new]
    return Evidence(
        iids=np.flatnonzero(new),
        poses=poses[new],
        rooms=truth.room[new],
        real_error=columns.real.error[new],
        sim_error=columns.sim.error[new],
        novelty=np.where(np.isfinite(novelty), novelty, 1.0),
        harm=_harm(store, run, np.flatnonzero(new)),
        trained_poses=poses[trained],
        trained_rooms=truth.room[trained],
    )


def _harm(store: Store, run: str, iids: NDArray[np.intp]) -> Floats | None:
    """The sum of the positive harm in each real image (k,), metres; None where it is unknown.

    `iids` (k,) ascend; only blocks of instances that hold one of them are read.
    """
    if not any(record.kind == _HARM_KIND for record in store.array_kinds(run)):
        return None
    parts = []
    try:
        for start in np.unique(iids // _HARM_ROWS) * _HARM_ROWS:
            chosen = iids[(iids >= start) & (iids < start + _HARM_ROWS)]
            first, stop = int(chosen[0]), int(chosen[-1]) + 1
            heat = store.heatmaps(run, _HARM_KIND, "real", first, stop, _HARM_PLANE)
            heat = np.maximum(heat[chosen - first], 0.0)
            parts.append(np.nansum(heat, axis=(1, 2), dtype=np.float64))
    except NotComputedError:
        return None
    return np.concatenate(parts)
