"""The instance view shows the images as the model received them, or labels them otherwise."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtools.adjustments import parse_adjustment
from s2rtools.precompute.run_registration import add_run
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.session.model_input import ModelInput, model_input
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def store(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A store with runs whose images are adjusted."""
    path = copy_store(tiny_store, tmp_path_factory.mktemp("adjusted") / "s.s2r")
    chains = {"bright": "brightness=1.5", "dark": "black", "many": "brightness=1.5,contrast=0.5"}
    for name, chain in chains.items():
        add_run(path, name, "vanilla", None, None, parse_adjustment(f"real:{chain}"))
    with s2rstore.open(path) as opened:
        yield opened


def shown(store: Store, name: str, side: Side = "real") -> ModelInput:
    return model_input(store, store.runs[name], side, 4)


def test_images_are_adjusted_and_chains_are_named(store):
    plain, bright = (shown(store, name) for name in ("vanilla", "bright"))
    np.testing.assert_array_equal(bright.rgb, np.clip(np.rint(plain.rgb * 1.5), 0, 255))
    np.testing.assert_array_equal(bright.depth, plain.depth)
    assert (plain.title, bright.title) == ("", "real, brightness=1.5")
    assert shown(store, "bright", "sim").title == ""
    dark = shown(store, "dark")
    assert np.isnan(dark.depth).all()
    assert not dark.rgb.any()
    long_chain = shown(store, "many")
    assert long_chain.title == "real, adjusted"
    assert long_chain.notes == (("real images", "brightness=1.5, contrast=0.5"),)


def test_without_the_tools_the_stored_image_is_labelled_unadjusted(store, monkeypatch):
    plain = shown(store, "vanilla")
    monkeypatch.setitem(sys.modules, "s2rtools.adjustments", None)
    bright, long_chain = (shown(store, name) for name in ("bright", "many"))
    np.testing.assert_array_equal(bright.rgb, plain.rgb)
    assert bright.title == "real, before brightness=1.5"
    assert long_chain.title == "real, before adjustments"


def test_the_instance_view_shows_the_moved_camera(moved_camera_store):
    with s2rstore.open(moved_camera_store) as store:
        up, plain = (instance_input(store, name, 2, None) for name in ("up", "vanilla"))
        assert (up.sim.rgb != plain.sim.rgb).mean() > 0.5
        assert (up.real.rgb == plain.real.rgb).all()
        assert up.sim.title == "sim, adjusted"
        notes = dict(up.notes)
        assert notes["sim camera"] == "height=0.1, pitch=-5, fov=6"
        assert notes["sim images"] == "brightness=1.2"
        assert not any("real" in name for name in notes)
