import itertools
import json
from pathlib import Path

import duckdb
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions, Recording
from tests.datasets.helpers import kinds
from tests.datasets.layouts.bag_writer import png
from tests.datasets.layouts.rooms import assert_poses, image
from tests.datasets.layouts.video_writer import write_video
from tests.support.refusals import refused

LENGTHS = (7, 12, 9)
STEP = 8
"""Grey levels from one frame to the next, more than the codec changes."""
HEIGHT, WIDTH = 48, 64
KEY = "observation.images.front"
DEPTH = f"{KEY}_depth"
OPTIONS = {"pose": "x,y,theta", "camera": "50,50,31.5,23.5", "height": "0.4"}


def states() -> np.ndarray:
    """x, y, heading of all frames, and a fourth entry that is no pose."""
    count = np.arange(sum(LENGTHS))
    columns = [0.1 * count, 1 - 0.05 * count, 0.3 * count - 2, 0 * count + 99]
    return np.column_stack(columns).astype(np.float32)


def level(frame: int) -> int:
    return 20 + STEP * (frame % 28)


def truth(rows: slice) -> np.ndarray:
    """Camera poses: the image's x axis is to the robot's right, its z axis forward."""
    x, y, heading, _ = states().astype(np.float64)[rows].T
    cos, sin, zero = np.cos(heading), np.sin(heading), 0 * x
    upper = [sin, zero, cos, x, -cos, zero, sin, y, zero, zero - 1, zero, zero + 0.4]
    return np.stack([*upper, zero, zero, zero, zero + 1], axis=1).reshape(-1, 4, 4)


def write_frames(path: Path, frames: range) -> None:
    images = [np.full((HEIGHT, WIDTH, 3), level(frame), np.uint8) for frame in frames]
    write_video(path, "libx264", "yuv420p", images)


def write_table(path: Path, columns: str, rows: list[tuple]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with duckdb.connect() as connection:
        connection.execute(f"CREATE TABLE t ({columns})")
        marks = ", ".join("?" * len(rows[0]))
        connection.executemany(f"INSERT INTO t VALUES ({marks})", rows)
        connection.execute(f"COPY t TO '{path}' (FORMAT parquet)")


def spans() -> list[range]:
    ends = np.cumsum([0, *LENGTHS]).tolist()
    return [range(start, end) for start, end in itertools.pairwise(ends)]


def data_rows(episode: int, frames: range, images: bool) -> list[tuple]:
    rows = []
    for number, frame in enumerate(frames):
        row: tuple = (states()[frame].tolist(), number / 10, number, episode, frame)
        if images:
            pixels = np.full((HEIGHT, WIDTH, 3), level(frame), np.uint8)
            row += ({"bytes": png(pixels), "path": f"{frame}.png"},)
        rows.append(row)
    return rows


def write(folder: Path, version: str, images: bool = False, **changes) -> None:
    columns = (
        '"observation.state" FLOAT[4], timestamp FLOAT, frame_index BIGINT, '
        "episode_index BIGINT, index BIGINT"
    )
    if images:
        columns += f', "{KEY}" STRUCT(bytes BLOB, path VARCHAR)'
    info = {
        "codebase_version": version,
        "robot_type": "cart",
        "total_episodes": len(LENGTHS),
        "chunks_size": 2,
        "fps": 10,
        "features": {
            "observation.state": {
                "dtype": "float32",
                "shape": [4],
                "names": {"motors": ["x", "y", "theta", "gripper"]},
            },
            KEY: {
                "dtype": "image" if images else "video",
                "shape": [HEIGHT, WIDTH, 3],
                "names": ["height", "width", "channels"],
                "info": {"video.codec": "mpeg4", "video.is_depth_map": False},
            },
        },
    }
    if version.startswith("v2"):
        info |= {
            "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
            "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/"
            "episode_{episode_index:06d}.mp4",
        }
        for number, frames in enumerate(spans()):
            place = f"chunk-{number // 2:03d}"
            name = f"episode_{number:06d}"
            rows = data_rows(number, frames, images)
            write_table(folder / f"data/{place}/{name}.parquet", columns, rows)
            if not images:
                write_frames(folder / f"videos/{place}/{KEY}/{name}.mp4", frames)
    else:
        info |= {
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        }
        names = ("chunk_index", "file_index", "from_timestamp")
        columns_of_episodes = (
            'episode_index BIGINT, "data/chunk_index" BIGINT, "data/file_index" BIGINT, '
            + ", ".join(f'"videos/{key}/{name}" DOUBLE' for key in (KEY, DEPTH) for name in names)
        )
        rows = [
            (number, 0, 0, *(0.0, float(number // 2), (0.0, 0.7, 0.0)[number]) * 2)
            for number in range(len(LENGTHS))
        ]
        write_table(folder / "meta/episodes/chunk-000/file-000.parquet", columns_of_episodes, rows)
        all_rows = [
            row
            for number, frames in enumerate(spans())
            for row in data_rows(number, frames, images)
        ]
        write_table(folder / "data/chunk-000/file-000.parquet", columns, all_rows)
        if not images:
            _, second, third = spans()
            write_frames(folder / f"videos/{KEY}/chunk-000/file-000.mp4", range(second.stop))
            write_frames(folder / f"videos/{KEY}/chunk-000/file-001.mp4", third)
    (folder / "meta").mkdir(exist_ok=True)
    (folder / "meta/info.json").write_text(json.dumps(info | changes))


def assert_frames(recording: Recording, order: int = 1) -> None:
    for number, frames in enumerate(spans()):
        name = f"episode_{number:06d}"
        assert_poses(recording, truth(slice(frames.start, frames.stop)), name)
        trajectory = recording.trajectories[name]
        np.testing.assert_allclose(trajectory.timestamps, np.arange(len(frames)) / 10, atol=1e-6)
        for row in list(range(len(frames)))[::order]:
            found = image(trajectory.frames[row].rgb.read())
            assert found.pixels.shape == (HEIGHT, WIDTH, 3)
            assert abs(found.pixels.mean() - level(frames[row])) < STEP / 2
            assert trajectory.frames[row].rgb.checksum() == found.sha256
            assert trajectory.frames[row].depth is None


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
@pytest.mark.parametrize("images", [False, True])
def test_poses_and_images_are_those_that_were_written(tmp_path, version, images):
    write(tmp_path, version, images)
    recording = read("lerobot", tmp_path, ReadOptions(OPTIONS))
    assert list(recording.trajectories) == [f"episode_{n:06d}" for n in range(len(LENGTHS))]
    assert_frames(recording)
    assert_frames(recording, order=-1)
    assert recording.camera.cx == 32.0
    assert recording.up == (0.0, 0.0, 1.0)
    assert kinds(recording) == {}


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_depth_of_a_video_is_that_of_its_codes(tmp_path, version):
    write(tmp_path, version)
    info = json.loads((tmp_path / "meta/info.json").read_text())
    limits = {"depth_min": 0.5, "depth_max": 8.5, "shift": 3.5, "use_log": True}
    facts = {"is_depth_map": True} | {f"video.{name}": value for name, value in limits.items()}
    info["features"][DEPTH] = {"dtype": "video", "shape": [24, 32, 1], "info": facts}
    (tmp_path / "meta/info.json").write_text(json.dumps(info))
    for video in sorted((tmp_path / "videos").rglob("*.mp4")):
        codes = [np.tile(np.arange(32, dtype=np.uint16) * n, (24, 1)) for n in range(114, 133)]
        path = Path(str(video).replace(KEY, DEPTH))
        write_video(path, "libx265", "gray12le", codes, **{"x265-params": "lossless=1"})
    options = OPTIONS | {"depth_camera": "25,25,15.5,11.5"}
    trajectory = read("lerobot", tmp_path, ReadOptions(options)).trajectories["episode_000001"]
    found = image(trajectory.frames[3].depth.read())
    code = np.arange(32) * (117 + (LENGTHS[0] if version == "v3.0" else 0))
    metres = 4 * (12 / 4) ** (code / 4095) - 3.5
    assert np.abs(found.pixels - 1000 * np.where(code, metres, 0)).max() <= 0.5


def test_a_pose_of_six_degrees_of_freedom_is_that_of_the_camera(tmp_path):
    write(tmp_path, "v2.1", images=True)
    path = tmp_path / "data/chunk-000/episode_000000.parquet"
    rotation = Rotation.from_rotvec([0.3, -0.2, 1.0])
    state = [1.0, 2.0, 3.0, *rotation.as_quat().tolist()]
    columns = (
        '"observation.state" FLOAT[], timestamp FLOAT, frame_index BIGINT, '
        f'episode_index BIGINT, "{KEY}" STRUCT(bytes BLOB, path VARCHAR)'
    )
    picture = {"bytes": png(np.zeros((HEIGHT, WIDTH, 3), np.uint8)), "path": ""}
    bad = [*state[:6], float("nan")]
    write_table(path, columns, [(state, 0.0, 0, 0, picture), (bad, 0.1, 1, 0, picture)])
    info = json.loads((tmp_path / "meta/info.json").read_text())
    info["features"]["observation.state"] |= {"shape": [7], "names": None}
    (tmp_path / "meta/info.json").write_text(json.dumps(info))
    options = OPTIONS | {"pose": "0,1,2,3,4,5,6"}
    recording = read("lerobot", tmp_path, ReadOptions(options, ("episode_000000",)))
    expected = np.eye(4)
    expected[:3, :3], expected[:3, 3] = rotation.as_matrix(), (1, 2, 3)
    assert_poses(recording, expected[None])
    assert recording.up is None
    assert kinds(recording) == {"bad pose": 1}


def test_times_that_are_not_finite_are_reported_as_unknown(tmp_path):
    write(tmp_path, "v2.1", images=True)
    path = tmp_path / "data/chunk-000/episode_000000.parquet"
    with duckdb.connect() as connection:
        change = "REPLACE (CASE WHEN frame_index > 4 THEN 'inf' ELSE timestamp END AS timestamp)"
        connection.execute(f"CREATE TABLE t AS SELECT * {change} FROM '{path}'")
        connection.execute(f"COPY t TO '{path}' (FORMAT parquet)")
    recording = read("lerobot", tmp_path, ReadOptions(OPTIONS, ("episode_000000",)))
    known = np.isfinite(recording.trajectories["episode_000000"].timestamps)
    assert known.tolist() == [True] * 5 + [False] * 2
    assert kinds(recording) == {"bad time": 1}


def test_without_a_height_the_report_says_so(tmp_path):
    write(tmp_path, "v2.1", images=True)
    options = {key: value for key, value in OPTIONS.items() if key != "height"}
    recording = read("lerobot", tmp_path, ReadOptions(options))
    assert kinds(recording) == {"height unknown": 1}
    assert recording.trajectories["episode_000000"].poses[0, 2, 3] == 0


@pytest.mark.parametrize(
    ("options", "changes", "message"),
    [
        ({"pose": ""}, {}, r"no entry '' in observation.state \(has: x, y, theta, gripper\)"),
        ({"pose": "x,y"}, {}, "name x,y,heading or x,y,z,qx,qy,qz,qw"),
        ({"rgb": "observation.depth"}, {}, "no images rgb=observation.depth"),
        ({"camera": "50,50,31,23,20,20"}, {}, "images are 64x48, unlike the option camera"),
        ({}, {"codebase_version": "v1.6"}, "version 'v1.6'; versions 2 and 3 are read"),
        ({}, {"features": {}}, "0 cameras; choose one with rgb="),
        ({}, {"data_path": "data/{x}.parquet"}, r"unknown field '\{x\}'"),
        ({}, {"data_path": "../{episode_index}.parquet"}, r"without `\.\.`"),
        ({}, {"data_path": "data/none-{episode_index}"}, "data/none-0: cannot be read"),
        ({}, {"data_path": ""}, r"info\.json: data_path and video_path must not be empty"),
        ({}, {"data_path": "a\0b"}, "is not a file name"),
        ({}, {"fps": 0}, "chunks_size and fps must be positive"),
        ({}, {"total_episodes": 0}, "no episodes in it"),
        ({}, {"total_episodes": 10**9}, "1000000000 episodes; at most"),
    ],
)
def test_what_cannot_be_read_ends_in_one_line(tmp_path, options, changes, message):
    write(tmp_path, "v2.1", images=True, **changes)
    with refused(match=message):
        read("lerobot", tmp_path, ReadOptions(OPTIONS | options))


def test_missing_options_and_videos_that_cannot_be_decoded_are_named(tmp_path):
    write(tmp_path, "v2.1")
    with pytest.raises(RequestError, match=r"name the entries of observation.state, pose=x,y,the"):
        read("lerobot", tmp_path, ReadOptions({"camera": "50,50,31.5,23.5"}))
    with pytest.raises(RequestError, match=r"no intrinsics; set camera=fx,fy,cx,cy"):
        read("lerobot", tmp_path, ReadOptions({"pose": "x,y,theta"}))
    video = tmp_path / f"videos/chunk-000/{KEY}/episode_000000.mp4"
    video.write_bytes(b"\0\0\0\x20ftypisom" + bytes(100))
    with pytest.raises(RequestError, match=r"the videos are in mpeg4, convert them to H\.264"):
        read("lerobot", tmp_path, ReadOptions(OPTIONS))
