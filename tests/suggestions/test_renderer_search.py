"""`s2r suggest --renderer` on small worlds: a moved camera, and none."""

import pytest

import s2rstore
from s2rtools.suggestions.suggest import true_values


def _suggest(s2r, path, out, *arguments):
    return s2r("suggest", path, "--for", "sim", "--renderer", "world:2", "--frames", "12",
               "--out", out, *arguments)  # fmt: skip


def test_a_moved_camera_is_found_in_its_ranges(s2r, camera_world, tmp_path):
    out = tmp_path / "frames"
    found = _suggest(s2r, camera_world, out, "--json").json
    with s2rstore.open(camera_world) as store:
        truth = true_values(store, store.run("r"))
    ranges = found["ranges"]
    low, high = ranges["camera_height"]
    assert low <= truth["camera_height"] <= high < 0
    changed = {each["name"] for each in found["parameters"] if each["changed"]}
    assert changed == {"camera_height", "zoom"}
    assert found["lowered"]["low"] > 0.5
    rendered = {path.name: path.stat().st_mtime_ns for path in (out / "rgb").iterdir()}
    again = _suggest(s2r, camera_world, out, "--json").json
    assert again == found
    assert rendered == {path.name: path.stat().st_mtime_ns for path in (out / "rgb").iterdir()}


def test_nothing_is_changed_where_images_are_equal(s2r, null_world, tmp_path):
    assert "nothing helps" in _suggest(s2r, null_world, tmp_path / "frames").checked(3).out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--renderer", "world:2"], "--renderer: needs --for sim"),
        (["--for", "sim", "--renderer", "world:2", "--apply", "1"], "--apply: not with --renderer"),
        (["--for", "sim", "--out", "frames"], "--out: only with --renderer"),
    ],
)
def test_options_without_use_are_refused(s2r, tiny_store, arguments, message):
    assert message in s2r("suggest", tiny_store, *arguments).checked(2).err
