"""Style methods: their losses, and the networks whose features they use."""

import pytest
import torch
from safetensors.torch import save_file

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS, style_losses
from s2rtools.translation.method import FitSettings
from s2rtools.translation.network_translator import to_tensor
from s2rtools.translation.style_losses import FeatureNetwork, StyleLosses, gram_matrix, read_vgg19
from tests.translation.palette_world import counterparts, image_set, unpaired


@pytest.fixture(autouse=True)
def few_feature_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style_losses, "TRAINING_STEPS", 30)


def style_loss(losses: StyleLosses, images) -> float:
    with torch.no_grad():
        return float(losses.style(losses.features(to_tensor(images))))


@pytest.fixture(scope="module")
def vgg19_state() -> dict[str, torch.Tensor]:
    """Random weights with the names and shapes of torchvision's VGG-19."""
    generator = torch.Generator().manual_seed(0)
    numbers = (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28)
    state = {}
    layers = FeatureNetwork("vgg19").layers.values()
    for number, layer in zip(numbers, layers, strict=True):
        shape = layer.weight.shape
        weight = torch.randn(shape, generator=generator) * (2 / (shape[1] * 9)) ** 0.5
        state |= {f"features.{number}.weight": weight, f"features.{number}.bias": layer.bias.data}
    return state


def test_gram_matrices_are_mean_products_of_channels():
    activations = torch.tensor([[[[1.0, 2.0]], [[3.0, 5.0]]]])
    assert torch.equal(gram_matrix(activations), torch.tensor([[[2.5, 6.5], [6.5, 17.0]]]))


def test_style_lowers_its_loss_on_the_gram_matrices():
    settings = FitSettings(options={"iterations": "30"})
    translator = METHODS.find("style").fit(*unpaired(), settings).translator
    losses, images = translator.network.losses, counterparts(3)[0]
    assert style_loss(losses, translator.translate(images)) < 0.7 * style_loss(losses, images)


def test_the_style_network_lowers_the_loss_on_the_gram_matrices():
    source, target = unpaired()
    settings = FitSettings(steps=80, options={"channels": "8", "blocks": "1"})
    translator = METHODS.find("style-network").fit(source, target, settings).translator
    style = METHODS.find("style").fit(source, target, FitSettings()).translator
    losses, images = style.network.losses, counterparts(6)[0]
    assert style_loss(losses, translator.translate(images)) < 0.7 * style_loss(losses, images)


def test_the_facts_say_which_features_were_used(tmp_path, vgg19_state):
    small = METHODS.find("style").fit(*unpaired(), FitSettings(options={"iterations": "1"}))
    assert "trained on rotation and domain" in small.facts["features"]
    assert 0 <= small.facts["features_rotation_accuracy"] <= 1
    file = tmp_path / "vgg19.safetensors"
    save_file(vgg19_state, file)
    images = image_set(counterparts(2)[0])
    options = {"features": str(file), "iterations": "1"}
    named = METHODS.find("style").fit(images, images, FitSettings(options=options))
    assert named.facts["features"] == "VGG-19"
    assert len(named.facts["features_sha256"]) == 64
    assert named.translator.settings()["network"]["layout"] == "vgg19"


def test_vgg19_is_read_from_torch_and_safetensors_files(tmp_path, vgg19_state):
    classifier = {"classifier.0.weight": torch.zeros(2, 2)}
    save_file(vgg19_state | classifier, tmp_path / "vgg19.safetensors")
    torch.save(vgg19_state, tmp_path / "vgg19.pth")
    x = torch.zeros(1, 3, 16, 16)
    outputs = [
        read_vgg19(tmp_path / name)(x)["conv4_2"].detach()
        for name in ("vgg19.safetensors", "vgg19.pth")
    ]
    assert torch.equal(*outputs)
    assert outputs[0].shape == (1, 512, 2, 2)


def test_wrong_feature_files_are_refused_by_name(tmp_path, vgg19_state):
    file = tmp_path / "other.safetensors"
    save_file({"layer.weight": torch.zeros(3)}, file)
    with pytest.raises(RequestError, match=r"other\.safetensors.*features\.0\.weight"):
        read_vgg19(file)
    save_file(vgg19_state | {"features.5.weight": torch.zeros(4, 4, 3, 3)}, file)
    with pytest.raises(RequestError, match=r"other\.safetensors.*features\.5\.weight"):
        read_vgg19(file)
    file.write_bytes(b"text")
    with pytest.raises(RequestError, match=r"other\.safetensors"):
        read_vgg19(file)
    with pytest.raises(RequestError, match="missing"):
        read_vgg19(tmp_path / "missing.safetensors")
