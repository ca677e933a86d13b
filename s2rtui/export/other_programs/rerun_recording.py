"""A recording for the viewer Rerun: images, depth, heat, poses, predictions and the floor plan.

Source: https://rerun.io/docs/reference/types, version 0.23 and newer.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from s2rstore.errors import RequestError, first_line
from s2rstore.records import SIDES, Domain, Intrinsics, Side
from s2rtui.canvas import LIGHT
from s2rtui.export.other_programs.content import ExportContent, ExportedFrame, png_bytes
from s2rtui.loaders.store_data import floor_plan_pixels

_INSTANCE, _TIME = "instance", "time"
_ABOVE = 0.02
"""Metres of lines above the floor."""


def write(content: ExportContent, path: Path) -> None:
    """Write the recording; its timelines are the number of the instance and seconds.

    `floor`, `truth/TRAJECTORY` and `predicted/SIDE` do not change. `SIDE/camera` has the image,
    depth in metres and heat of an instance, `SIDE/error` its error in metres.
    """
    store = content.store
    with rr.RecordingStream("s2rtui") as recording:
        try:
            recording.save(path)
        except RuntimeError as error:
            raise RequestError(f"--out {path}: cannot be written ({first_line(error)})") from error
        recording.send_recording_name(f"{store.dataset.name} {content.run}".strip())
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _floor(recording, content)
        _lines(recording, content)
        for side, domain in content.domains.items():
            camera = f"{side}/camera"
            height, width = store.dataset.frame_height, store.dataset.frame_width
            recording.log(f"{camera}/rgb", _pinhole(domain.rgb, width, height), static=True)
            if domain.has_depth:
                recording.log(f"{camera}/depth", _pinhole(domain.depth, width, height), static=True)
            for frame in content.frames(side):
                _frame(recording, content, side, domain, frame)


def _floor(recording: rr.RecordingStream, content: ExportContent) -> None:
    """The floor plan as a rectangle with its picture; nothing without a plan."""
    plan, bounds = content.store.floor_plan_path(), content.store.dataset.bounds
    if plan is None:
        return
    corners = np.array([[bounds.x0, bounds.y0, 0], [bounds.x1, bounds.y0, 0],
                        [bounds.x1, bounds.y1, 0], [bounds.x0, bounds.y1, 0]])  # fmt: skip
    places = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    if not content.store.dataset.y_down:
        places[:, 1] = 1 - places[:, 1]
    mesh = rr.Mesh3D(
        vertex_positions=content.in_space(corners * (1, 1, 0)),
        triangle_indices=[[0, 1, 2], [0, 2, 3]], vertex_texcoords=places,
        albedo_texture=floor_plan_pixels(str(plan)),
    )  # fmt: skip
    recording.log("floor", mesh, static=True)


def _lines(recording: rr.RecordingStream, content: ExportContent) -> None:
    """True trajectories as lines, and predicted positions as points with their errors."""
    truth = content.store.instances
    poses = content.in_space(np.stack([truth.x, truth.y, truth.heading], axis=1))
    for name, iids in content.trajectories():
        line = _at_floor(poses[iids])
        recording.log(["truth", name], rr.LineStrips3D([line], colors=LIGHT.truth), static=True)
    for side in SIDES:
        predicted = content.in_space(content.predicted(side))[content.iids]
        kept = np.isfinite(predicted).all(axis=1)
        if kept.any():
            labels = [str(iid) for iid in content.iids[kept]]
            points = rr.Points3D(_at_floor(predicted[kept]), colors=getattr(LIGHT, side),
                                 labels=labels, show_labels=False, radii=0.05)  # fmt: skip
            recording.log(["predicted", side], points, static=True)


def _at_floor(poses: np.ndarray) -> np.ndarray:
    return np.column_stack([poses[:, :2], np.full(len(poses), _ABOVE)])


def _pinhole(lens: Intrinsics, width: int, height: int) -> rr.Pinhole:
    return rr.Pinhole(
        focal_length=(lens.fx, lens.fy), principal_point=(lens.cx, lens.cy), width=width,
        height=height, camera_xyz=rr.ViewCoordinates.RDF, image_plane_distance=0.5,
    )  # fmt: skip


def _frame(
    recording: rr.RecordingStream, content: ExportContent, side: Side, domain: Domain,
    frame: ExportedFrame,
) -> None:  # fmt: skip
    camera, pose = f"{side}/camera", content.store.poses(domain.domain)[frame.iid]
    recording.set_time(_INSTANCE, sequence=frame.iid)
    recording.set_time(_TIME, duration=float(content.times[frame.iid]))
    position, turn = content.camera(domain, content.in_space(pose[None])[0])
    recording.log(camera, rr.Transform3D(translation=position, quaternion=rr.Quaternion(xyzw=turn)))
    image = rr.EncodedImage(contents=png_bytes(frame.rgb), media_type="image/png")
    recording.log(f"{camera}/rgb", image)
    if frame.depth is not None:
        is_valid = (frame.depth >= domain.depth_raw_min) & (frame.depth <= domain.depth_raw_max)
        metres = np.where(is_valid, frame.depth * domain.depth_scale, 0).astype(np.float32)
        recording.log(f"{camera}/depth", rr.DepthImage(metres, meter=1.0))
    if frame.heat is not None:
        recording.log(f"{camera}/rgb/heat", rr.Image(frame.heat, opacity=0.5))
    if np.isfinite(error := content.errors(side)[frame.iid]):
        recording.log(f"{side}/error", rr.Scalars(float(error)))
