"""The synthetic world as a renderer gives the frames that ingest writes."""

from pathlib import Path

import numpy as np

from s2rtools.datasets.importers.synthetic_world import scan
from s2rtools.datasets.scan import ScanOptions
from s2rtools.renderer.protocol import Hello
from s2rtools.renderer.world import PARAMETERS, world_renderer
from s2rtools.simulated_frames.requested_poses import camera_poses


def test_frames_equal_those_of_the_store():
    world = scan(Path(), ScanOptions(frame=(32, 32), world={"count": 3}))
    domain = world.domains["sim"]
    lens = domain.rgb
    camera = Hello(width=32, height=32, fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy,
                   y_down=world.y_down, folder="")  # fmt: skip
    render = world_renderer(1)
    values = {parameter.name: parameter.default for parameter in PARAMETERS}
    for record in next(iter(world.trajectories.values())):
        stored = record.sources["sim"].decode(world, domain)
        poses = np.array([[record.x, record.y, record.heading]])
        rgb, depth = render(*camera_poses(poses, domain, world.y_down), camera, values)
        np.testing.assert_array_equal(rgb, stored.rgb)
        np.testing.assert_array_equal(np.rint(depth / domain.depth_scale), stored.depth)
