"""6-DoF poses are put on the floor, from any world, with what does not fit on a plane reported."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.datasets.floor.floor_poses import FloorOptions, parse_up, project_to_floor
from s2rtools.datasets.recording import (
    PinholeCamera,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
    SourceImage,
)

Floats = NDArray[np.float64]
CAMERA = PinholeCamera(96, 72, 60.0, 60.0, 48.0, 36.0)
HEIGHT = 0.62


class Image:
    """An image in memory."""

    def __init__(self, name: str, pixels: NDArray[np.generic]) -> None:
        self.name, self._pixels = name, pixels

    @property
    def pixels(self) -> int:
        return self._pixels.size

    def checksum(self) -> str:
        return "0" * 64

    def read(self) -> SourceImage:
        return SourceImage(self._pixels, self.checksum(), 16)


def level_cameras(poses: Floats, height: float = HEIGHT, pitch: float = 0.0) -> Floats:
    """Cameras (N, 4, 4) of floor poses (N, 3) in axes with z up."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    up, ahead = math.sin(pitch), math.cos(pitch)
    result[:, :3, 2] = np.stack([ahead * cos, ahead * sin, np.full_like(cos, up)], 1)
    result[:, :3, 0] = np.stack([sin, -cos, np.zeros_like(cos)], 1)
    result[:, :3, 1] = np.cross(result[:, :3, 2], result[:, :3, 0])
    result[:, :2, 3] = poses[:, :2]
    result[:, 2, 3] = height
    return result


def random_poses(count: int, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    return rng.uniform([0, 0, -math.pi], [8, 6, math.pi], (count, 3))


def recording(
    cameras: Floats, depth: list[NDArray[np.uint16]] | None = None, **facts: object
) -> Recording:
    frames = [
        RecordedFrame(
            Image(f"rgb/{row}.png", np.zeros((72, 96, 3), np.uint8)),
            None if depth is None else Image(f"depth/{row}.png", depth[row]),
        )
        for row in range(len(cameras))
    ]
    trajectory = RecordedTrajectory(frames, cameras, np.arange(len(cameras), dtype=float))
    return Recording("test", "walk", Path(), CAMERA, trajectories={"walk": trajectory}, **facts)  # type: ignore[arg-type]


def room_depth(
    cameras: Floats, extent: float = 4.0, table: bool = False
) -> list[NDArray[np.uint16]]:
    """Depth in mm in a room of -extent .. extent + 8 by z 0 .. 2.6, its floor at z = 0."""
    v, u = np.meshgrid(np.arange(72) + 0.5, np.arange(96) + 0.5, indexing="ij")
    local = np.stack([(u - 48) / 60, (v - 36) / 60, np.ones_like(u)], -1)
    planes = [(2, 0.0), (2, 2.6)] + [(a, c) for a in (0, 1) for c in (-extent, extent + 8)]
    images = []
    for camera in cameras:
        rays, centre = local @ camera[:3, :3].T, camera[:3, 3]
        nearest = np.full(u.shape, np.inf)
        for axis, level in planes:
            with np.errstate(divide="ignore", invalid="ignore"):
                away = (level - centre[axis]) / rays[..., axis]
            nearest = np.where((away > 0) & (away < nearest), away, nearest)
        if table:
            with np.errstate(divide="ignore", invalid="ignore"):
                away = (0.4 - centre[2]) / rays[..., 2]
            hit = centre + away[..., None] * rays
            on_table = (away > 0) & (np.floor(hit[..., 0] / 1.5) % 2 == 0)
            nearest = np.where(on_table & (away < nearest), away, nearest)
        images.append(np.round(np.minimum(nearest, 60) * 1000).astype(np.uint16))
    return images


def in_world(cameras: Floats, rotation: Floats, offset: Floats) -> Floats:
    """Cameras in the axes of another world: p' = rotation p + offset."""
    moved = cameras.copy()
    moved[:, :3, :3] = rotation @ cameras[:, :3, :3]
    moved[:, :3, 3] = cameras[:, :3, 3] @ rotation.T + offset
    return moved


def assert_same_up_to_motion(found: Floats, truth: Floats) -> None:
    """Equal up to one rotation and translation in the plane: 1 mm and 0.01 degrees."""
    turn = float(angles.wrap(found[0, 2] - truth[0, 2]))
    cos, sin = math.cos(turn), math.sin(turn)
    moved = truth[:, :2] @ np.array([[cos, sin], [-sin, cos]])
    moved += (found[:, :2] - moved).mean(axis=0)
    assert np.abs(found[:, :2] - moved).max() < 1e-3
    assert np.degrees(angles.distance(found[:, 2], truth[:, 2] + turn)).max() < 0.01


ROTATIONS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(ROTATIONS, st.integers(0, 1000), st.floats(-0.6, 0.6), st.booleans())
@example((0.0, 1.0, 5.057877700090312e-06, 0.0), 187, 0.0, True)  # up is nearly -z
@example((0.0, 1.0, 0.0, 0.0), 187, 0.0, True)
@example((1.0, 0.125, 5.782451535377022e-164, 0.0), 0, 0.0625, False)
def test_poses_of_any_world_are_recovered_up_to_a_rigid_motion(quaternion, seed, pitch, declared):
    truth = random_poses(30, seed)
    rotation = Rotation.from_quat(quaternion).as_matrix()
    offset = np.random.default_rng(seed).uniform(-50, 50, 3)
    cameras = in_world(level_cameras(truth, HEIGHT, pitch), rotation, offset)
    options = FloorOptions(
        up=list(rotation[:, 2]) if declared else None, ground=float(rotation[:, 2] @ offset)
    )
    found = project_to_floor(recording(cameras), options)
    assert_same_up_to_motion(found.poses["walk"], truth)
    assert found.camera_height == pytest.approx(HEIGHT, abs=1e-6)
    assert found.pitch == pytest.approx(pitch, abs=1e-6)
    assert math.degrees(found.tilt_max) < 0.01
    assert not found.issues
    up = found.world_to_floor[:3, :3] @ rotation[:, 2]
    assert up == pytest.approx([0, 0, 1], abs=1e-6)


@pytest.mark.parametrize(
    ("up", "x", "y"),
    [("z", [1, 0, 0], [0, 1, 0]), ("y", [1, 0, 0], [0, 0, -1]), ("-y", [1, 0, 0], [0, 0, 1]),
     ("-z", [1, 0, 0], [0, -1, 0]), ("x", [0, 0, -1], [0, 1, 0])],
)  # fmt: skip
def test_axes_of_the_floor_follow_from_the_up_axis(up, x, y):
    turn = np.stack([x, y, parse_up(up)], axis=1).astype(float)
    cameras = in_world(level_cameras(random_poses(5, 1)), turn, np.zeros(3))
    found = project_to_floor(recording(cameras), FloorOptions(up=up, ground=0.0))
    assert found.world_to_floor[:3, :3] == pytest.approx(turn.T)
    assert found.poses["walk"] == pytest.approx(random_poses(5, 1))


def test_up_axis_of_the_layout_is_used_and_a_declared_one_replaces_it():
    cameras = level_cameras(random_poses(5, 2))
    known = recording(cameras, up=(0.0, 0.0, 1.0))
    assert project_to_floor(known).up == pytest.approx([0, 0, 1])
    assert project_to_floor(known, FloorOptions("0, 0.1, 1")).up[1] == pytest.approx(
        0.0995, abs=1e-4
    )


def test_floor_and_camera_height_come_from_depth():
    cameras = level_cameras(random_poses(12, 3), pitch=-0.2)
    cameras[:, 2, 3] += 5.0
    depth = room_depth(level_cameras(random_poses(12, 3), pitch=-0.2), table=True)
    found = project_to_floor(recording(cameras, depth, up=(0.0, 0.0, 1.0)))
    assert found.camera_height == pytest.approx(HEIGHT, abs=0.005)
    assert found.world_to_floor[2, 3] == pytest.approx(-5.0, abs=0.005)
    assert not found.issues


def test_up_axis_of_a_handheld_camera_is_fitted_to_the_floor_in_depth():
    rng = np.random.default_rng(4)
    truth = random_poses(24, 4)
    cameras = level_cameras(truth, 1.4, -0.5)
    shaken = Rotation.from_rotvec(np.radians(rng.normal(0, 6, (24, 3)))).as_matrix()
    cameras[:, :3, :3] = shaken @ cameras[:, :3, :3]
    depth = room_depth(cameras)
    rotation = Rotation.from_rotvec([1.0, -0.5, 0.3]).as_matrix()
    found = project_to_floor(recording(in_world(cameras, rotation, np.ones(3)), depth))
    assert math.degrees(math.acos(found.up @ rotation[:, 2])) < 0.3
    assert found.camera_height == pytest.approx(1.4, abs=0.02)
    assert [issue.kind for issue in found.issues] == ["camera not level"]
    assert math.degrees(found.tilt_median) == pytest.approx(9, abs=4)


def test_floor_inclined_to_the_declared_up_axis_is_reported():
    cameras = level_cameras(random_poses(12, 5), pitch=-0.2)
    wrong = [0.0, math.sin(0.15), math.cos(0.15)]
    found = project_to_floor(recording(cameras, room_depth(cameras)), FloorOptions(wrong))
    assert "floor inclined" in {issue.kind for issue in found.issues}


def test_level_motion_determines_the_up_axis_of_a_camera_that_does_not_turn():
    truth = np.column_stack([np.linspace(0, 4, 9), np.zeros(9), np.zeros(9)])
    found = project_to_floor(recording(level_cameras(truth)), FloorOptions(camera_height=1.0))
    assert found.up == pytest.approx([0, 0, 1], abs=1e-9)
    assert found.camera_height == pytest.approx(1.0)


def test_undetermined_up_axis_names_the_option():
    truth = np.column_stack([np.zeros(9), np.linspace(0, 4, 9), np.zeros(9)])
    with pytest.raises(RequestError, match="give up, such as z"):
        project_to_floor(recording(level_cameras(truth)))


def test_frames_that_look_straight_down_have_no_heading():
    cameras = level_cameras(random_poses(6, 6))
    cameras[2] = level_cameras(random_poses(6, 6)[2:3], HEIGHT, math.radians(-88))[0]
    found = project_to_floor(recording(cameras), FloorOptions("z", ground=0.0))
    assert found.usable("walk").tolist() == [True, True, False, True, True, True]
    assert [(i.kind, i.file) for i in found.issues] == [("no heading", "rgb/2.png")]


def test_world_in_other_units_is_scaled_to_metres():
    truth = random_poses(8, 7)
    cameras = level_cameras(truth)
    cameras[:, :3, 3] *= 4.0
    shrunk = recording(cameras, is_metric=False)
    found = project_to_floor(shrunk, FloorOptions("z", 0.0, metres_per_unit=0.25))
    assert found.poses["walk"] == pytest.approx(truth)
    assert found.cameras["walk"][:, :3, :3] == pytest.approx(cameras[:, :3, :3])
    issues = project_to_floor(shrunk, FloorOptions("z", 0.0)).issues
    assert [issue.kind for issue in issues] == ["scale of the world not known"]
    assert issues[0].detail.endswith("give metres_per_unit")
    shrunk.scale_option = "scale"
    (issue,) = project_to_floor(shrunk, FloorOptions("z", 0.0)).issues
    assert issue.detail.endswith("give option scale of layout test")


@pytest.mark.parametrize("depth_in_world_units", [False, True])
def test_height_from_depth_follows_the_unit_of_depth(depth_in_world_units):
    truth = level_cameras(random_poses(30, 4), pitch=-0.3)
    depth = room_depth(truth)
    cameras = truth.copy()
    cameras[:, :3, 3] *= 0.5
    shrunk = recording(cameras, depth, is_metric=False)
    if depth_in_world_units:
        shrunk.depth_scale, shrunk.depth_in_world_units = 0.0005, True
    found = project_to_floor(shrunk, FloorOptions("z", metres_per_unit=2.0))
    assert found.camera_height == pytest.approx(HEIGHT, abs=0.01)


def test_height_of_the_cameras_stays_unknown_without_depth_and_declaration():
    found = project_to_floor(recording(level_cameras(random_poses(8, 8))), FloorOptions("z"))
    assert math.isnan(found.camera_height)
    assert "give ground or camera_height" in found.report[0]


def test_positions_in_millimetres_are_refused_unless_their_unit_is_stated():
    cameras = level_cameras(random_poses(20, 1))
    cameras[:, :3, 3] *= 1000
    with pytest.raises(RequestError, match=r"millimetres: .* 7,\d\d\d m x 5,\d\d\d m"):
        project_to_floor(recording(cameras), FloorOptions("z"))
    with pytest.raises(RequestError, match=r"millimetres: .*, 620 m above the floor; give"):
        project_to_floor(recording(cameras[:1]), FloorOptions("z", ground=0.0))
    found = project_to_floor(recording(cameras), FloorOptions("z", metres_per_unit=0.001))
    assert np.ptp(found.poses["walk"][:, 0]) < 8
    found = project_to_floor(recording(cameras), FloorOptions("z", metres_per_unit=1.0))
    assert np.ptp(found.poses["walk"][:, 0]) > 7000


def test_a_desk_in_millimetres_is_refused_by_its_speed():
    cameras = level_cameras(random_poses(20, 1) / 12)
    made = recording(cameras)
    walk = made.trajectories["walk"]
    made.trajectories["walk"] = replace(walk, timestamps=0.5 * np.arange(20))
    project_to_floor(made, FloorOptions("z"))
    made.trajectories["walk"] = replace(walk, timestamps=0.001 * np.arange(20))
    project_to_floor(made, FloorOptions("z"))  # poses in any order, at a high rate
    made.trajectories["walk"] = replace(walk, timestamps=0.5 * np.arange(20))
    walk.poses[:, :3, 3] *= 1000
    with pytest.raises(RequestError, match=r"millimetres: .* m at \d{3} m/s; give .*=0.001 \(0.01"):
        project_to_floor(made, FloorOptions("z"))


def test_a_hand_held_video_in_millimetres_is_refused_without_times():
    cameras = level_cameras(random_poses(200, 1))
    cameras[:, :2, 3] = 6.0 * np.arange(200)[:, None]
    made = recording(cameras)
    project_to_floor(made, FloorOptions("z"))
    walk = made.trajectories["walk"]
    made.trajectories["walk"] = replace(walk, timestamps=np.full(200, np.nan))
    with pytest.raises(
        RequestError, match=r"millimetres: they would cover 1,194 m x 1,194 m; give"
    ):
        project_to_floor(made, FloorOptions("z"))


def test_a_camera_height_in_millimetres_is_refused_unless_the_unit_of_poses_is_stated():
    made = recording(level_cameras(random_poses(20, 1)))
    with pytest.raises(RequestError, match="camera_height 619 looks like millimetres; give metres"):
        project_to_floor(made, FloorOptions("z", camera_height=619))
    found = project_to_floor(made, FloorOptions("z", camera_height=619, metres_per_unit=1.0))
    assert found.camera_height == 619


def test_a_drive_of_kilometres_is_accepted():
    ahead = np.arange(3000.0)
    cameras = level_cameras(np.stack([ahead, 0 * ahead, 0 * ahead], 1))
    assert (
        np.ptp(project_to_floor(recording(cameras), FloorOptions("z")).poses["walk"][:, 0]) == 2999
    )


@pytest.mark.parametrize("up", ["q", "1 2", "0,0,0", "nan 0 1"])
def test_invalid_up_axis_is_refused(up):
    with pytest.raises(RequestError, match="give x, y or z"):
        parse_up(up)


@pytest.mark.parametrize(
    "options",
    [FloorOptions("z", ground=math.nan), FloorOptions("z", camera_height=-1.0),
     FloorOptions("z", metres_per_unit=0.0), FloorOptions("z", ground=1e300)],
)  # fmt: skip
def test_invalid_figures_are_refused(options):
    with pytest.raises(RequestError, match="must be a"):
        project_to_floor(recording(level_cameras(random_poses(8, 8))), options)
