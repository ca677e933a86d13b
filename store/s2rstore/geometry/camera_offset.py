"""A rig that is mounted or zoomed otherwise than its domain declares, and the lights around it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.records import Domain, Intrinsics

HEIGHT, PITCH, FOV = "camera_height", "camera_pitch", "camera_fov"
"""Names of the adjustments that move a camera: metres up, degrees up, degrees wider."""
LAMPS, WINDOWS = "lamp_power", "window_power"
"""Names of the adjustments of the light of lamps and of windows: factors."""
NAMES = (LAMPS, WINDOWS, HEIGHT, PITCH, FOV)
_NEUTRAL = {LAMPS: 1.0, WINDOWS: 1.0}
_LEAST_HEIGHT = 0.02
_FOVS = (5.0, 160.0)
_MOST_PITCH = 80.0


@dataclass(frozen=True, slots=True)
class RigOffset:
    """Offset of both cameras of a rig: metres up, a factor of the focal lengths, radians up."""

    height: float = 0.0
    zoom: float = 1.0
    pitch: float = 0.0

    def applied(self, domain: Domain) -> Domain:
        """The domain with its cameras moved; the same object where nothing moves."""
        if (self.height, self.zoom, self.pitch) == (0.0, 1.0, 0.0):
            return domain
        rgb, depth = (
            replace(
                lens, fx=lens.fx * self.zoom, fy=lens.fy * self.zoom, pitch=lens.pitch + self.pitch
            )
            for lens in (domain.rgb, domain.depth)
        )
        height = domain.camera_height + self.height
        return replace(domain, rgb=rgb, depth=depth, camera_height=height)


@dataclass(frozen=True, slots=True)
class RenderChange(RigOffset):
    """What a renderer renders otherwise than the domain declares: the rig, and the lights.

    `lamps` and `windows` are factors of their light.
    """

    lamps: float = 1.0
    windows: float = 1.0


UNCHANGED = RenderChange()


def hfov(lens: Intrinsics, width: int) -> float:
    """Horizontal field of view in degrees of a lens over frames of `width` pixels."""
    return 2 * math.degrees(math.atan(width / 2 / lens.fx))


def render_change(chain: Sequence[Mapping[str, Any]], domain: Domain, width: int) -> RenderChange:
    """What a chain of adjustments changes in rendering a domain; `width` of its stored frames.

    Steps of one name add up, factors multiply; other adjustments are ignored. The field of view is
    that of the domain's RGB camera; both focal lengths follow. Raises RequestError for a camera
    that sinks into the floor, looks straight up or down or sees no sensible field of view.
    """
    total = dict.fromkeys((HEIGHT, PITCH, FOV), 0.0)
    light = dict(_NEUTRAL)
    for step in chain:
        if step["name"] in total:
            total[str(step["name"])] += float(step["value"])
        elif step["name"] in light:
            light[str(step["name"])] *= float(step["value"])
    zoom, now = 1.0, hfov(domain.rgb, width)
    target = now + total[FOV]
    if total[FOV]:
        if not _FOVS[0] <= target <= _FOVS[1]:
            span = f"{_FOVS[0] - now:+.0f} .. {_FOVS[1] - now:+.0f}"
            raise RequestError(
                f"{FOV}={total[FOV]:g}: domain {domain.domain} allows {span} degrees"
            )
        zoom = math.tan(math.radians(now) / 2) / math.tan(math.radians(target) / 2)
    if total[HEIGHT] and domain.camera_height + total[HEIGHT] < _LEAST_HEIGHT:
        raise RequestError(
            f"{HEIGHT}={total[HEIGHT]:g}: the camera of domain {domain.domain} is only "
            f"{domain.camera_height:.2f} m above the floor"
        )
    if total[PITCH] and abs(math.degrees(domain.rgb.pitch) + total[PITCH]) > _MOST_PITCH:
        raise RequestError(f"{PITCH}={total[PITCH]:g}: at most {_MOST_PITCH:g} degrees up or down")
    pitch = math.radians(total[PITCH])
    return RenderChange(total[HEIGHT], zoom, pitch, light[LAMPS], light[WINDOWS])
