"""`s2r render`: which poses are rendered, what the folder holds, and that ingest reads it."""

import shlex

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.datasets.layouts import read
from s2rtools.simulated_frames.pose_renderer import renderer_command
from s2rtools.simulated_frames.requested_poses import poses_on_grid, random_poses
from tests.support.perl_renderer import depth_of, perl_command, rgb_of


@pytest.fixture
def render(s2r, tiny_store, tmp_path):
    """Run `s2r render` on the tiny store with the Perl renderer, into `tmp_path/out`."""

    def run(*arguments, mode="npy"):
        command = shlex.join([*perl_command(), mode])
        return s2r(
            "render", tiny_store, "--renderer", command, "--out", tmp_path / "out",
            "--frames-only", *arguments,
        )  # fmt: skip

    return run


def _rows(tmp_path):
    return (tmp_path / "out" / "frames.csv").read_text().splitlines()[1:]


@pytest.fixture
def poses(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("x_m,y_m,heading_deg\n2,3,90\n4,5,-45\n6,2,0\n")
    return path


def test_the_folder_is_a_recording_of_what_the_program_wrote(render, poses, tmp_path, tiny_store):
    printed = render("--poses", poses, "--workers", "2").printed
    assert "3 frames rendered by perl 3, 0 there before" in printed
    recording = read("csv", tmp_path / "out" / "frames.csv")
    trajectory = recording.trajectories["walk"]
    with s2rstore.open(tiny_store) as store:
        domain = store.domain("sim")
        size = store.dataset.frame_height
    assert (recording.camera.width, recording.camera.fx) == (size, domain.rgb.fx)
    np.testing.assert_allclose(trajectory.poses[:, 2, 3], domain.camera_height)
    for frame, x in zip(trajectory.frames, (2, 4, 6), strict=True):
        np.testing.assert_array_equal(frame.rgb.read().pixels, rgb_of(size, size))
        raw = frame.depth.read().pixels
        metres = depth_of(size, size, x)
        metres[metres > domain.depth_raw_max * domain.depth_scale] = 0
        np.testing.assert_allclose(raw * domain.depth_scale, metres, atol=0.51 * domain.depth_scale)


def test_a_rerun_renders_what_is_missing(render, poses, tmp_path):
    render("--poses", poses).checked()
    gone = sorted((tmp_path / "out" / "rgb").iterdir())[0]
    gone.unlink()
    assert "1 frame rendered by perl 3, 2 there before" in render("--poses", poses).printed
    assert len(_rows(tmp_path)) == 3
    again = render("--poses", poses, "--set", "lamp=0.5").printed
    assert "3 frames rendered by perl 3, 0 there before" in again
    assert len(_rows(tmp_path)) == 6
    assert gone.exists()


def test_frames_that_fail_are_reported_and_rendered_by_the_next_run(render, poses):
    result = render("--poses", poses, mode="fails-at-1").checked(1)
    assert "1 frame failed; the first: pose 2: inside a wall" in result.err
    assert "2 frames rendered" in result.out
    assert "1 frame rendered by perl 3, 2 there before" in render("--poses", poses).printed


def test_frames_so_far_stay_where_the_program_breaks(render, poses, tmp_path):
    assert "restarted 3 times" in render("--poses", poses, mode="dies").checked(2).err
    render("--random", "2").checked()
    assert "broke the protocol" in render("--poses", poses, mode="wide").checked(2).err
    assert len(read("csv", tmp_path / "out" / "frames.csv").trajectories["random-0"].frames) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "lamp=3"], "--set lamp=3: must be 0.2 to 2"),
        (["--set", "lamp=x"], "--set lamp=x: must be a number"),
        (["--set", "fog=1"], "--set fog=1: expected NAME=VALUE with NAME one of lamp"),
        (["--workers", "0"], "--workers 0: must be 1 to 64"),
        (["--timeout", "nan"], "--timeout nan"),
        (["--domain", "nowhere"], "nowhere"),
    ],
)
def test_wrong_options_are_refused(render, poses, arguments, message):
    assert message in render("--poses", poses, *arguments).checked(2).err


def test_a_folder_of_other_files_is_not_used(render, poses, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("")
    assert "holds other files" in render("--poses", poses).checked(2).err


def test_grid_and_random_poses_lie_on_free_floor(tiny_store):
    with s2rstore.open(tiny_store) as store:
        grid = poses_on_grid(store, 0.5, 4).poses
        drawn = random_poses(store, 50, 7).poses
        np.testing.assert_array_equal(random_poses(store, 20, 7).poses, drawn[:20])
        recorded = store.poses("sim")[:, :2]
    assert len(np.unique(grid[:, 2])) == 4
    poses = np.concatenate([grid, drawn])
    assert np.linalg.norm(poses[:, None, :2] - recorded, axis=2).min(axis=1).max() <= 0.6


def test_a_renderer_without_depth_gives_a_recording_without_depth(render, poses, tmp_path):
    render("--poses", poses, mode="rgb").checked()
    frames = read("csv", tmp_path / "out" / "frames.csv").trajectories["walk"].frames
    assert [frame.depth for frame in frames] == [None] * 3
    assert "frames of other cameras" in render("--poses", poses).checked(2).err


@pytest.mark.parametrize(
    ("text", "message"),
    [("", "names no program"), ("a 'b", "quotation"), ("no-such-program", "there is no program")],
)
def test_commands_that_name_no_program_are_refused(text, message):
    with pytest.raises(RequestError, match=message):
        renderer_command(text)


def test_renderers_that_ship_have_short_names():
    words = renderer_command("mesh:'my scan.glb' --points places.csv")
    assert words[-4:] == ["s2rtools.renderer.mesh", "my scan.glb", "--points", "places.csv"]
    assert renderer_command("world:3")[-3:] == ["s2rtools.renderer.world", "--seed", "3"]
