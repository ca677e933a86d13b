"""Import the synthetic world: its frames are rendered instead of read."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.lazy_sequence import LazySequence
from s2rstore.records import SIDES, Bounds, Domain, Room, Side
from s2rtools.datasets.scan import DecodedFrame, InstanceRecord, Scan, ScanOptions
from s2rtools.synthetic_world.dataset import PROVENANCE_SECTION, WorldData, WorldRecipe
from s2rtools.synthetic_world.floor_plan import BUILDING_SIZE
from s2rtools.synthetic_world.routes import Poses
from s2rtools.synthetic_world.world import DEPTH_MAX, DEPTH_SCALE, TRAJECTORIES, standard_camera

_FLOOR_PLAN_PIXELS = 1056
_FRAME_INTERVAL = 0.5
"""Seconds between two instances."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrameSource:
    """A frame that is rendered on request; `number` seeds its noise."""

    data: WorldData
    pose: Poses
    number: int
    side: Side

    @property
    def pixels(self) -> int:
        return self.data.recipe.frame**2

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return None, None

    def origin(self) -> tuple[tuple[Path, ...], str]:
        recipe = self.data.recipe
        return (), f"{recipe} {self.pose.tolist()} {self.number} {self.side}"

    def checksum(self, scan: Scan, domain: Domain) -> str:
        return self.decode(scan, domain).sha256

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame:
        views = self.data.views(self.side, self.pose[None], np.array([self.number]))
        rgb, depth = views.rgb[0], self.data.raw_depth(views)[0]
        valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
        digest = hashlib.sha256(rgb.tobytes() + depth.tobytes()).hexdigest()
        return DecodedFrame(rgb, depth, digest, float(valid.mean()))


def scan(path: Path, options: ScanOptions) -> Scan:
    """Scan the world of a recipe; `path` stays empty. Raises RequestError for invalid recipes."""
    if path != Path():
        raise RequestError(f"{path}: `s2r ingest world` renders its data and takes no PATH")
    data = WorldData(WorldRecipe(**{**options.world, "frame": options.frame[0]}))
    names = options.choose_trajectories(data.poses, "the world")
    return Scan(
        name=f"world-{data.recipe.seed}",
        root=Path(),
        frame=options.frame,
        y_down=True,
        bounds=Bounds(0.0, 0.0, BUILDING_SIZE, BUILDING_SIZE),
        accuracy_scale=Bounds(0.0, 0.0, BUILDING_SIZE, BUILDING_SIZE).diagonal,
        domains={side: _domain(side, options.frame[0]) for side in ("sim", "real")},
        rooms=tuple(
            Room(r.name, number, r.area.x0, r.area.y0, r.area.x1, r.area.y1)
            for number, r in enumerate(data.world.plan.rooms)
        ),
        floor_plan=data.world.renderer({}).plan(_FLOOR_PLAN_PIXELS),
        trajectories={name: _instance_records(data, name) for name in names},
        recorded_at=TRAJECTORIES,
        provenance={PROVENANCE_SECTION: data.provenance()},
        drives=partial(_write_drives, data.recipe),
    )


def _domain(side: Side, frame: int) -> Domain:
    """The declared cameras, without the changes that factors make to them."""
    camera = standard_camera(frame)
    return Domain(
        domain=side, kind=side, rgb=camera.lens, depth=camera.lens, camera_height=camera.height,
        forward_offset=camera.forward_offset, depth_scale=DEPTH_SCALE, depth_raw_min=1,
        depth_raw_max=round(DEPTH_MAX / DEPTH_SCALE),
        sources={"rgb": "declared", "depth": "declared", "mount": "declared"},
    )  # fmt: skip


def _write_drives(recipe: WorldRecipe, folder: Path) -> None:
    """Write the drives of the robot and of its simulation on the same commands."""
    from s2rtools.sysid.synthetic_drives import SEVERITIES, make_drives

    severities = {name: value for name, value in recipe.factors.items() if name in SEVERITIES}
    make_drives(folder, recipe.seed, severities)


def _instance_records(data: WorldData, name: str) -> LazySequence[InstanceRecord]:
    poses, odometry = data.poses[name], data.odometry(name)

    def record(row: int) -> InstanceRecord:
        pose, odom = poses[row], odometry[row]
        number = data.noise_number(name, row)
        return InstanceRecord(
            x=float(pose[0]), y=float(pose[1]), heading=float(pose[2]),
            sources={side: RenderedFrameSource(data, pose, number, side) for side in SIDES},
            odometry=(float(odom[0]), float(odom[1]), float(odom[2])),
            timestamp=_FRAME_INTERVAL * row,
        )  # fmt: skip

    return LazySequence(len(poses), record)
