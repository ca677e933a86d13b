"""The camera of a recording whose files state one for each image, or several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import PinholeCamera

CAMERA_ID = "camera_id"
"""Name of the option."""
MEDIAN = "median"
"""Value of the option `camera_id` for the median of all cameras, which must have one image size."""
_MOST_NAMED = 8
"""Cameras that a message lists."""


def choose_camera(
    cameras: Mapping[str, PinholeCamera], images: Sequence[str], option: str | None, where: Path
) -> tuple[PinholeCamera, frozenset[str], str]:
    """The camera of a recording, the names of those whose images it stands for, and a remark.

    `images` names the camera of each image. The option names one camera, or is `MEDIAN`: then the
    remark states how far a camera is from the median. By default all cameras must be equal. Raises
    RequestError, which lists the cameras, if there are several or the option names none.
    """
    present = frozenset(images)
    used = {name: camera for name, camera in cameras.items() if name in present}
    if option is not None and option != MEDIAN:
        if option not in used:
            raise RequestError(f"{where}: no images of camera {option!r} ({_listed(used, images)})")
        return used[option], frozenset((option,)), ""
    first = next(iter(used.values()))
    if all(camera == first for camera in used.values()):
        return first, frozenset(used), ""
    kinds = {
        (each.width, each.height, each.is_fisheye, len(each.distortion)) for each in used.values()
    }
    if option is None or len(kinds) > 1:
        advice = "choose one with option camera_id=NAME"
        if len(kinds) == 1:
            advice += f", or their median with camera_id={MEDIAN}"
        raise RequestError(f"{where}: {len(used)} cameras ({_listed(used, images)}); {advice}")
    values = np.array([(*astuple(each)[2:6], *each.distortion) for each in used.values()])
    fx, fy, cx, cy, *distortion = np.median(values, axis=0).tolist()
    camera = PinholeCamera(
        first.width, first.height, fx, fy, cx, cy, tuple(distortion), first.is_fisheye
    )
    spread = np.abs(values - np.median(values, axis=0)).max(axis=0)
    focal, centre = spread[:2].max(), spread[2:4].max()
    remark = f"median of {len(used)} cameras; focal lengths differ by at most {focal:.2f} pixels, "
    return camera, frozenset(used), remark + f"centres by {centre:.2f}"


def _listed(cameras: Mapping[str, PinholeCamera], images: Sequence[str]) -> str:
    texts = [
        f"{name}: {camera.width}x{camera.height}, fx {camera.fx:.1f}, {images.count(name)} images"
        for name, camera in list(cameras.items())[:_MOST_NAMED]
    ]
    more = len(cameras) - len(texts)
    return "; ".join(texts) + (f"; and {more} more" if more else "")
