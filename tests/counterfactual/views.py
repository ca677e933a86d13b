"""Views of a small synthetic world for tests of counterfactual images."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain
from s2rtools.counterfactual.scene_comparison import ImageArrays
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from s2rtools.synthetic_world.renderer import Camera
from s2rtools.synthetic_world.world import standard_camera, to_raw_depth

SIZE = 64
FRAME = (SIZE, SIZE)
LOWERED = standard_camera(SIZE).moved(height=-0.08, zoom=1.05)


@cache
def world() -> WorldData:
    return WorldData(WorldRecipe(seed=3, count=12, frame=SIZE, factors={"objects": 1.0}))


def rendered(scene: str, camera: Camera) -> list[ImageArrays]:
    """RGB, raw depth and its validity of the instances, without any effect of sensors."""
    data = world()
    views = data.renderer(scene).render(data.poses["traj1"], camera)
    depth = to_raw_depth(views.depth)
    return [(rgb, raw, raw > 0) for rgb, raw in zip(views.rgb, depth, strict=True)]


def rig(camera: Camera) -> Domain:
    lens = camera.lens
    return Domain("rig", "sim", lens, lens, camera.height, camera.forward_offset, 0.001, 1, 10_000)


def metres(image: ImageArrays) -> NDArray[np.float32]:
    return np.where(image[2], image[1] * 0.001, 0).astype(np.float32)
