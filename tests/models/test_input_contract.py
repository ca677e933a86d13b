"""Input contracts: files that override them, the check of a forward pass, and stored models."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rtools.models import build_network
from s2rtools.models.input_contract import InputContract, read_override
from s2rtools.models.load_model import load_model
from s2rtools.models.model_registration import add_model, read_weights
from tests.support.refusals import refused

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def toml(folder: Path, text: str) -> Path:
    file = folder / "net.toml"
    file.write_text(text)
    return file


def rgb_network(size: int = 24) -> nn.Module:
    """A network of three channels and one size."""
    torch.manual_seed(0)
    cells = (size // 4) ** 2
    return nn.Sequential(
        nn.Conv2d(3, 4, 4, stride=4), nn.ReLU(), nn.Flatten(), nn.Linear(4 * cells, 3)
    )


def script(folder: Path, network: nn.Module, shape: tuple[int, int, int]) -> Path:
    file = folder / "net.pt"
    torch.jit.save(torch.jit.trace(network.eval(), torch.zeros(1, *shape)), str(file))
    return file


def test_the_keys_of_a_file_override_the_declared_contract(tmp_path):
    declared = build_network("posest").contract
    assert (declared.rgb_interpolation, declared.depth_interpolation) == ("bilinear", "bilinear")
    file = toml(tmp_path, "size = [120, 160]\nmissing_depth = 9.5\ncolour_order = 'bgr'\n")
    expected = replace(declared, size=(120, 160), missing_depth=9.5, colour_order="bgr")
    assert read_override(file).applied(declared) == expected
    file = toml(tmp_path, "missing_depth = 'keep'\n")
    assert read_override(file).applied(expected).missing_depth is None


def test_a_unit_resets_mean_and_deviation(tmp_path):
    file = toml(tmp_path, "depth_unit = 0.001\nrgb_scale = 255\nstd = [2, 3, 4]\n")
    contract = read_override(file).applied(InputContract())
    assert (contract.depth_unit, contract.depth_mean, contract.depth_std) == (0.001, 0.0, 1.0)
    assert (contract.mean, contract.std) == ((0.0, 0.0, 0.0), (2.0, 3.0, 4.0))


WRONG = {
    'channels = "rgbx"': "net.toml: channels: expected one of rgb, depth, rgbd, got 'rgbx'",
    "chanels = 'rgb'": "net.toml: chanels: unknown key; did you mean channels",
    "size = [224]": r"net.toml: size: expected a list of length 2, got 1",
    "size = [8, 4096]": "size.* <= 2048, got 4096",
    "mean = [1, nan, 1]": "mean.*finite",
    "depth_range = [3, 1]": "depth_range: expected the nearest and the farthest",
    "missing_depth = 'far'": "missing_depth: expected metres or \"keep\", got 'far'",
    "rgb_interpolation = 'lanczos'": "rgb_interpolation: expected one of nearest, ",
    "size = ": "net.toml: ",
}


@pytest.mark.parametrize("text", list(WRONG))
def test_a_wrong_key_or_value_is_named(tmp_path, text):
    with refused(match=WRONG[text]):
        read_override(toml(tmp_path, text))


@pytest.mark.parametrize(
    ("network", "size", "text", "message"),
    [
        (rgb_network, 24, "size = [24, 24]",
         'expected 3 channels, got 4.*; set channels = "rgb" in .*net.toml$'),
        (rgb_network, 64, "channels = 'rgb'\nsize = [48, 48]",
         r"expected images of 64 x 64, got 48 x 48; set size = \[64, 64\]"),
        (lambda size: nn.Sequential(nn.Flatten(), nn.Linear(3 * size**2, 7)), 8,
         "channels = 'rgb'\nsize = [8, 8]",
         r"expected an output of \(1, 3\) or \(1, 4\), got \(1, 7\)"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_network_names_the_key_to_set(tmp_path, network, size, text, message):
    file = script(tmp_path, network(size), (3, size, size))
    with refused(match=message):
        read_weights(file, "torchscript", True, read_override(toml(tmp_path, text)))


def test_a_built_in_network_is_checked_too(tmp_path):
    torch.save(build_network("resposenet").state_dict(), tmp_path / "w.pth")
    override = read_override(toml(tmp_path, "channels = 'rgb'"))
    with pytest.raises(RequestError, match='expected 4 channels, got 3; set channels = "rgbd"'):
        read_weights(tmp_path / "w.pth", "resposenet", override=override)


def test_a_registered_contract_is_stored_listed_and_loaded(store_copy, tmp_path, s2r):
    file = script(tmp_path, rgb_network(), (3, 24, 24))
    given = toml(tmp_path, "channels = 'rgb'\nsize = [24, 24]\nconvention = 'degrees,habitat'\n")
    add_model(store_copy, "rgb", file, "torchscript", None, True, given)
    expected = InputContract("rgb", (24, 24))
    with s2rstore.open(store_copy) as store:
        assert store.models["rgb"].channels == "rgb"
        model = load_model(store, "rgb", trust=True)
        assert model.contract == model.network.contract == expected
        assert (model.convention.heading, model.convention.frame) == ("degrees", "habitat")
    listed = {row["model"]: row for row in s2r("models", store_copy, "--json").json}
    assert listed["rgb"]["input"] == json.loads(expected.to_json())
    assert "rgb mean 0.5,0.5,0.5 std 0.5,0.5,0.5" in s2r("models", store_copy).printed


def test_a_convention_is_given_once(store_copy, tmp_path):
    file = script(tmp_path, rgb_network(), (3, 24, 24))
    given = toml(tmp_path, "channels = 'rgb'\nsize = [24, 24]\nconvention = 'degrees'\n")
    with pytest.raises(RequestError, match=r"--convention: .*net\.toml names one, too"):
        add_model(store_copy, "rgb", file, "torchscript", "degrees", True, given)


@pytest.mark.parametrize(
    "change", [{"channels": "grey"}, {"mean": [1, 2]}, {"depth_unit": "m"}, {"size": None}]
)
def test_a_damaged_contract_is_refused(store_copy, tmp_path, change):
    torch.save(build_network("resposenet").state_dict(), tmp_path / "w.pth")
    add_model(store_copy, "m", tmp_path / "w.pth", "resposenet", None, False)
    stored = json.loads(InputContract(size=(128, 128)).to_json()) | change
    with edit(store_copy) as draft:
        draft.update("model", {"model": "m"}, {"input": json.dumps(stored)})
    with pytest.raises(RequestError, match=f"table model: input of 'm': {next(iter(change))}"):
        s2rstore.open(store_copy)
