"""Choose the topics of a bag from which a recording is read, and its camera from CameraInfo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import POSES, BagMessages
from s2rtools.datasets.bags.image_messages import COMPRESSED, IMAGE, declared
from s2rtools.datasets.recording import PinholeCamera, ReadOptions

INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_READ = frozenset((IMAGE, COMPRESSED, INFO, *POSES, *TRANSFORMS))
TF = "tf"
"""Value of the option `pose` for the transforms of the bag."""
NONE = "none"
_STATIC = "tf_static"
_FISHEYES = ("equidistant", "fisheye")
_PINHOLES = ("", "plumb_bob", "rational_polynomial", "none")


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of a recording; `pose` is `TF` for transforms, `info` None without CameraInfo."""

    rgb: str
    depth: str | None
    pose: str
    info: str | None
    depth_info: str | None
    transforms: tuple[str, ...]

    @property
    def all(self) -> set[str]:
        one = {self.rgb, self.depth, self.info, self.depth_info, *self.transforms}
        return {topic for topic in one | {self.pose} if topic is not None and topic != TF}


def choose_topics(bag: BagMessages, options: ReadOptions) -> Topics:
    """Choose topics by their types and encodings, or by the options.

    Raises RequestError, which lists the topics, where there is none or more than one, and where a
    topic is listed with several types.
    """
    for topic, kinds in bag.repeated.items():
        if not _READ.isdisjoint(kinds):
            listed = ", ".join(kinds)
            raise RequestError(f"{bag.path}: topic {topic} is listed with types {listed}; keep one")
    images = {topic: kind for topic, kind in bag.types.items() if kind in (IMAGE, COMPRESSED)}
    depths = [topic for topic in images if declared(bag.first(topic)).is_depth]
    colours = [topic for topic in images if topic not in depths]
    rgb = _one(bag, options, "rgb", colours, "RGB images", images)
    assert rgb is not None
    depth = _one(bag, options, "depth", depths, "depth images", images, may_lack=True)
    infos = [topic for topic, kind in bag.types.items() if kind == INFO]
    info = None
    if "camera" not in options.values:
        beside = _info_beside(rgb, infos)
        known = infos if "info" in options.values or beside is None else [beside]
        info = _one(bag, options, "info", known, "CameraInfo", infos)
    depth_info = None if depth is None else _info_beside(depth, infos)
    transforms = tuple(topic for topic, kind in bag.types.items() if kind in TRANSFORMS)
    moving = [topic for topic in transforms if not is_static(topic)]
    poses = [topic for topic, kind in bag.types.items() if kind in POSES]
    candidates = [*poses, *([TF] if moving else [])]
    pose = _one(bag, options, "pose", candidates, "poses", candidates)
    assert pose is not None
    return Topics(rgb, depth, pose, info, None if depth_info == info else depth_info, transforms)


def is_static(topic: str) -> bool:
    return topic.rsplit("/", 1)[-1] == _STATIC


def camera_of(message: Any, where: str, is_rectified: bool) -> PinholeCamera:
    """The camera that a CameraInfo states, for images as they are recorded.

    ROS places the centre of pixel i at i; it is moved to i + 0.5. Binning and the region of
    interest are applied. Rectified images have the projection P and no distortion, others K and D.
    Raises RequestError, beginning with `where`, for an uncalibrated camera or an unknown model.
    """
    k, p, d = (_field(message, name) for name in "kpd")
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if is_rectified else (k[0], k[4], k[2], k[5])
    if not fx > 0:
        raise RequestError(f"{where}: the camera is not calibrated; set camera=fx,fy,cx,cy")
    model = message.distortion_model
    distortion = () if is_rectified or not any(d) else tuple(d)
    if distortion and model not in _PINHOLES + _FISHEYES:
        raise RequestError(f"{where}: distortion model {model[:40]!r} is not read; rectify images")
    is_fisheye = model in _FISHEYES and not is_rectified
    if is_fisheye and not distortion:
        distortion = (0.0, 0.0, 0.0, 0.0)
    roi = message.roi
    columns, rows = max(1, int(message.binning_x)), max(1, int(message.binning_y))
    camera = PinholeCamera(
        int(roi.width or message.width) // columns,
        int(roi.height or message.height) // rows,
        fx / columns,
        fy / rows,
        (cx + 0.5 - roi.x_offset) / columns,
        (cy + 0.5 - roi.y_offset) / rows,
        distortion,
        is_fisheye,
    )
    return camera.checked(where)


def _one(
    bag: BagMessages,
    options: ReadOptions,
    name: str,
    candidates: Sequence[str],
    what: str,
    known: Sequence[str] | dict[str, str],
    may_lack: bool = False,
) -> str | None:
    """The only candidate, or the one of `known` that the option names."""
    chosen = options.values.get(name)
    if chosen is not None:
        if may_lack and chosen == NONE:
            return None
        if chosen not in known:
            names = ", ".join(sorted(known)) or "none"
            raise RequestError(f"{bag.path}: no {what} on {name}={chosen} (has: {names})")
        return chosen
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        if may_lack:
            return None
        remedy = "; set camera=fx,fy,cx,cy" if name == "info" else ""
        raise RequestError(f"{bag.path}: no topic with {what}{remedy}")
    names = ", ".join(sorted(candidates))
    raise RequestError(f"{bag.path}: several topics with {what}; choose one of {names} ({name}=)")


def _info_beside(images: str, infos: Sequence[str]) -> str | None:
    """The CameraInfo of an image topic: that in its namespace, or above that of a transport."""
    parts = images.split("/")
    for count in (1, 2):
        topic = "/".join([*parts[:-count], "camera_info"])
        if topic in infos:
            return topic
    return None


def _field(message: Any, name: str) -> list[float]:
    """A field that ROS 1 names in capitals and ROS 2 in small letters."""
    values = getattr(message, name, None)
    return [float(v) for v in (getattr(message, name.upper()) if values is None else values)]
