"""The slider view has complete labels and units; the shares view shows means of a selection."""

from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.intervals import Interval
from s2rstore.metrics.gap_shares import FactorShare, GapShares, mean_shares
from s2rstore.records import GAP_FACTORS
from s2rtools.adjustments import ADJUSTMENTS
from s2rtui.charts.adjust import VIEW as ADJUST
from s2rtui.charts.adjust import sliders_drawing
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.charts.shares import SharesModel, shares_scale
from s2rtui.drawing.cells import drawing_panels
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust, Slider

SLIDERS = tuple(
    Slider("real", one.name, one.lowest, one.highest, one.neutral, one.step, one.unit)
    for one in ADJUSTMENTS.values()
)
SLIDING = sliders_drawing(SLIDERS, [one.lowest + one.step for one in ADJUSTMENTS.values()], 2)


@pytest.mark.parametrize("width", [20, 30, 46])
def test_narrow_sliders_keep_their_track(width):
    panels = drawing_panels(SLIDING, (width, 4))
    assert len(panels) == 4
    assert all(panel.width >= 4 for panel in panels)
    assert "2" in {panel.name for panel in panels}


def test_clicks_on_the_outer_cells_of_a_strip_set_the_ends_of_its_slider(tiny_store):
    panel, slider = drawing_panels(SLIDING, (80, len(SLIDERS)))[0], SLIDERS[0]
    session = Session(tiny_store)
    state = replace(session.state, adjust=Adjust("vanilla", sliders=SLIDERS))
    scene, values = Scene(session.store, state, LoadedData()), []
    session.dispatch = lambda _, number, value: values.append(value)
    for column in (panel.x, panel.x + panel.width - 1):
        ADJUST.click(session, scene, panel, panel.to_data(column + 0.5, panel.y + 0.5))
    session.close()
    assert values == pytest.approx([slider.lowest, slider.highest])


def test_bounds_far_beyond_the_means_do_not_squeeze_the_bars():
    wide = FactorShare("lighting", Interval(-50.0, 2.0, 50.0))
    means = {"lighting": 2.0, "depth": 0.0, "objects": 0.0, "sensor and camera": 0.0}
    scale = shares_scale(SharesModel(GapShares(6, 2.0, (wide,)), means))
    assert (scale.low, scale.high) == (-1.0, 3.0)


def test_means_sum_to_the_mean_gap_and_leave_out_pairs_far_apart(tiny_store):
    with s2rstore.open(tiny_store) as store:
        columns = store.run_columns("vanilla")
        chosen = np.arange(len(store.instances)) % 3 == 0
        found = mean_shares(store, "vanilla", chosen)
        assert found is not None
        assert found.n == chosen.sum()
        assert found.gap == pytest.approx(columns.gap[chosen].mean(), abs=1e-5)
        assert sum(share.mean.value for share in found.shares) == pytest.approx(found.gap)
        parts = np.stack([getattr(columns.real, f"share_{name}") for name in GAP_FACTORS])
        assert np.allclose(parts.sum(axis=0), columns.gap, atol=1e-5)
        assert mean_shares(store, "vanilla", np.zeros_like(chosen)) is None


def test_pairs_far_apart_are_left_out_and_counted(tiny_store):
    with s2rstore.open(tiny_store) as store:
        chosen = np.ones(len(store.instances), dtype=np.bool_)
        assert store.comparable_pairs.all()
        store.comparable_pairs = np.arange(len(chosen)) >= 15
        found = mean_shares(store, "vanilla", chosen)
        assert found is not None
        assert (found.n, found.apart) == (len(chosen) - 15, 15)
        assert found.gap == pytest.approx(store.run_columns("vanilla").gap[15:].mean(), abs=1e-5)
    counted = SharesModel(found, {}).counted
    assert f"n {found.n} (too few); 15 pairs too far apart left out" in counted
