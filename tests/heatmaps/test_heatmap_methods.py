"""Every heatmap kind compared with a direct implementation of its formula."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.reader import NETWORK_KINDS
from s2rstore.records import Domain, Intrinsics
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.heatmaps import HEATMAP_KINDS, IMAGE_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.activation import pose_loss
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import Backend
from s2rtools.models.input_contract import InputContract
from s2rtools.models.pose_network import LoadedModel
from s2rtools.models.preprocessing import preprocess
from tests.support import networks

TRUTH = np.array([[1.0, 2.0, 0.3], [0.5, -1.0, 3.0]])


def make_pair(model: LoadedModel) -> PairBatch:
    rng = np.random.default_rng(2)
    backend = Backend(model)
    sides = {}
    for name in ("sim", "real"):
        rgb = rng.integers(0, 256, (2, 48, 48, 3)).astype(np.uint8)
        depth = rng.integers(0, 256, (2, 48, 48)).astype(np.uint8)
        result = backend.forward_all(preprocess(rgb, depth, 10 / 255, model.contract))
        sides[name] = SideBatch(
            rgb, depth, (depth > 5) & (depth < 250), 10 / 255, result.x, result.features,
            result.embedding, result.pose, TRUTH,
        )  # fmt: skip
    lens = Intrinsics(30.0, 30.0, 24.0, 24.0, 0.0)
    rigs = [Domain(side, side, lens, lens, 0.6, 0.0, 10 / 255, 6, 249) for side in ("sim", "real")]
    tolerance = DepthTolerance(0.05, 0.01, 0.0, 20.0)
    aligned = ImageAlignment(*rigs, (48, 48), RigOffset(-0.05, 1.03), tolerance)
    return PairBatch(model, backend, sides["sim"], sides["real"], aligned)


@pytest.fixture(scope="module")
def pair() -> PairBatch:
    return make_pair(networks.small_model(*networks.local_trunks()["residual"], (36, 36)))


@pytest.mark.parametrize("name", list(HEATMAP_KINDS))
def test_outputs_match_their_declaration(pair, name):
    kind = HEATMAP_KINDS[name]
    maps = kind.compute(pair)
    declared = kind.outputs(pair.model)
    assert set(maps) == {(output.side, output.mode) for output in declared}
    for output in declared:
        values = maps[output.side, output.mode]
        assert values.shape == (2, *output.shape)
        assert len(output.axes) == len(output.shape)
    repeated = kind.compute(pair)
    for key, values in maps.items():
        assert np.array_equal(values, repeated[key], equal_nan=True)


def model_of(channels: str) -> LoadedModel:
    """A small model that takes RGB or depth alone, normalised as for ImageNet."""
    contract = InputContract(
        channels, (36, 36), mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225)
    )
    trunk = nn.Sequential(
        nn.Conv2d(contract.width, 8, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2),
        nn.Conv2d(8, 8, 3, padding=1), nn.ReLU(),
    )  # fmt: skip
    return replace(networks.small_model(trunk, 8, (36, 36)), registered=contract)


@pytest.mark.parametrize("channels", ["rgb", "depth"])
def test_models_without_depth_or_colours_have_all_heatmaps_of_what_they_take(channels):
    pair = make_pair(model_of(channels))
    for kind in HEATMAP_KINDS.values():
        assert kind.suits(pair.model)
        maps = kind.compute(pair)
        declared = {(each.side, each.mode): each.shape for each in kind.outputs(pair.model)}
        assert {key: values.shape[1:] for key, values in maps.items()} == declared
    occlusion = HEATMAP_KINDS["occlusion"]
    assert {each.mode for each in occlusion.outputs(pair.model)} == {channels}
    x = pair.sim.x.clone()
    x[..., :6, :6] = pair.real.x[..., :6, :6]
    before, after = (pair.backend.forward_all(each.numpy()).pose for each in (pair.sim.x, x))
    errors = [np.hypot(*(pose - TRUTH)[:, :2].T) for pose in (before, after)]
    maps = occlusion.compute(pair)["sim", channels]
    np.testing.assert_allclose(maps[:, 0, 0, 0], errors[1] - errors[0], atol=1e-5)


def test_activation_is_gradient_times_features(pair):
    maps = HEATMAP_KINDS["activation"].compute(pair)["real", None]
    network, convention = pair.model.network, pair.model.convention
    features = pair.real.features.clone()
    for output in range(4):
        active = features.clone().requires_grad_(True)
        pose = convention.decode(network.head(network.embed(active)))
        value = pose[:, output] if output < 3 else pose_loss(pose, torch.tensor(TRUTH).float())
        value.sum().backward()
        weights = active.grad.mean(dim=(2, 3))
        expected = np.einsum("bc,bchw->bhw", weights.numpy(), features.numpy())
        assert np.allclose(maps[:, output], expected, atol=1e-4 * np.abs(expected).max())


def test_the_pose_loss_equals_its_formula():
    pose = torch.tensor([[3.0, 4.0, -3.1]])
    truth = torch.tensor([[0.0, 0.0, 3.1]])
    turn = 2 * np.pi - 6.2
    assert float(pose_loss(pose, truth)) == pytest.approx(0.7 * 25 + 0.3 * turn, rel=1e-5)


def test_feature_distance_is_cosine_distance_times_l1(pair):
    maps = HEATMAP_KINDS["feature_distance"].compute(pair)[None, None]
    sim, real = pair.sim.features.numpy(), pair.real.features.numpy()
    for b, r, c in ((0, 0, 0), (1, 5, 7), (0, 17, 17)):
        u, v = sim[b, :, r, c], real[b, :, r, c]
        norms = np.linalg.norm(u) * np.linalg.norm(v)
        cosine = u @ v / norms if norms else 0.0
        assert maps[b, r, c] == pytest.approx((1 - cosine) * np.abs(u - v).mean(), abs=1e-4)
    same = PairBatch(pair.model, pair.backend, pair.sim, pair.sim)
    assert np.abs(HEATMAP_KINDS["feature_distance"].compute(same)[None, None]).max() < 1e-5


def test_pixel_difference_ignores_brightness_and_invalid_depth(pair):
    maps = HEATMAP_KINDS["pixel_difference"].compute(pair)
    assert np.isfinite(maps[None, "rgb"]).all()
    assert maps[None, "rgb"].min() >= 0
    dark = (pair.sim.rgb // 2 + 40).astype(np.uint8)
    side = pair.sim
    other = SideBatch(
        dark, side.depth, np.zeros_like(side.valid), side.depth_scale, side.x, side.features,
        side.embedding, side.prediction, side.truth,
    )  # fmt: skip
    darker_maps = HEATMAP_KINDS["pixel_difference"].compute(
        PairBatch(pair.model, pair.backend, side, other)
    )
    assert darker_maps[None, "rgb"].max() < 0.05
    assert np.isnan(darker_maps[None, "depth"]).all()


def test_occlusion_is_the_change_of_the_error_towards_the_gap(pair):
    maps = HEATMAP_KINDS["occlusion"].compute(pair)
    backend = pair.backend
    for mode, channels in (("rgb", [0, 1, 2]), ("depth", [3]), ("rgbd", [0, 1, 2, 3])):
        for side, other, sign in (("sim", "real", 1), ("real", "sim", -1)):
            x = pair.side(side).x.clone()
            rows, cols = slice(6, 12), slice(30, 36)
            x[:, channels, rows, cols] = pair.side(other).x[:, channels, rows, cols]
            after = backend.forward_all(x.numpy()).pose
            before = pair.side(side).prediction
            expected = np.hypot(*(after - TRUTH)[:, :2].T) - np.hypot(*(before - TRUTH)[:, :2].T)
            assert maps[side, mode][:, 0, 1, 5] == pytest.approx(sign * expected, abs=1e-4)


def test_a_non_local_network_is_computed_in_full():
    pair = make_pair(networks.small_model(*networks.nonlocal_trunks()["group norm"], (24, 24)))
    maps = HEATMAP_KINDS["occlusion"].compute(pair)["real", "rgbd"]
    x = pair.real.x.clone()
    x[:, :, 0:4, 0:4] = pair.sim.x[:, :, 0:4, 0:4]
    after = pair.backend.forward_all(x.numpy()).pose
    before = pair.real.prediction
    expected = np.hypot(*(before - TRUTH)[:, :2].T) - np.hypot(*(after - TRUTH)[:, :2].T)
    assert maps[:, 0, 0, 0] == pytest.approx(expected, abs=1e-5)


def test_the_store_knows_the_kinds_that_need_a_network():
    assert HEATMAP_KINDS.keys() - IMAGE_KINDS.keys() == NETWORK_KINDS
    assert IMAGE_KINDS.keys() == {name for name, kind in HEATMAP_KINDS.items() if kind.model_free}


@pytest.mark.parametrize(("size", "usual"), [(128, True), (160, True), (256, False)])
def test_harm_is_a_default_for_small_inputs_alone(size, usual):
    model = replace(model_of("rgbd"), registered=InputContract(size=(size, size)))
    for name, kind in HEATMAP_KINDS.items():
        assert kind.is_default(model) == (usual or name not in ("harm", "harm_fine"))
