"""Videos with poses: exact times, all codecs, depth of 16 bits, frames in any order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions
from tests.datasets.helpers import kinds
from tests.datasets.layouts.rooms import image
from tests.datasets.layouts.video_writer import write_video
from tests.support.refusals import refused

COUNT, HEIGHT, WIDTH = 40, 96, 128
TICKS = np.cumsum([0, *([1, 3] * COUNT)])[:COUNT]
"""Times of the frames in 0.05 s: the rate varies."""
LEVELS = 30 + 5 * np.arange(COUNT)


def write(folder: Path, codec: str = "libx264", suffix: str = ".mp4") -> Path:
    """A video that gets brighter, its camera, and poses on a line at the times of a clock."""
    path = folder / f"drive{suffix}"
    frames = [np.full((HEIGHT, WIDTH, 3), level, np.uint8) for level in LEVELS]
    write_video(path, codec, "yuv420p", frames, TICKS)
    (folder / "drive.toml").write_text("[camera]\nwidth = 128\nheight = 96\nhfov = 70.0\n")
    rows = "".join(f"{100 + 0.1 * step},{0.2 * step},1,90\n" for step in range(-1, 60))
    (folder / "drive.csv").write_text(f"timestamp,x,y,heading\n{rows}")
    return path


@pytest.mark.parametrize(
    ("codec", "suffix"),
    [("libx264", ".mp4"), ("libx265", ".mp4"), ("libsvtav1", ".mp4"), ("libvpx-vp9", ".webm")],
)
def test_frames_have_exact_times_and_interpolated_poses(tmp_path, codec, suffix):
    path = write(tmp_path, codec, suffix)
    recording = read("video", path, ReadOptions({"start": "100"}))
    (trajectory,) = recording.trajectories.values()
    times = 100 + TICKS / 20
    assert np.allclose(trajectory.timestamps, times, atol=1e-3)
    assert np.allclose(trajectory.poses[:, 0, 3], 2 * (times - 100), atol=2e-3)
    for row in (*range(COUNT), 3, 39, 0, 20):
        found = image(trajectory.frames[row].rgb.read())
        assert abs(found.pixels.mean() - LEVELS[row]) < 2.5
    assert kinds(recording) == {}


def test_depth_of_16_bits_belongs_to_the_frame_of_its_time(tmp_path):
    path = write(tmp_path)
    depths = [np.full((HEIGHT, WIDTH), 1000 + 7 * f, np.uint16) for f in range(COUNT)]
    write_video(tmp_path / "depth.mkv", "ffv1", "gray16le", depths, TICKS)
    options = {"start": "100", "depth": "depth.mkv", "every": "3"}
    (trajectory,) = read("video", path, ReadOptions(options)).trajectories.values()
    assert len(trajectory.frames) == 14
    for place, frame in enumerate(trajectory.frames):
        found = image(frame.depth.read())
        assert found.bits == 16
        assert (found.pixels == 1000 + 21 * place).all()


def test_depth_that_is_missing_or_of_8_bits_is_told(tmp_path):
    path = write(tmp_path)
    depths = [np.full((HEIGHT, WIDTH), 1000, np.uint16)] * COUNT
    write_video(tmp_path / "half.mkv", "ffv1", "gray16le", depths[::2], TICKS[::2])
    recording = read("video", path, ReadOptions({"start": "100", "depth": "half.mkv"}))
    assert kinds(recording) == {"no depth image": COUNT // 2}
    with refused(match="no video of depth, which is grey with 10 to 16 bits: yuv420p"):
        read("video", path, ReadOptions({"start": "100", "depth": path.name}))


def test_frames_without_poses_and_damage_are_reported(tmp_path):
    path = write(tmp_path)
    with (tmp_path / "drive.csv").open("a") as poses:
        poses.write("106.5,nan,1,90\n")
    recording = read("video", path, ReadOptions({"start": "103"}))
    assert kinds(recording) == {
        "bad pose": 1,
        "no pose": np.count_nonzero(103 + TICKS / 20 > 105.9),
    }
    with refused(match="no usable image"):
        read("video", path)
    path.write_bytes(path.read_bytes()[:2000])
    found = recording.trajectories["drive"].frames[5].rgb.read()
    assert isinstance(found, InputIssue)
    path.write_text("ffconcat version 1.0\nfile 'other.mp4'\n")
    with refused(match="cannot be decoded as a video"):
        read("video", path)
