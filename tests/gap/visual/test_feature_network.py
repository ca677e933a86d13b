"""Feature networks from description files: layout, preprocessing, fingerprints and errors."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from s2rstore.errors import RequestError
from s2rtools.gap.visual import feature_network
from s2rtools.gap.visual.inception import Coarse, FidInception, Fine
from tests.support.networks import randomize_weights
from tests.support.refusals import refused

DESCRIPTION = """
architecture = "inception_v3_fid"
weights = "{weights}"
{more}
[preprocessing]
size = [{size}, {size}]
filter = "bilinear"
range = [-1.0, 1.0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random weights in the layout of the published file, classifier included."""
    root = tmp_path_factory.mktemp("inception")
    state = dict(randomize_weights(FidInception()).state_dict())
    state |= {"fc.weight": torch.zeros(1008, 2048), "fc.bias": torch.zeros(1008)}
    torch.save(state, root / "w.pth")
    plain = {k: v.contiguous() for k, v in state.items() if "num_batches" not in k}
    save_file(plain, root / "w.safetensors")
    return root


@pytest.fixture(scope="module")
def damaged(folder: Path) -> Path:
    """The same folder with additional invalid weights files."""
    (folder / "junk.pth").write_bytes(b"junk")
    for suffix in ("pth", "safetensors"):
        content = (folder / f"w.{suffix}").read_bytes()
        (folder / f"half.{suffix}").write_bytes(content[: len(content) // 2])
    torch.save({"a": torch.zeros(3)}, folder / "other.pth")
    state = torch.load(folder / "w.pth", weights_only=True)
    state["Mixed_7c.branch1x1.bn.bias"][0] = float("nan")
    torch.save(state, folder / "broken.pth")
    return folder


def write_description(root: Path, weights: str = "w.pth", size: int = 80, more: str = "") -> Path:
    file = root / "network.toml"
    file.write_text(DESCRIPTION.format(weights=weights, size=size, more=more))
    return file


def test_the_layout_matches_the_published_weights():
    network = FidInception()
    shapes = {key: tuple(value.shape) for key, value in network.state_dict().items()}
    assert shapes["Conv2d_1a_3x3.conv.weight"] == (32, 3, 3, 3)
    assert shapes["Mixed_5b.branch_pool.conv.weight"] == (32, 192, 1, 1)
    assert shapes["Mixed_6a.branch3x3.conv.weight"] == (384, 288, 3, 3)
    assert shapes["Mixed_6c.branch7x7dbl_4.conv.weight"] == (160, 160, 7, 1)
    assert shapes["Mixed_7a.branch7x7x3_4.bn.running_var"] == (192,)
    assert shapes["Mixed_7c.branch3x3dbl_3b.conv.weight"] == (384, 384, 3, 1)
    assert len([key for key in shapes if key.endswith("conv.weight")]) == 94
    assert sum(p.numel() for p in network.parameters()) == 21_785_568
    sizes = {}
    for name in ("Mixed_5d", "Mixed_6e", "Mixed_7c"):
        network.get_submodule(name).register_forward_hook(
            lambda module, inputs, out, name=name: sizes.update({name: tuple(out.shape[1:])})
        )
    with torch.inference_mode():
        assert network.eval()(torch.zeros(1, 3, 299, 299)).shape == (1, 2048)
    assert sizes == {"Mixed_5d": (288, 35, 35), "Mixed_6e": (768, 17, 17), "Mixed_7c": (2048, 8, 8)}


def test_averages_exclude_padding_and_the_last_block_uses_the_maximum():
    fine, coarse = randomize_weights(Fine(4, 32)), Coarse(4, maximum=True)
    with torch.inference_mode():
        pooled_path = fine(torch.ones(1, 4, 6, 6))[0, -32:]
        assert torch.allclose(pooled_path, pooled_path[:, :1, :1].expand_as(pooled_path), atol=1e-5)
        x = torch.randn(1, 4, 5, 5)
        assert coarse.pool(x)[0, 0, 2, 2] == x[0, 0, 1:4, 1:4].max()
        assert Coarse(4, maximum=False).pool(x)[0, 0, 0, 0] == pytest.approx(
            float(x[0, 0, :2, :2].mean()), abs=1e-6
        )


def test_features_equal_the_network_output_on_preprocessed_images(folder):
    rgb = np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3)).astype(np.uint8)
    read = feature_network.read_network(write_description(folder))
    x = torch.from_numpy(rgb).permute(0, 3, 1, 2) / 255
    x = torch.nn.functional.interpolate(x, (80, 80), mode="bilinear", align_corners=False) * 2 - 1
    assert np.allclose(read.preprocessing(rgb), x.numpy(), atol=1e-5)
    with torch.inference_mode():
        expected = randomize_weights(FidInception())(x).numpy()
    computed = read.features(rgb, batch=2)
    assert computed.shape == (3, 2048)
    assert np.allclose(computed, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["bilinear", "bicubic", "nearest"])
def test_filters_equal_torch(name):
    rgb = np.random.default_rng(2).integers(0, 256, (1, 150, 180, 3)).astype(np.uint8)
    mean, std = (0.5, 0.4, 0.3), (0.5, 0.25, 0.2)
    prepare = feature_network.Preprocessing((75, 120), name, None, mean, std)
    x = torch.from_numpy(rgb).permute(0, 3, 1, 2) / 255
    corners = {} if name == "nearest" else {"align_corners": False}
    expected = torch.nn.functional.interpolate(x, (75, 120), mode=name, **corners).numpy()
    expected = (np.moveaxis(expected, 1, -1) - mean) / std
    assert np.allclose(np.moveaxis(prepare(rgb), 1, -1), expected, atol=1e-4)


def test_the_area_filter_averages_pixels():
    rgb = np.random.default_rng(3).integers(0, 256, (1, 150, 225, 3)).astype(np.uint8)
    prepare = feature_network.Preprocessing((75, 75), "area", None, (0.0,) * 3, (1.0,) * 3)
    expected = (rgb[0] / 255).reshape(75, 2, 75, 3, 3).mean(axis=(1, 3))
    assert np.allclose(prepare(rgb)[0], np.moveaxis(expected, -1, 0), atol=2e-5)


def test_the_fingerprint_covers_weights_and_preprocessing(folder):
    identity = feature_network.read_network(write_description(folder)).identity
    assert identity["weights_sha256"] == hashlib.sha256((folder / "w.pth").read_bytes()).hexdigest()
    assert identity == feature_network.read_network(write_description(folder)).identity
    other_size = feature_network.read_network(write_description(folder, size=96)).identity
    other_file = feature_network.read_network(write_description(folder, "w.safetensors")).identity
    keys = {i["features_sha256"] for i in (identity, other_size, other_file)}
    assert len(keys) == 3
    as_json = folder / "network.json"
    steps = {"size": [80, 80], "filter": "bilinear", "mean": [0.5] * 3, "std": [0.5] * 3}
    as_json.write_text(
        json.dumps({"architecture": "inception_v3_fid", "weights": "w.pth", "preprocessing": steps})
    )
    assert feature_network.read_network(as_json).identity == identity


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("w.pth", "gone.pth", "gone.pth: cannot be read"),
        ("w.pth", "junk.pth", "junk.pth: "),
        ("w.pth", "half.pth", "half.pth: "),
        ("w.pth", "half.safetensors", "half.safetensors: "),
        ("w.pth", "other.pth", "no Conv2d_1a_3x3"),
        ("w.pth", "broken.pth", "not finite"),
        ("inception_v3_fid", "vgg", "architecture must be one of"),
        ("bilinear", "sinc", "filter must be one of"),
        ("size = [80, 80]", "size = [80]", "preprocessing.size"),
        ("size = [80, 80]", "size = [8, 80]", "preprocessing.size"),
        ("range = [-1.0, 1.0]", "", "expected either range, or mean and std"),
        ("range = [-1.0, 1.0]", "range = [1.0, -1.0]", "range must be [low, high]"),
        ("range = [-1.0, 1.0]", "mean = [0, 0, 0]\nstd = [1, 0, 1]", "std must be above 0"),
        ("range = [-1.0, 1.0]", "antialias = true", "preprocessing.antialias: unknown key"),
        ("[preprocessing]", "[preparing]", "preparing: unknown key"),
        ("architecture =", "architecture", "network.toml: "),
    ],
)
def test_an_invalid_description_is_explained_in_one_line(damaged, old, new, expected):
    file = write_description(damaged)
    file.write_text(file.read_text().replace(old, new))
    with refused(expected):
        feature_network.read_network(file)


def test_a_wrong_checksum_and_a_missing_file_are_rejected(folder):
    with pytest.raises(RequestError, match="its sha256 is"):
        feature_network.read_network(write_description(folder, more='sha256 = "00"'))
    with pytest.raises(RequestError, match="cannot be read"):
        feature_network.read_network(folder / "nowhere.toml")
