"""The harm maps sum to what changed content costs, and lie where it is."""

import numpy as np
import pytest

from s2rstore.geometry.camera_offset import RigOffset
from s2rtools.counterfactual.attribution import repair_gains
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.counterfactual.scene_comparison import ImageArrays
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.harm import _resized
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import Backend
from s2rtools.models.preprocessing import preprocess
from tests.counterfactual.test_scene_comparison import CAMERA, PATCH, dimmed, with_box
from tests.counterfactual.views import FRAME, SIZE, rendered, rig
from tests.support import networks

TRUTH = np.array([[0.3, -0.2, 0.4]])
KINDS = ("harm", "harm_fine")


def pair_of(sim: ImageArrays, real: ImageArrays) -> PairBatch:
    model = networks.small_model(*networks.local_trunks()["residual"], (SIZE, SIZE))
    backend = Backend(model)
    sides = []
    for rgb, raw, valid in (sim, real):
        images = rgb[None], raw[None], valid[None]
        x = preprocess(images[0], images[1], 0.001, model.contract, images[2])
        made = backend.forward_all(x)
        sides.append(
            SideBatch(*images, 0.001, made.x, made.features, made.embedding, made.pose, TRUTH)
        )
    rigs = rig(CAMERA), rig(CAMERA)
    tolerance = DepthTolerance(0.03, 0.005, 0.0, 8.0)
    return PairBatch(model, backend, *sides, ImageAlignment(*rigs, FRAME, RigOffset(), tolerance))


@pytest.fixture(scope="module")
def changed() -> PairBatch:
    image = rendered("sim", CAMERA)[2]
    return pair_of(image, with_box(dimmed(image)))


def test_maps_of_segments_sum_to_the_gains_of_their_repair(changed):
    gains = repair_gains(changed.backend, changed.counterfactuals[0], TRUTH[0])
    maps = HEATMAP_KINDS["harm"].compute(changed)["real", None][0]
    assert np.abs(gains).max() > 0
    assert np.allclose(maps.sum(axis=(1, 2)), gains.sum(axis=0), rtol=1e-4, atol=1e-6)


def test_the_gain_of_a_segment_is_spread_by_the_squares_of_its_change(changed):
    inputs = changed.counterfactuals[0]
    heat = HEATMAP_KINDS["harm"].attribute(changed, inputs, TRUTH[0])[0]
    for number in range(1, inputs.count + 1):
        inside = inputs.scenes.segments == number
        squares = np.square(inputs.scenes.change[inside])
        expected = heat[inside].sum() * squares / squares.sum()
        assert np.allclose(heat[inside], expected, rtol=1e-3, atol=1e-7)


def test_resampled_maps_keep_their_sums():
    maps = np.random.default_rng(1).normal(size=(3, 40, 60)).astype(np.float32)
    small = _resized(maps, (16, 20))
    assert small.shape == (3, 16, 20)
    assert np.allclose(small.sum(axis=(1, 2)), maps.sum(axis=(1, 2)), rtol=1e-3)


@pytest.mark.parametrize("side", ["sim", "real"])
def test_the_changed_object_has_most_of_the_harm(changed, side):
    for name in KINDS:
        heat = np.abs(HEATMAP_KINDS[name].compute(changed)[side, None][0, 0])
        assert heat[PATCH].sum() > 0.6 * heat.sum()


def test_equal_images_have_no_harm():
    image = rendered("sim", CAMERA)[2]
    pair = pair_of(image, image)
    assert not HEATMAP_KINDS["harm"].compute(pair)["real", None].any()
    fine = HEATMAP_KINDS["harm_fine"].compute(pair)["real", None]
    changed = HEATMAP_KINDS["harm_fine"].compute(pair_of(image, with_box(image)))["real", None]
    assert np.abs(fine).sum() < 0.1 * np.abs(changed).sum()
