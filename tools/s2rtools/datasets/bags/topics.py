"""Choose the topics of a bag from which a recording is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rtools.common.bag_messages import POSES, BagMessages
from s2rtools.datasets.bags.camera_info import INFO
from s2rtools.datasets.bags.image_messages import COMPRESSED, IMAGE, declared
from s2rtools.datasets.recording import ReadOptions

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_READ = frozenset((IMAGE, COMPRESSED, INFO, *POSES, *TRANSFORMS))
TF = "tf"
"""Value of the option `pose` for the transforms of the bag."""
NONE = "none"
_STATIC = "tf_static"


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
