"""The live model gives the results of precompute and computes only what has changed."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.adjustments import make_chain, parse_adjustment
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.interactive import LiveModel, LiveResult
from s2rtools.precompute.pipeline import precompute
from s2rtools.precompute.run_registration import add_run
from s2rtui.session.heatmaps import heatmap_choices, instance_grid, without_blanks
from s2rtui.session.model_input import model_input
from s2rtui.session.state import HeatChoice
from tests.conftest import BuildOnce
from tests.support.silent_reporter import SilentReporter
from tests.support.small_stores import build_small

N = 4
"""Instances of the store; occlusion takes long."""
CHAINS = {
    "sim": make_chain("sim", {"temperature": -0.3}),
    "real": make_chain("real", {"brightness": 1.3, "contrast": 0.8, "depth_blur": 1.5}),
}


@pytest.fixture(scope="module")
def adjusted(build_once: BuildOnce) -> Iterator[Store]:
    """A store with a computed run `adjusted` with all heatmaps and an uncomputed run."""
    with s2rstore.open(build_once("live.s2r", _compute)) as store:
        yield store


def _compute(path: Path) -> None:
    build_small(path, N)
    add_run(path, "adjusted", "vanilla", None, None, CHAINS)
    precompute(path, SilentReporter(), ["adjusted"])


@pytest.fixture
def live(adjusted: Store) -> Iterator[LiveModel]:
    model = LiveModel(adjusted, "vanilla")
    yield model
    model.close()


def assert_equals_stored(store: Store, run: str, result: LiveResult, live: LiveModel) -> None:
    columns, iid = store.run_columns(run), result.iid
    for side in SIDES:
        shown, stored = result.side(side), columns.side(side)
        for name in ("x", "y", "error"):
            assert getattr(shown, name) == pytest.approx(getattr(stored, name)[iid], abs=1e-4)
        assert angles.distance(shown.heading, stored.heading[iid]) < 1e-4
        assert shown.heading_error == pytest.approx(stored.heading_error[iid], abs=1e-4)
        image = model_input(store, store.run(run), side, iid)
        assert (image.rgb == shown.rgb).all()
        np.testing.assert_array_equal(image.depth, shown.depth)
        for kind, mode in heatmap_choices(store, run):
            live_heat = result.heatmap(kind, side, mode)
            stored_heat = store.heatmap(run, kind, side, iid, mode)
            assert live_heat.shape == stored_heat.shape
            np.testing.assert_allclose(
                live_heat, stored_heat, atol=2e-3 * np.nanmax(np.abs(stored_heat))
            )
            choice = HeatChoice(kind, mode, side)
            grid = without_blanks(live.floor_grid(result, kind, side, mode), choice, "mean")
            stored_grid = instance_grid(store, run, choice, iid)
            assert (np.isnan(grid) == np.isnan(stored_grid)).all()
            np.testing.assert_allclose(
                grid, stored_grid, atol=2e-3 * np.nanmax(np.abs(stored_heat))
            )


@pytest.mark.parametrize("iid", [0, N - 1])
def test_results_equal_precompute(adjusted, live, iid):
    assert set(live.kinds) == set(HEATMAP_KINDS)
    assert set(live.kinds[-3:]) == {"occlusion", "harm", "harm_fine"}
    result = live.compute(iid, CHAINS, live.kinds)
    assert_equals_stored(adjusted, "adjusted", result, live)
    assert (
        result.heatmap("activation", "sim") == result.heatmap("activation", "sim", "loss")
    ).all()


@pytest.mark.parametrize("run", ["up", "low", "vanilla"])
def test_results_with_moved_cameras_equal_precompute(moved_camera_store, run):
    with s2rstore.open(moved_camera_store) as store:
        live = LiveModel(store, "vanilla")
        chains = {side: store.run(run).adjustments(side) for side in SIDES}
        kinds = ("feature_distance", "pixel_difference", "harmonised_distance")
        for iid in (1, 6):
            result = live.compute(iid, chains, kinds)
            assert result is not None
            assert_equals_stored(store, run, result, live)
        live.close()


def test_the_adjustments_of_the_run_are_the_default(adjusted):
    live = LiveModel(adjusted, "adjusted")
    default, explicit = live.compute(1, {}), live.compute(1, CHAINS)
    assert default.real is explicit.real
    unadjusted = live.compute(1, {"sim": [], "real": []})
    assert unadjusted.real.x != default.real.x
    live.close()


def test_the_prediction_is_given_before_the_heatmaps(live):
    results = list(live.steps(3, CHAINS, ("feature_distance", "pixel_difference")))
    assert [len(result.heat) for result in results] == [0, 2, 6]
    assert all(result.real is results[0].real for result in results)


def test_only_what_changed_is_computed(live, monkeypatch):
    passes: list[int] = []
    forward = live._backend.forward_all
    monkeypatch.setattr(
        live._backend, "forward_all", lambda x: (passes.append(len(x)), forward(x))[1]
    )
    reads: list[int] = []
    read_frames = live._store.frames
    monkeypatch.setattr(live._store, "frames", lambda *a: (reads.append(1), read_frames(*a))[1])
    live.compute(2, {"sim": [], "real": []})
    assert (len(passes), len(reads)) == (2, 2)
    for value in (1.1, 1.2, 1.1):
        live.compute(2, {"sim": [], "real": make_chain("real", {"brightness": value})})
    assert (len(passes), len(reads)) == (4, 2)
    live.compute(3, {"sim": [], "real": []})
    assert (len(passes), len(reads)) == (6, 4)


@pytest.mark.parametrize("after", [0, 1, 2, 3])
def test_cancelled_computations_give_no_more_results(live, after):
    answers = iter([False] * after)

    def cancelled() -> bool:
        return next(answers, True)

    kinds = ("feature_distance",)
    results = list(
        live.steps(0, {"real": parse_adjustment("real:black")["real"]}, kinds, cancelled)
    )
    assert len(results) == max(0, after - 2)
    answers = iter([False] * after)
    assert live.compute(0, {}, kinds, cancelled) is None


def test_invalid_requests_list_the_valid_values(live):
    with pytest.raises(RequestError, match=r"instance 4: the store holds 0 \.\. 3"):
        live.compute(N, {})
    with pytest.raises(RequestError, match="one of activation"):
        live.compute(1, {}, ("glow",))
    with pytest.raises(RequestError, match="taken, not rendered"):
        live.compute(1, {"sim": make_chain("sim", {"camera_pitch": 2})})
    unadjusted = live.compute(1, {"sim": make_chain("sim", {"camera_pitch": 0})})
    assert unadjusted is not None
    with pytest.raises(RequestError, match="not computed for these"):
        unadjusted.heatmap("occlusion", "sim")


def test_the_store_of_the_caller_may_be_closed(adjusted):
    with s2rstore.open(adjusted.path) as opened:
        live = LiveModel(opened, "vanilla")
    assert live.compute(2, CHAINS, ("activation",)) is not None
    live.close()
