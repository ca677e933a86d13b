"""What files for other programs hold: images, poses, predictions and heat of selected instances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.heatmap_kinds import NO_HEAT
from s2rstore.language import Query
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, Domain, Side
from s2rtui.canvas import Pixels
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import common_scale
from s2rtui.drawing.heat_colours import heat_ramp
from s2rtui.drawing.scale import scale_fraction
from s2rtui.session import heatmaps
from s2rtui.session.evaluation import query_of
from s2rtui.session.state import HeatChoice
from s2rtui.user_data.notebook import Notes

Floats = NDArray[np.float64]
_BATCH = 64
_STEP = 0.1
"""Seconds between instances without times."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportedFrame:
    """Images of one instance in a domain: rgb (H, W, 3), raw depth (H, W) or None, heat in colours.

    heat (H, W, 3): of the run and kind that were asked for, None without.
    """

    iid: int
    rgb: NDArray[np.uint8]
    depth: NDArray[np.unsignedinteger] | None
    heat: Pixels | None


@dataclass(frozen=True, eq=False)
class ExportContent:
    """The selected instances of a scene.

    heat: the kind that lies over images, None for none. safe_csv: text in CSV cannot be a formula.
    """

    store: Store
    run: str
    query: Query
    notes: Notes
    heat: HeatChoice | None
    safe_csv: bool = False

    @classmethod
    def of(cls, scene: Scene, with_heat: bool, safe_csv: bool = False) -> ExportContent:
        """The content of a scene; its heat only `with_heat`."""
        state, heat = scene.state, scene.state.heat if with_heat else None
        heat = None if heat is not None and heat.kind == NO_HEAT else heat
        query = query_of(scene.store, state, scene.notes)
        return cls(scene.store, state.run, query, scene.notes, heat, safe_csv)

    @cached_property
    def iids(self) -> NDArray[np.intp]:
        """The selected instances, ascending."""
        return np.flatnonzero(self.query.instances)

    @cached_property
    def domains(self) -> dict[Side, Domain]:
        """The domains of the run, or the first of each kind without a run, by side."""
        if self.run != NO_RUN:
            record = self.store.run(self.run)
            return {side: self.store.domain(record.domain(side)) for side in SIDES}
        every = reversed(self.store.domains.values())
        return {domain.kind: domain for domain in every}

    @cached_property
    def times(self) -> Floats:
        """(N,) seconds of all instances: those of the recording, or ascending ones without."""
        count = len(self.store.instances)
        times = self.store.instances.timestamp
        return times if np.isfinite(times).all() else _STEP * np.arange(count, dtype=np.float64)

    def trajectories(self) -> Iterator[tuple[str, NDArray[np.intp]]]:
        """Yield the name and the selected instances of each trajectory that has some."""
        truth = self.store.instances
        for code, name in enumerate(truth.trajectory_names):
            members = self.iids[truth.trajectory[self.iids] == code]
            if members.size:
                yield name, members

    def predicted(self, side: Side) -> Floats:
        """(N, 3) predicted x, y in metres and heading in radians; NaN where there is none."""
        if self.run == NO_RUN:
            return np.full((len(self.store.instances), 3), np.nan)
        columns = getattr(self.store.run_columns(self.run), side)
        return np.stack([columns.x, columns.y, columns.heading], axis=1)

    def errors(self, side: Side) -> Floats:
        """(N,) errors of the predicted positions, metres; NaN where there is none."""
        if self.run == NO_RUN:
            return np.full(len(self.store.instances), np.nan)
        return np.asarray(getattr(self.store.run_columns(self.run), side).error)

    def in_space(self, poses: Floats) -> Floats:
        """Poses (n, 3) in a frame whose z points upwards: y is turned where it points downwards."""
        return poses * (1, -1, -1) if self.store.dataset.y_down else poses

    def camera(self, domain: Domain, pose: Floats) -> tuple[Floats, Floats]:
        """Position (3,) and quaternion (x, y, z, w) of the camera of a pose `in_space`.

        The axes of the camera are x right, y down, z forward.
        """
        x, y, heading = pose
        pitch = domain.rgb.pitch if math.isfinite(domain.rgb.pitch) else 0.0
        ahead = domain.forward_offset if math.isfinite(domain.forward_offset) else 0.0
        height = domain.camera_height if math.isfinite(domain.camera_height) else 0.0
        cos, sin = math.cos(heading), math.sin(heading)
        forward = np.array([math.cos(pitch) * cos, math.cos(pitch) * sin, math.sin(pitch)])
        right = np.array([sin, -cos, 0.0])
        axes = np.stack([right, np.cross(forward, right), forward], axis=1)
        position = np.array([x + ahead * cos, y + ahead * sin, height])
        from scipy.spatial.transform import Rotation  # not when the program starts

        return position, Rotation.from_matrix(axes).as_quat()

    def frames(self, side: Side) -> Iterator[ExportedFrame]:
        """Yield the images of the selected instances of a side, in the order of their iids."""
        domain = self.domains[side]
        imaged = self.iids[self.store.imaged(domain.domain)[self.iids]]
        for iids in np.split(imaged, np.flatnonzero(np.diff(imaged // _BATCH)) + 1):
            if not iids.size:
                continue
            for part in np.split(iids, np.flatnonzero(np.diff(iids) > 1) + 1):
                yield from self._block(side, domain, int(part[0]), int(part[-1]) + 1)

    def _block(self, side: Side, domain: Domain, start: int, stop: int) -> Iterator[ExportedFrame]:
        images = self.store.frames(domain.domain, start, stop)
        heats = self._heats(side, start, stop)
        for place, iid in enumerate(range(start, stop)):
            depth = images["depth"][place] if domain.has_depth else None
            heat = None if heats is None else heats[place]
            yield ExportedFrame(iid, images["rgb"][place], depth, heat)

    def _heats(self, side: Side, start: int, stop: int) -> Pixels | None:
        """Heat of instances in colours at the frame size, (n, H, W, 3)."""
        if self.heat is None:
            return None
        choice = self.heat
        values = self.store.heatmaps(self.run, choice.kind, side, start, stop, choice.mode)
        is_signed = choice.kind in heatmaps.SIGNED
        fixed = heatmaps.run_range(self.store, self.run, choice)
        scale = common_scale([values], is_signed, fixed) or (0.0, 1.0)
        size = self.store.dataset.frame_height, self.store.dataset.frame_width
        rows, columns = (
            np.arange(whole) * part // whole
            for whole, part in zip(size, values.shape[1:], strict=True)
        )
        colours = heat_ramp(is_signed)(np.nan_to_num(scale_fraction(values, scale)))
        return np.asarray(colours[:, rows][:, :, columns])

    def facts(self, iid: int) -> dict[str, Any]:
        """Trajectory, room, true pose, errors, tags and note of an instance, without missing ones.

        Metres and degrees.
        """
        truth, remark = self.store.instances, self.notes.remarks.get(iid)
        facts: dict[str, Any] = {"iid": iid}
        for name, codes, names in (
            ("trajectory", truth.trajectory, truth.trajectory_names),
            ("room", truth.room, truth.room_names),
        ):
            if codes[iid] >= 0:
                facts[name] = names[codes[iid]]
        numbers = {"x_m": truth.x[iid], "y_m": truth.y[iid],
                   "heading_deg": math.degrees(truth.heading[iid])}  # fmt: skip
        numbers |= {f"{side}_error_m": self.errors(side)[iid] for side in SIDES}
        facts |= {name: float(value) for name, value in numbers.items() if math.isfinite(value)}
        if remark is not None:
            facts |= {"tags": list(remark.tags), "note": remark.note}
        return facts


def png_bytes(image: NDArray[np.unsignedinteger]) -> bytes:
    """An image (H, W) or (H, W, 3) as a PNG file."""
    from PIL import Image

    buffer = BytesIO()
    Image.fromarray(image).save(buffer, "PNG")
    return buffer.getvalue()
