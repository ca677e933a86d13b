"""A stand-in for `umap` that compiles nothing: two components, standardised by the fit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class UMAP:
    """The part of `umap.UMAP` that a projection uses; all settings are ignored."""

    def __init__(self, **settings: Any) -> None: ...

    def fit_transform(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        self._centre = points.mean(axis=0)
        self._spread = points.std() or 1.0
        return self.transform(points)

    def transform(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        return ((points - self._centre) / self._spread)[:, :2].astype(np.float32)
