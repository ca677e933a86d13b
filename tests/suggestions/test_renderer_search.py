"""`s2r suggest --renderer` on small worlds: a renderer whose camera and depth noise are wrong."""

import shlex
import sys

import pytest

import s2rstore
from s2rtools.suggestions.suggest import true_values

_PROGRAM = """
import numpy as np
from s2rtools.renderer import Parameter, serve
from s2rtools.renderer.world import PARAMETERS, world_renderer

world, defaults = world_renderer(2), {each.name: each.default for each in PARAMETERS}


def render(pose, camera, values):
    rgb, depth = world(pose, camera, defaults | values)
    errors = np.random.default_rng(1).standard_normal(depth.shape)
    return rgb, np.where(depth > 0, np.maximum(depth * (1 + values["noise"] * errors), 0.01), 0)


chosen = [each for each in PARAMETERS if each.name in ("lamp_power", "camera_height", "zoom")]
serve(render, "test", parameters=[*chosen, Parameter("noise", NOISE, 0.0, 0.1)])
"""


@pytest.fixture
def suggest(s2r, tmp_path):
    """Run the command with a renderer whose default depth noise is given."""

    def run(path, noise, *arguments):
        program = tmp_path / "program.py"
        program.write_text(_PROGRAM.replace("NOISE", str(noise)))
        return s2r("suggest", path, "--for", "sim", "--renderer",
                   shlex.join([sys.executable, str(program)]), "--frames", "8",
                   "--out", tmp_path / "frames", *arguments)  # fmt: skip

    return run


@pytest.mark.deep
def test_what_differs_is_found_in_its_range(suggest, camera_world, tmp_path):
    found = suggest(camera_world, 0.03, "--json").json
    with s2rstore.open(camera_world) as store:
        truth = true_values(store, store.run("r"))
    low, high = found["ranges"]["camera_height"]
    assert low <= truth["camera_height"] <= high < 0
    assert found["ranges"]["noise"][0] == 0
    changed = {each["name"] for each in found["parameters"] if each["changed"]}
    assert changed == {"camera_height", "zoom", "noise"}
    assert found["lowered"]["low"] > 0.5
    rendered = {path: path.stat().st_mtime_ns for path in tmp_path.glob("frames/rgb/*")}
    assert suggest(camera_world, 0.03, "--json").json == found
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("frames/rgb/*")} == rendered


def test_nothing_is_changed_where_images_are_equal(suggest, null_world):
    assert "nothing helps" in suggest(null_world, 0.0).checked(3).out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--renderer", "world:2"], "--renderer: needs --for sim"),
        (["--for", "sim", "--renderer", "world:2", "--apply", "1"], "--apply: not with --renderer"),
        (["--for", "sim", "--out", "frames"], "--out: only with --renderer"),
        (["--workers", "0"], "--workers: only with --renderer"),
    ],
)
def test_options_without_use_are_refused(s2r, tiny_store, arguments, message):
    assert message in s2r("suggest", tiny_store, *arguments).checked(2).err
