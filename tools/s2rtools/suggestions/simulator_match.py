"""The mismatch of sim images with real ones as the cost of a search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import Run
from s2rtools.adjustments import Chain
from s2rtools.precompute.frame_reader import Renderers
from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.held_out_split import SplitPart
from s2rtools.suggestions.image_mismatch import metric
from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.robust_fit import RobustFit
from s2rtools.suggestions.side_images import SideImages
from s2rtools.suggestions.sliders import changed_chain
from s2rtools.synthetic_world.stored_world import no_renderer_reason

_SEARCH_PIXELS = 64
"""Columns of images that are rendered for the search; the judgement takes whole frames."""


class SimulatorMatch:
    """Mismatch of the sim images under changed adjustments with the real images of the run."""

    def __init__(self, store: Store, run: Run, fit: SplitPart, judge: SplitPart) -> None:
        self._store, self._run = store, run
        channels = store.models[run.network("suggestions")].channels
        self._channels: image_mismatch.Channels = channels  # type: ignore[assignment]
        self._weights = image_mismatch.weights(self._channels)
        renderers: Renderers = {}
        rendered = no_renderer_reason(store) is None
        stride = max(1, store.dataset.frame_width // _SEARCH_PIXELS) if rendered else 1
        self._fit = _Pairs(store, run, fit.iids, renderers, self._channels, stride, rendered)
        whole = _Pairs(store, run, fit.iids, renderers, self._channels)
        self.whole = RobustFit(
            lambda values: whole.residuals(self._chain(values)), self._weights, fit.unit_blocks
        )
        """The fit on whole frames."""
        self._judge = _Pairs(store, run, judge.iids, renderers, self._channels)

    @property
    def sim_images(self) -> SideImages:
        """The sim images of the judgement."""
        return self._judge.sim

    def fitted(self, values: Values) -> Floats:
        return image_mismatch.cost(self._fit.residuals(self._chain(values)), self._weights)

    def judged(self, values: Values) -> Floats:
        return image_mismatch.cost(self._judge.residuals(self._chain(values)), self._weights)

    def _chain(self, values: Values) -> Chain:
        return changed_chain(self._store, self._run, "sim", values)


class _Pairs:
    """Sim and real images of some instances; the real ones do not change."""

    def __init__(
        self, store: Store, run: Run, iids: NDArray[np.int64], renderers: Renderers,
        channels: image_mismatch.Channels, stride: int = 1, rendered: bool = False,
    ) -> None:  # fmt: skip
        self.sim = SideImages(store, run, "sim", iids, renderers, stride, rendered)
        self._channels: image_mismatch.Channels = channels
        self._sim_domain = store.domain(run.sim_domain)
        real = SideImages(store, run, "real", iids, renderers, stride)
        domain = store.domain(run.real_domain)
        self._real = [metric(made, domain) for _, made in real.adjusted(run.real_adjustments)]

    def residuals(self, chain: Chain) -> Floats:
        """As `image_mismatch.residuals`, (n, m)."""
        parts = [
            image_mismatch.residuals(metric(made, self._sim_domain), real, self._channels)
            for (_, made), real in zip(self.sim.adjusted(chain), self._real, strict=True)
        ]
        return np.concatenate(parts)
