"""Stores without frames, and paths that are not stores."""

import shutil
from pathlib import Path

import pytest

import s2rstore
from s2rtui.app.pilot import snapshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.export.report import worst_instances


@pytest.fixture
def store_without_frames(store_copy: Path) -> Path:
    """A store whose frames were deleted."""
    shutil.rmtree(store_copy / "frames.zarr")
    return store_copy


def test_an_instance_without_frames_shows_its_numbers_alone(store_without_frames, s2r, tmp_path):
    rows = {
        row["what"]: row
        for row in s2r("show", store_without_frames, "instance", "--iid", "5", "--json").json
    }
    with s2rstore.open(store_without_frames) as store:
        assert rows["truth"]["x_m"] == pytest.approx(float(store.instances.x[5]))
        assert rows["real"]["error_m"] == pytest.approx(
            float(store.run_columns("vanilla").real.error[5])
        )
    assert rows["real frames"]["note"] == "no real images in this store"
    assert (
        "Instance 5"
        in s2r("show", store_without_frames, "instance", "--iid", "5", "--words").printed
    )
    out = tmp_path / "x.png"
    s2r("export", store_without_frames, "--view", "instance", "--out", out).assert_refused(
        "no frames"
    )
    assert not out.exists()
    with s2rstore.open(store_without_frames) as store:
        images = worst_instances._images(instance_input(store, "vanilla", 5, None))
    assert images == []


@pytest.mark.parametrize("size", [(40, 12), (120, 40)])
@pytest.mark.parametrize("missing", ["both", "sim"])
def test_the_application_starts_without_frames(store_copy, size, missing):
    for domain in ("sim", "real"):
        if missing in (domain, "both"):
            shutil.rmtree(store_copy / "frames.zarr" / domain)
    text = snapshot(store_copy, size, ["3"], RenderOptions()).text
    assert "no such array" not in text
    if size[1] >= 24:
        assert "err m" in text


@pytest.mark.parametrize("command", [["tui"], [], ["show"], ["runs"]])
def test_a_plain_file_is_rejected_as_a_store(tmp_path, command, s2r, monkeypatch):
    monkeypatch.setattr("s2rtui.terminal.capabilities.refuse_unusable", lambda: None)
    path = tmp_path / "notes.txt"
    path.write_text("nothing")
    s2r(*command, path, *(["map"] if command == ["show"] else [])).assert_refused(
        f"{path}: not a store (a file, no folder)"
    )
