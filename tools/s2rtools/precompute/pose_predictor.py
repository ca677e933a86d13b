"""The network of a run, for images that the store does not have."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import pose_metrics
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.inference import Backend, open_float32
from s2rtools.models.input_contract import InputContract
from s2rtools.models.load_model import load_model
from s2rtools.precompute.run_backends import RunBackends

Floats = NDArray[np.float64]


class PosePredictor:
    """Poses that the network of a run predicts, and their errors."""

    def __init__(self, store: Store, run: Run, purpose: str, trust: bool) -> None:
        """Uses the backend that computed the run, where this machine has it, else torch.

        `purpose` is what messages call the use. Raises RequestError where the run has no model, or
        one that cannot be loaded or is not trusted.
        """
        model = load_model(store, run.network(purpose), trust)
        record = store.provenance_object(f"run:{run.run}", "backend")
        self._accuracy_scale = store.dataset.accuracy_scale
        self.backend: Backend = open_float32(model)
        if record:
            chosen = RunBackends.from_record(record, f"{store.path}: run {run.run}").predictions
            if chosen.name != self.backend.name:
                self.backend = chosen.open(model, 0)

    @property
    def contract(self) -> InputContract:
        """What the inputs have to be."""
        return self.backend.model.contract

    def poses(self, inputs: Iterable[NDArray[np.float32]]) -> Floats:
        """Predicted poses (n, 3) of inputs (b, C, h, w) each: x, y in metres, heading in radians.

        They are NaN where the network gives none.
        """
        size = self.backend.batch
        made = [
            self.backend.forward_all(x[start : start + size]).pose
            for x in inputs for start in range(0, len(x), size)
        ]  # fmt: skip
        return np.concatenate([np.empty((0, 3)), *made])

    def errors(self, inputs: Iterable[NDArray[np.float32]], truth: Floats) -> Floats:
        """Position errors (n,) in metres at poses `truth` (n, 3).

        They are the accuracy scale where there is no prediction.
        """
        poses = self.poses(inputs)
        errors = pose_metrics.position_error(poses[:, 0], poses[:, 1], truth[:, 0], truth[:, 1])
        return np.where(np.isfinite(errors), errors, self._accuracy_scale)
