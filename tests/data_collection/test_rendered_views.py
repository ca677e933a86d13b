"""Candidates that a renderer program shows: their sim errors, and views that are not used."""

import json
import shlex

import numpy as np
import pytest

import s2rstore
from s2rtools.data_collection.candidates import CandidatePoses
from s2rtools.data_collection.rendered_views import CandidateRenderer, render_views
from s2rtools.simulated_frames.pose_renderer import renderer_command
from tests.support.perl_renderer import perl_command


@pytest.mark.parametrize("run", ["zero", "up"])
def test_errors_at_stored_poses_are_those_of_the_run(moved_camera_store, tmp_path, run):
    with s2rstore.open(moved_camera_store) as store:
        poses, count = store.poses("sim"), len(store.instances)
        usable = np.ones((count, count), dtype=bool)
        candidates = CandidatePoses(
            poses[:, :2], poses[:, 2], usable, np.zeros(count, np.int32), "stored"
        )
        renderer = CandidateRenderer(renderer_command("world:1"), tmp_path / "frames", 1, 120.0)
        cells = np.arange(count) * (count + 1)
        views = render_views(store, store.run(run), renderer, candidates, cells, None)
        expected = store.run_columns(run).sim.error
    np.testing.assert_allclose(
        views.sim_errors[views.usable], expected[views.usable], rtol=0.02, atol=0.02
    )
    assert views.usable.sum() > count // 2


def test_a_pose_that_the_program_cannot_render_is_not_proposed(moved_camera_store, s2r, tmp_path):
    command = shlex.join([*perl_command(), "fails-at-1"])
    arguments = ["collect", moved_camera_store, "--run", "zero", "--budget", "3", "--json",
                 "--renderer", command, "--frames", tmp_path / "frames"]  # fmt: skip
    found = json.loads(s2r(*arguments).checked().out)
    assert found["rendered"]["failed"] == 1
    assert len(found["poses"]) == 3
    printed = s2r(*arguments[:-5], *arguments[-4:]).printed
    assert (
        "11 usable views of 12 candidates; 0 show a near wall, 1 failed; the first: in" in printed
    )


def test_a_renderer_lacks_depth_that_the_model_takes(moved_camera_store, s2r, tmp_path):
    command = shlex.join([*perl_command(), "rgb"])
    arguments = ["collect", moved_camera_store, "--run", "zero", "--renderer", command]
    refused = s2r(*arguments, "--frames", tmp_path / "frames").checked(2)
    assert "renderer perl: renders no depth, which the model of run zero takes" in refused.err
