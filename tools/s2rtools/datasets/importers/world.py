"""The default world as a data set: rendered, not read."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.records import SIDES, Bounds, Domain, Room, Side
from s2rtools.datasets.scan import (
    CheckedFrame,
    DecodedFrame,
    InputIssue,
    InstanceRecord,
    Scan,
    ScanOptions,
)
from s2rtools.synthetic_world.dataset import NOTES, WorldData, WorldRecipe
from s2rtools.synthetic_world.floor_plan import SIZE
from s2rtools.synthetic_world.routes import Poses
from s2rtools.synthetic_world.world import (
    DEPTH_MAX,
    DEPTH_SCALE,
    TRAJECTORIES,
    standard_camera,
)

_PLAN_PIXELS = 1056
_SECONDS = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """A view that is rendered when it is asked for; `number` seeds its noise."""

    data: WorldData
    pose: Poses
    number: int
    side: Side

    @property
    def pixels(self) -> int:
        return self.data.recipe.frame**2

    def files(self, scan: Scan) -> tuple[str | None, str | None]:
        return None, None

    def check(self, scan: Scan, domain: Domain) -> CheckedFrame | InputIssue:
        return CheckedFrame("uint16")

    def view(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        made = self.data.views(self.side, self.pose[None], np.array([self.number]))
        rgb, depth = made.rgb[0], self.data.raw(made)[0]
        valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
        digest = hashlib.sha256(rgb.tobytes() + depth.tobytes()).hexdigest()
        return DecodedFrame(rgb, depth, digest, float(valid.mean()))


def scan(path: Path, options: ScanOptions) -> Scan:
    """The data set of a recipe; `path` stays empty. Raises RequestError for recipes of nothing."""
    if path != Path():
        raise RequestError(f"{path}: `s2r ingest world` makes its data; it takes no PATH")
    data = WorldData(WorldRecipe(**{**options.world, "frame": options.frame[0]}))
    for name in options.trajectories:
        if name not in data.poses:
            raise RequestError(f"--trajectory {name}: has {', '.join(data.poses)}")
    wanted = options.trajectories or tuple(data.poses)
    return Scan(
        name=f"world-{data.recipe.seed}",
        root=Path(),
        frame=options.frame,
        y_down=True,
        bounds=Bounds(0.0, 0.0, SIZE, SIZE),
        accuracy_scale=Bounds(0.0, 0.0, SIZE, SIZE).diagonal,
        domains={side: _domain(side, options.frame[0]) for side in ("sim", "real")},
        rooms=tuple(
            Room(r.name, number, r.area.x0, r.area.y0, r.area.x1, r.area.y1)
            for number, r in enumerate(data.world.plan.rooms)
        ),
        floor_plan=data.world.renderer({}).plan(_PLAN_PIXELS),
        trajectories={name: _sightings(data, name) for name in wanted},
        recorded_at=TRAJECTORIES,
        notes={NOTES: data.notes()},
        drives=partial(_drives, data.recipe),
    )


def _domain(side: Side, frame: int) -> Domain:
    """The cameras as everyone believes them to be; what a factor does to them is not declared."""
    camera = standard_camera(frame)
    return Domain(
        domain=side, kind=side, rgb=camera.lens, depth=camera.lens, camera_height=camera.height,
        forward_offset=camera.forward_offset, depth_scale=DEPTH_SCALE, depth_raw_min=1,
        depth_raw_max=round(DEPTH_MAX / DEPTH_SCALE),
        sources={"rgb": "declared", "depth": "declared", "mount": "declared"},
    )  # fmt: skip


def _drives(recipe: WorldRecipe, folder: Path) -> None:
    """What the world's robot does on the same commands as its simulation."""
    from s2rtools.sysid.synthetic_drives import SEVERITIES, make_drives

    severities = {name: value for name, value in recipe.factors.items() if name in SEVERITIES}
    make_drives(folder, recipe.seed, severities)


def _sightings(data: WorldData, name: str) -> list[InstanceRecord]:
    poses, odometry = data.poses[name], data.odometry(name)
    return [
        InstanceRecord(
            x=float(pose[0]), y=float(pose[1]), heading=float(pose[2]),
            images={side: Rendering(data, pose, data.number(name, row), side) for side in SIDES},
            odometry=(float(odom[0]), float(odom[1]), float(odom[2])),
            timestamp=_SECONDS * row,
        )
        for row, (pose, odom) in enumerate(zip(poses, odometry, strict=True))
    ]  # fmt: skip
