"""The mismatch of a renderer program's frames with the real images at their poses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.lru_cache import LruCache
from s2rstore.reader import Store
from s2rtools.adjustments import ADJUSTMENTS, ImageAdjustment, make_chain
from s2rtools.precompute.frame_reader import FrameImages, adjusted_images
from s2rtools.renderer.protocol import Parameter
from s2rtools.simulated_frames.pose_renderer import PoseRenderer
from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.sliders import NEVER, Slider, slider_of

PARAMETER = "parameter"
"""The factor of the sliders that are parameters of a renderer."""
_DIGITS = 4
"""Digits to which a parameter is told, relative to its range."""
_CACHE_BYTES = 256 << 20
_LEAST_NOISE = 0.005
"""Relative noise of depth below which sides count as equal: resampled images have as much."""


def parameter_slider(parameter: Parameter) -> Slider:
    """A declared parameter as a slider whose value is the default."""
    low, high = parameter.minimum, parameter.maximum
    digits = max(0, _DIGITS - int(np.floor(np.log10(high - low))))
    return Slider(parameter.name, PARAMETER, parameter.unit, parameter.default, low, high, digits)


def adjustment_sliders(channels: image_mismatch.Channels, taken: set[str]) -> list[Slider]:
    """The image adjustments of frames with some channels, without names that are `taken`."""
    return [
        slider_of(each, each.neutral)
        for each in ADJUSTMENTS.values()
        if isinstance(each, ImageAdjustment) and "sim" in each.sides and each.changes(channels)
        and each.name not in NEVER and each.name not in taken
    ]  # fmt: skip


class RenderedFrames:
    """The frames of a program at the poses of real images, compared with these.

    Values name parameters of the program and image adjustments; a parameter that is not named has
    its default.
    """

    def __init__(
        self, store: Store, domain: str, renderer: PoseRenderer, iids: NDArray[np.int64]
    ) -> None:
        """`domain` is that of the real images."""
        self._store, self._renderer = store, renderer
        self._poses = store.poses(domain)[iids]
        self._real_domain, self._domain = store.domain(domain), renderer.cameras.domain
        self._defaults = {each.name: each.default for each in renderer.ready.parameters}
        has_depth = renderer.folder.has_depth and self._real_domain.has_depth
        self.channels: image_mismatch.Channels = "rgbd" if has_depth else "rgb"
        parts = [store.frames(domain, iid, iid + 1) for iid in iids.tolist()]
        real = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        self._real = image_mismatch.metric(adjusted_images(real, self._real_domain, (), store.path),
                                           self._real_domain)  # fmt: skip
        self._cache = LruCache(_CACHE_BYTES, lambda images: sum(x.nbytes for x in images.values()))
        self.compared = 0
        """Number of frames that were rendered or read from the folder."""

    def residuals(self, values: Values) -> Floats:
        """As `image_mismatch.residuals`, (n, m).

        Raises RequestError where a frame cannot be rendered.
        """
        parameters = {name: values.get(name, start) for name, start in self._defaults.items()}
        chain = make_chain("sim", {k: v for k, v in values.items() if k not in parameters})
        key = tuple(sorted(parameters.items()))
        images = self._cache.get(key, partial(self._frames, parameters))
        adjusted = adjusted_images(images, self._domain, chain, self._store.path)
        sim = image_mismatch.metric(adjusted, self._domain)
        return image_mismatch.residuals(sim, self._real, self.channels, _LEAST_NOISE)

    def _frames(self, parameters: Mapping[str, float]) -> FrameImages:
        values = [parameters] * len(self._poses)
        failures = self._renderer.render(self._poses, values)
        if failures:
            row, reason = min(failures.items())
            x, y, heading = self._poses[row].tolist()
            where = f"x {x:.2f} m, y {y:.2f} m, heading {np.degrees(heading):.0f} degrees"
            raise RequestError(f"the renderer cannot render {where}: {reason}")
        self.compared += len(values)
        return self._renderer.images(self._poses, values)
