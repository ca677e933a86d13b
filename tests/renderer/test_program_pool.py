"""Processes of a renderer in another language: what it wrote arrives; faults end in one line."""

import math

import cv2
import numpy as np
import pytest

from s2rtools.renderer.program import RendererError
from s2rtools.renderer.program_pool import RendererWorkers, RenderJob
from s2rtools.renderer.protocol import CameraPose, Hello, Parameter
from tests.support.perl_renderer import depth_of, perl_command, rgb_of

CAMERA = Hello(width=20, height=12, fx=10.0, fy=10.0, cx=10.0, cy=6.0, y_down=False, folder="")


@pytest.fixture(scope="module")
def perl():
    return perl_command()


def _jobs(count):
    pose = CameraPose(2.0, 3.0, 0.5, (2.0, 3.0, 1.0), (1.0, 0.0, 0.0, 0.0))
    return [RenderJob(number, pose, {"lamp": 2.0}) for number in range(count)]


def _run(perl, mode, folder, count=3, workers=1, timeout=20.0):
    """The frames by number, the failures by number, and what the renderer declared."""
    frames = {}
    with RendererWorkers([*perl, mode], CAMERA, folder, workers, timeout) as started:
        results = list(started.render(_jobs(count), frames.__setitem__))
    return frames, {r.number: r.failure for r in results if r.failure}, started.ready


@pytest.mark.parametrize("mode", ["npy", "png", "rgb"])
def test_frames_are_those_that_the_program_wrote(perl, mode, tmp_path):
    frames, failures, ready = _run(perl, mode, tmp_path, workers=2)
    assert (ready.name, ready.version, ready.depth) == ("perl", "3", mode != "rgb")
    assert ready.parameters == (Parameter("lamp", 1, 0.2, 2, "1"),)
    assert not failures
    assert sorted(frames) == [0, 1, 2]
    for frame in frames.values():
        bgr = cv2.imdecode(np.frombuffer(frame.png, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., ::-1], rgb_of(12, 20, lamp=2.0))
        if mode == "rgb":
            assert frame.depth is None
        else:
            tolerance = 0.000502 if mode == "png" else 0
            np.testing.assert_allclose(frame.depth, depth_of(12, 20, 2.0), atol=tolerance)
    assert not list((tmp_path / "worker-0").iterdir())


@pytest.mark.parametrize("mode", ["dies-once", "hangs-once"])
def test_a_program_that_stops_is_restarted(perl, mode, tmp_path):
    frames, failures, _ = _run(perl, mode, tmp_path, timeout=1.0)
    assert sorted(frames) == [0, 1, 2]
    assert not failures


def test_a_frame_that_ends_the_program_twice_fails_alone(perl, tmp_path):
    frames, failures, _ = _run(perl, "dies-at-1", tmp_path)
    assert sorted(frames) == [0, 2]
    assert "was ended by signal 9" in failures[1]


def test_a_stated_failure_is_that_of_its_frame(perl, tmp_path):
    frames, failures, _ = _run(perl, "fails-at-1", tmp_path)
    assert sorted(frames) == [0, 2]
    assert failures == {1: "inside a wall"}


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("garbage-first", "it answered 'starting ...'"),
        ("garbage", "it answered 'rendering 0'"),
        ("endless", "without a newline"),
        ("wrong-id", "with id 1, not 0"),
        ("path", "unknown field `rgb`"),
        ("outside", "0-rgb.png: was not written"),
        ("missing", "0-rgb.png: was not written"),
        ("link", "0-rgb.png: is a symbolic link"),
        ("wide", "0-rgb.png: is 21 x 12 pixels, not 20 x 12"),
        ("double", "0-depth.npy: is float64, not float32"),
        ("infinite", "0-depth.npy: holds depth that is not finite"),
        ("dies", "ended with exit code 9.*worker-0.log.; restarted 3 times without a frame"),
    ],
)
def test_a_program_with_a_fault_ends_the_run_by_one_line(perl, mode, message, tmp_path):
    with pytest.raises(RendererError, match=message) as raised:
        _run(perl, mode, tmp_path)
    assert "\n" not in str(raised.value)


def test_a_program_that_hangs_is_stopped(perl, tmp_path):
    with pytest.raises(RendererError, match=r"no answer within 0.3 s.*restarted 3 times"):
        _run(perl, "hangs", tmp_path, timeout=0.3)


def test_a_program_that_ends_at_its_start_is_not_waited_for(tmp_path):
    with pytest.raises(RendererError, match="ended with exit code 1"):
        RendererWorkers(["false"], CAMERA, tmp_path)


def test_the_rotation_of_a_pose_turns_optical_axes_into_the_world():
    half = math.sqrt(0.5)
    pose = CameraPose(0, 0, 0, (0, 0, 0), (half, 0.0, 0.0, half))
    np.testing.assert_allclose(pose.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)
