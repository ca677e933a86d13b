"""Interface of what a search lowers, and the pose errors of real images as one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rtools.precompute.pose_predictor import PosePredictor
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
        return self._predictor.errors(images.inputs(chain, self._predictor.contract), images.truth)
