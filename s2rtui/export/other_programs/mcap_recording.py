"""A recording in the container MCAP, with the messages that Foxglove shows, as JSON.

Source: https://mcap.dev/spec and https://docs.foxglove.dev/docs/visualization/message-schemas.
"""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer

from s2rstore.records import SIDES, Domain, Side
from s2rtui.export.other_programs.content import ExportContent, ExportedFrame, png_bytes

_MAP = "map"
_NANO = 1_000_000_000
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_VECTOR = {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}
_TURN = {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyzw"}}
_POSE = {"type": "object", "properties": {"position": _VECTOR, "orientation": _TURN}}
_BYTES = {"type": "string", "contentEncoding": "base64"}
_NUMBERS = {"type": "array", "items": {"type": "number"}}
_TEXT, _NUMBER = {"type": "string"}, {"type": "number"}
_SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.CompressedImage": {"data": _BYTES, "format": _TEXT},
    "foxglove.RawImage": {"width": _NUMBER, "height": _NUMBER, "encoding": _TEXT, "step": _NUMBER,
                          "data": _BYTES},
    "foxglove.CameraCalibration": {"width": _NUMBER, "height": _NUMBER, "K": _NUMBERS,
                                   "P": _NUMBERS},
    "foxglove.FrameTransform": {"parent_frame_id": _TEXT, "child_frame_id": _TEXT,
                                "translation": _VECTOR, "rotation": _TURN},
    "foxglove.PoseInFrame": {"pose": _POSE},
    "foxglove.PosesInFrame": {"poses": {"type": "array", "items": _POSE}},
    "s2rtui.Errors": {"iid": _NUMBER, "sim_error_m": _NUMBER, "real_error_m": _NUMBER},
}  # fmt: skip
"""Properties of each kind of message beside `timestamp` and `frame_id`."""


class _Messages:
    """Writes messages as JSON, each to the channel of its topic, which is made at its first."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def write(self, topic: str, kind: str, seconds: float, frame: str, **values: Any) -> None:
        stamp = round(seconds * _NANO)
        time = {"sec": stamp // _NANO, "nsec": stamp % _NANO}
        message = {"timestamp": time, "frame_id": frame, **values}
        self._writer.add_message(
            self._channel(topic, kind), stamp, json.dumps(message).encode(), stamp
        )

    def _channel(self, topic: str, kind: str) -> int:
        if kind not in self._schemas:
            properties = {"timestamp": _TIME, "frame_id": _TEXT, **_SCHEMAS[kind]}
            schema = {"title": kind, "type": "object", "properties": properties}
            self._schemas[kind] = self._writer.register_schema(
                kind, "jsonschema", json.dumps(schema).encode()
            )
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(
                topic, "json", self._schemas[kind]
            )
        return self._channels[topic]


def write(content: ExportContent, path: Path) -> None:
    """Write topics `/SIDE/rgb`, `/depth`, `/heat`, `/calibration`, `/predicted`, `/truth`, `/tf`.

    Positions are metres in frame `map`, whose z points upwards; `/SIDE/camera` is that of the
    camera. Depth is in millimetres, 0 where it is unknown.
    """
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        messages = _Messages(writer)
        _poses(messages, content)
        for side, domain in content.domains.items():
            for frame in content.frames(side):
                _frame(messages, content, side, domain, frame)
        writer.finish()


def _poses(messages: _Messages, content: ExportContent) -> None:
    truth = content.store.instances
    poses = content.in_space(np.stack([truth.x, truth.y, truth.heading], axis=1))
    for name, iids in content.trajectories():
        line = [_pose(pose) for pose in poses[iids].tolist()]
        messages.write(f"/trajectories/{name}", "foxglove.PosesInFrame",
                       float(content.times[iids[0]]), _MAP, poses=line)  # fmt: skip
    predicted = {side: content.in_space(content.predicted(side)) for side in SIDES}
    errors = {side: content.errors(side) for side in SIDES}
    for iid in content.iids.tolist():
        seconds = float(content.times[iid])
        messages.write("/truth", "foxglove.PoseInFrame", seconds, _MAP, pose=_pose(poses[iid]))
        for side in SIDES:
            if np.isfinite(predicted[side][iid]).all():
                messages.write(f"/{side}/predicted", "foxglove.PoseInFrame", seconds, _MAP,
                               pose=_pose(predicted[side][iid]))  # fmt: skip
        known = {f"{side}_error_m": float(errors[side][iid]) for side in SIDES
                 if math.isfinite(errors[side][iid])}  # fmt: skip
        messages.write("/errors", "s2rtui.Errors", seconds, _MAP, iid=iid, **known)


def _pose(pose: Any) -> dict[str, Any]:
    x, y, heading = map(float, pose)
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    return {"position": {"x": x, "y": y, "z": 0.0}, "orientation": turn}


def _frame(
    messages: _Messages, content: ExportContent, side: Side, domain: Domain, frame: ExportedFrame
) -> None:
    seconds, name = float(content.times[frame.iid]), f"/{side}/camera"
    pose = content.in_space(content.store.poses(domain.domain)[frame.iid][None])[0]
    position, turn = content.camera(domain, pose)
    messages.write(
        "/tf", "foxglove.FrameTransform", seconds, name, parent_frame_id=_MAP, child_frame_id=name,
        translation=dict(zip("xyz", position.tolist(), strict=True)),
        rotation=dict(zip("xyzw", turn.tolist(), strict=True)),
    )  # fmt: skip
    height, width = frame.rgb.shape[:2]
    lens = domain.rgb
    matrix = [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]
    messages.write(
        f"/{side}/calibration", "foxglove.CameraCalibration", seconds, name, width=width,
        height=height, K=matrix, P=[*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
    )  # fmt: skip
    for topic, image in (("rgb", frame.rgb), ("heat", frame.heat)):
        if image is not None:
            data = base64.b64encode(png_bytes(image)).decode()
            messages.write(f"/{side}/{topic}", "foxglove.CompressedImage", seconds, name,
                           data=data, format="png")  # fmt: skip
    if frame.depth is not None:
        is_valid = (frame.depth >= domain.depth_raw_min) & (frame.depth <= domain.depth_raw_max)
        metres = np.where(is_valid, frame.depth * domain.depth_scale, 0.0)
        millimetres = np.clip(np.rint(1000 * metres), 0, 65_535).astype("<u2")
        messages.write(
            f"/{side}/depth", "foxglove.RawImage", seconds, name, width=width, height=height,
            encoding="16UC1", step=2 * width,
            data=base64.b64encode(millimetres.tobytes()).decode(),
        )  # fmt: skip
