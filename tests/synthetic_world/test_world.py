"""The synthetic world: deterministic images, free trajectories and visible factors."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rstore.records import Intrinsics
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from s2rtools.synthetic_world.factors import (
    FACTORS,
    complete_severities,
    parse_constants,
    parse_factors,
)
from s2rtools.synthetic_world.materials import Material
from s2rtools.synthetic_world.renderer import Camera, RayCaster
from s2rtools.synthetic_world.scene_geometry import ScenePart, WorldScene
from s2rtools.synthetic_world.world import World, apply_sensor_factors, side_camera, standard_camera
from s2rtools.training import pretrained

SEEDS = (1, 2, 5)


@pytest.fixture(scope="module", params=SEEDS)
def world(request: pytest.FixtureRequest) -> World:
    return World(request.param)


@pytest.fixture(scope="module")
def data() -> WorldData:
    return WorldData(WorldRecipe(count=20, frame=64))


def test_every_kind_of_object_change_occurs(world):
    changes = {(item.name, item.change) for item in world.objects if item.change}
    for expected in (("bicycle", "removed"), ("extinguisher", "removed"), ("door", "closed"),
                   ("cartons", "added"), ("poster", "removed")):  # fmt: skip
        assert expected in changes
    assert {"moved"} <= {change for _, change in changes}
    assert len(world.changed_objects({"objects": 1.0})) >= 12
    assert world.changed_objects({}) == []
    assert (
        0
        < len(world.changed_objects({"objects": 0.5}))
        < len(world.changed_objects({"objects": 1.0}))
    )


def test_the_trajectories_are_free_of_obstacles_and_separate(world):
    first, second = (world.poses(name, 60) for name in ("traj1", "traj2"))
    for poses in (first, second):
        assert 40 <= len(poses) <= 60
        assert world.has_content(poses).mean() > 0.95
    distances = np.hypot(*(first[:, None, :2] - second[None, :, :2]).transpose(2, 0, 1))
    assert (distances.min(axis=1) < 0.5).mean() < 0.25


def test_views_are_reproducible_and_finite(data):
    poses, numbers = data.poses["traj1"], np.arange(len(data.poses["traj1"]))
    for side in ("sim", "real"):
        first, second = (data.views(side, poses, numbers) for _ in range(2))
        assert np.array_equal(first.rgb, second.rgb)
        assert np.array_equal(first.depth, second.depth)
        assert np.isfinite(first.depth).all()
        assert first.rgb.std(axis=(1, 2)).mean() > 15
    single = data.views("real", poses[7:8], numbers[7:8])
    assert np.array_equal(single.rgb[0], first.rgb[7])


def test_without_factors_real_equals_sim():
    data = WorldData(WorldRecipe(count=4, frame=32, factors=parse_factors("none")))
    poses = data.poses["traj2"]
    sim, real = (data.views(side, poses, np.arange(len(poses))) for side in ("sim", "real"))
    assert np.array_equal(sim.rgb, real.rgb)
    assert np.array_equal(sim.depth, real.depth)


@pytest.mark.parametrize("name", list(FACTORS))
def test_each_factor_changes_only_its_part(data, name):
    poses = data.poses["traj1"]
    numbers = np.arange(len(poses))
    world = data.world
    unchanged = world.renderer({}).render(poses, standard_camera(64))
    views = world.renderer({name: 1.0}).render(poses, side_camera(64, {name: 1.0}))
    with_factor = apply_sensor_factors(views, {name: 1.0}, 1, numbers)
    without_factor = apply_sensor_factors(unchanged, {name: 0.0}, 1, numbers)
    assert np.array_equal(without_factor.rgb, unchanged.rgb)
    assert np.array_equal(without_factor.depth, unchanged.depth)
    geometry = name in ("camera", "objects", "depth")
    colour = name != "depth" and not FACTORS[name].moves_robot
    assert np.array_equal(with_factor.depth, unchanged.depth) != geometry
    assert np.array_equal(with_factor.rgb, unchanged.rgb) != colour


def test_restoring_an_object_changes_only_its_pixels(data):
    world, camera = data.world, standard_camera(64)
    poses = np.concatenate(list(data.poses.values()))
    real = world.renderer({"objects": 1.0}).render(poses, camera, samples=0)
    sim = world.renderer({}).render(poses, camera, samples=0)
    visible_changes = 0
    for number in world.changed_objects({"objects": 1.0})[:4]:
        restored = world.renderer({"objects": 1.0}, restored=(number,)).render(poses, camera, 0)
        is_affected = (real.identity == number) | (restored.identity == number)
        assert np.array_equal(restored.identity[~is_affected], real.identity[~is_affected])
        shows_object = restored.identity == number
        assert (sim.depth[shows_object] <= restored.depth[shows_object] + 1e-5).all()
        visible_changes += int(is_affected.any())
    assert visible_changes


def box_scene() -> WorldScene:
    """One crate in an empty hall."""
    floor = np.zeros((200, 200), dtype=np.uint8)
    crate = ScenePart(12.0, 10.0, 0.5, 2.0, 0.0, 1.5, (0.5, 0.4, 0.3), Material.PAINT)
    return WorldScene(20.0, 2.7, (), ((1, (crate,)),), (), floor, 0.1,
                 World(1).plan.palette)  # fmt: skip


def test_depth_agrees_with_geometry():
    """The face of a crate 1.5 m ahead, the floor below and the ceiling above."""
    lens = Intrinsics(40.0, 40.0, 32.0, 32.0, 0.0)
    views = RayCaster(box_scene()).render(
        np.array([[10.0, 10.0, 0.0]]), Camera((64, 64), lens, 0.6), samples=0
    )
    rows, cols = np.mgrid[:64, :64] + 0.5
    up, right = -(rows - 32) / 40, (cols - 32) / 40
    ahead = 1.5
    on_face = (np.abs(right * ahead) < 1.98) & (up * ahead + 0.6 < 1.48) & (up * ahead + 0.6 > 0.02)
    assert (views.identity[0][on_face] == 1).all()
    assert np.allclose(views.depth[0][on_face], ahead, atol=1e-4)
    floor = (up < 0) & (0.6 / np.maximum(-up, 1e-9) < 1.48)
    assert np.allclose(views.depth[0][floor], (0.6 / -up)[floor], atol=1e-3)
    assert (views.identity[0][floor] == 0).all()


def test_neutral_lights_change_no_bit_and_factors_change_the_colours_alone(data):
    poses, numbers = data.poses["traj1"][:2], np.arange(2)
    plain = data.views("sim", poses, numbers)
    same = data.views("sim", poses, numbers, lights=(1.0, 1.0))
    np.testing.assert_array_equal(plain.rgb, same.rgb)
    nearly = data.views("sim", poses, numbers, lights=(1.0, 1.0 + 1e-9))
    assert np.abs(nearly.rgb.astype(int) - plain.rgb).max() <= 1
    bright = data.views("sim", poses, numbers, lights=(1.5, 1.0))
    assert bright.rgb.mean() > plain.rgb.mean() + 5
    np.testing.assert_array_equal(bright.depth, plain.depth)


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_a_subsampled_camera_sees_the_centres_of_its_pixels(data, stride):
    poses, numbers = data.poses["traj1"][:2], np.arange(2)
    whole = data.views("sim", poses, numbers)
    part = data.views("sim", poses, numbers, data.camera("sim").subsampled(stride), samples=1)
    np.testing.assert_array_equal(part.depth, whole.depth[:, ::stride, ::stride])


def test_odometry_drifts(data):
    poses, odometry = data.poses["traj1"], data.odometry("traj1")
    distances = np.hypot(*(odometry - poses)[:, :2].T)
    assert distances[0] == 0
    assert 0.05 < distances[-1] < 6


@pytest.mark.parametrize("text", ["moon", "lights=x", "lights=-1", "lights=2.5"])
def test_invalid_factors_are_rejected(text):
    with pytest.raises(RequestError):
        parse_factors(text)


def test_factors_are_parsed_from_text():
    assert parse_factors("") == complete_severities()
    assert set(parse_factors("none").values()) == {0.0}
    severities = parse_factors("lights=0.5,objects")
    assert (severities["lights"], severities["objects"], severities["camera"]) == (0.5, 1.0, 0.0)


OTHER_CONSTANTS = {"exposure.vignette": 0.5, "depth.farthest": 4.0, "sensor.noise": 12.0,
                   "camera.height": 0.1}  # fmt: skip


def test_other_constants_change_the_real_side_only(data):
    other = WorldData(WorldRecipe(count=20, frame=64, constants=OTHER_CONSTANTS))
    poses, numbers = data.poses["traj1"][:6], np.arange(6)
    sim, own_sim = (world.views("sim", poses, numbers) for world in (other, data))
    assert np.array_equal(sim.rgb, own_sim.rgb)
    assert np.array_equal(sim.depth, own_sim.depth)
    real, own_real = (world.views("real", poses, numbers) for world in (other, data))
    assert real.depth.max() < 4.8 < own_real.depth.max()  # noise is added at up to 4 m
    corner = (slice(None), slice(0, 8), slice(0, 8))
    assert real.rgb[corner].mean() < own_real.rgb[corner].mean()
    assert other.camera("real").height == pytest.approx(other.camera("sim").height + 0.1)
    low, high = data.camera("real").height, other.camera("real").height
    assert high == pytest.approx(low + 0.19)


def test_only_other_constants_are_recorded():
    assert "constants" not in WorldData(WorldRecipe(count=2)).provenance()["recipe"]
    other = WorldData(WorldRecipe(count=2, constants=OTHER_CONSTANTS)).provenance()["recipe"]
    assert other["constants"] == OTHER_CONSTANTS


def test_constants_are_parsed_from_text():
    assert parse_constants("") == {}
    parsed = parse_constants("exposure.vignette=0.4, depth.farthest=5")
    assert parsed == {"exposure.vignette": 0.4, "depth.farthest": 5.0}


@pytest.mark.parametrize(
    "text",
    ["vignette=1", "exposure.vignette=x", "depth.farthest=nan", "camera.zoom=-0.5",
     "lights.power=1", "sensor.noise=1,sensor.noise=2", "sensor.noise"],
)  # fmt: skip
def test_invalid_constants_are_rejected(text):
    with pytest.raises(RequestError):
        parse_constants(text)


def test_the_rendered_images_match_the_pretrained_models():
    """The pretrained models must be trained again whenever the rendered images change.

    Rounding differs between processors, so a few pixels may differ; the hash of the golden file
    may not.
    """
    digest = hashlib.sha256(pretrained.GOLDEN.read_bytes()).hexdigest()
    for name in pretrained.PRETRAINED_MODELS:
        assert pretrained.model_description(name)["golden"] == digest
    golden = np.load(pretrained.GOLDEN)
    for name, image in pretrained.golden_views().items():
        differences = np.abs(image.astype(float) - golden[name])
        assert (differences > 3).mean() < 0.005, name
        assert differences[differences <= 3].mean() < 0.05, name


ROUTES = "a946e67528e412cc"
_PRINT = """
import hashlib
import numpy as np
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
data = WorldData(WorldRecipe(seed=1, count=24, frame=48))
content = b"".join(np.ascontiguousarray(data.poses[name]).tobytes() for name in sorted(data.poses))
poses = np.concatenate([data.poses[name] for name in sorted(data.poses)])[::6]
for side in ("sim", "real"):
    views = data.views(side, poses, np.arange(len(poses)))
    content += views.rgb.tobytes() + data.raw_depth(views).tobytes()
print(hashlib.sha256(content).hexdigest())
"""


def test_the_routes_are_those_of_the_documentation():
    data = WorldData(WorldRecipe(seed=1, count=24, frame=48))
    poses = np.concatenate([data.poses[name] for name in sorted(data.poses)])
    assert poses.shape == (48, 3)
    assert hashlib.sha256(np.round(poses, 3).tobytes()).hexdigest()[:16] == ROUTES


@pytest.mark.deep
def test_routes_and_images_do_not_depend_on_the_instructions_of_the_processor():
    """numpy without its AVX-512 and AVX2 functions, numba for a generic processor."""
    plain = {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    }
    printed = {
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", _PRINT],
            env={**os.environ, **more}, capture_output=True, text=True, check=True,
        ).stdout
        for more in ({}, plain)
    }  # fmt: skip
    assert len(printed) == 1
