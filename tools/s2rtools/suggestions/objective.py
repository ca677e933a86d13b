"""Interface of what a search lowers, and the pose errors of real images as one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import pose_metrics
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rtools.adjustments import Chain
from s2rtools.inference import Backend, open_float32
from s2rtools.models.load_model import load_model
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.suggestions.held_out_split import SplitPart
from s2rtools.suggestions.side_images import SideImages
from s2rtools.suggestions.sliders import changed_chain

Floats = NDArray[np.float64]
Values = Mapping[str, float]
"""Values of sliders by name; those that are not named keep the value of the run."""


class Objective(Protocol):
    """A cost of each instance, which changes shall lower."""

    def fitted(self, values: Values) -> Floats:
        """Costs (n,) of the instances of the fit."""

    def judged(self, values: Values) -> Floats:
        """Costs (m,) of the instances of the judgement."""


class PosePredictor:
    """The network of a run, for images of one side under any chain."""

    def __init__(self, store: Store, run: Run, trust: bool) -> None:
        """Uses the backend that computed the run, where this machine has it, else torch.

        Raises RequestError where the model cannot be loaded or is not trusted.
        """
        self._store, self._run = store, run
        model = load_model(store, run.network("suggestions"), trust)
        record = store.provenance_object(f"run:{run.run}", "backend")
        self.backend: Backend = open_float32(model)
        if record:
            chosen = RunBackends.from_record(record, f"{store.path}: run {run.run}").predictions
            if chosen.name != self.backend.name:
                self.backend = chosen.open(model, 0)

    def poses(self, images: SideImages, chain: Chain) -> Floats:
        """Predicted poses (n, 3): x, y in metres, heading in radians; NaN where it fails."""
        made = np.full((images.iids.size, 3), np.nan)
        size = self.backend.batch
        for rows, x in images.inputs(chain, self.backend.model.contract):
            for start in range(0, len(x), size):
                first = rows.start + start
                batch = x[start : start + size]
                made[first : first + len(batch)] = self.backend.forward_all(batch).pose
        return made

    def errors(self, images: SideImages, chain: Chain) -> Floats:
        """Position errors (n,) in metres; the accuracy scale where there is no prediction."""
        poses = self.poses(images, chain)
        truth = self._store.poses(self._run.domain(images.side))[images.iids]
        errors = pose_metrics.position_error(poses[:, 0], poses[:, 1], truth[:, 0], truth[:, 1])
        return np.where(np.isfinite(errors), errors, self._store.dataset.accuracy_scale)


class PoseErrors:
    """Position errors in metres of a run's model on changed images of one side."""

    def __init__(
        self,
        store: Store,
        run: Run,
        side: Side,
        predictor: PosePredictor,
        fit: SplitPart,
        judge: SplitPart,
    ) -> None:
        self._store, self._run, self._side, self._predictor = store, run, side, predictor
        self._fit = SideImages(store, run, side, fit.iids)
        self._judge = SideImages(store, run, side, judge.iids)

    def fitted(self, values: Values) -> Floats:
        return self._errors(self._fit, values)

    def judged(self, values: Values) -> Floats:
        return self._errors(self._judge, values)

    def _errors(self, images: SideImages, values: Values) -> Floats:
        chain = changed_chain(self._store, self._run, self._side, values)
        return self._predictor.errors(images, chain)
