"""The feature network of the style methods, and content and style losses on its features.

The network is VGG-19 from a file, or a small one trained in the fit. Layers are named as in
Simonyan and Zisserman, "Very deep convolutional networks for large-scale image recognition", 2015:
conv4_2 is the second convolution of the fourth stage. Average pooling and losses: Gatys, Ecker and
Bethge, "Image style transfer using convolutional neural networks", 2016. The losses are relative
here: the squared difference is divided by the square of what is to be reached, so that weights do
not depend on the feature network or the size of the images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, cross_entropy, relu

from s2rstore.errors import RequestError
from s2rstore.files.input_files import sha256
from s2rtools.common.checkpoint import FitState
from s2rtools.common.torch_device import device
from s2rtools.common.weights_file import check_tensors, read_state, read_weights_file
from s2rtools.translation.fit_loop import Batch, BatchSampler, FitPlan, Learner, run_fit
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitSettings
from s2rtools.translation.network_translator import placed, to_tensor
from s2rtools.translation.networks import initialised

LAYOUTS: dict[str, tuple[tuple[int, int], ...]] = {
    "vgg19": ((64, 2), (128, 2), (256, 4), (512, 4), (512, 1)),
    "small": ((12, 2), (24, 2), (48, 2), (64, 2), (64, 1)),
}
"""Channels and convolutions of each stage, up to conv5_1."""
_TORCHVISION_MEAN, _TORCHVISION_DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_TORCHVISION_CONVOLUTIONS = (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28)
MAX_FILE_BYTES = 1 << 30

TRAINING_STEPS = 300
TRAINING_BATCH = 4
TRAINING_EDGE = 64
TRAINING_RATE = 1e-3
ROTATIONS = 4
CONTENT_LAYER = "conv4_2"
STYLE_LAYERS = ("conv1_1", "conv2_1", "conv3_1", "conv4_1", "conv5_1")
_TINY = 1e-12


class FeatureNetwork(nn.Module):
    """Activations of all convolutions after the rectifier, by layer name."""

    def __init__(self, layout: str) -> None:
        super().__init__()
        self.layout = layout
        self.layers = nn.ModuleDict()
        inputs = 3
        for name, channels in self.widths().items():
            convolution = nn.Conv2d(inputs, channels, 3, padding=1)
            nn.init.kaiming_normal_(convolution.weight)
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
            self.layers[name] = convolution
            inputs = channels

    def widths(self) -> dict[str, int]:
        """Channels of each layer."""
        stages = enumerate(LAYOUTS[self.layout], start=1)
        return {
            f"conv{stage}_{number}": channels
            for stage, (channels, count) in stages
            for number in range(1, count + 1)
        }

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Activations of images (B, 3, h, w) in -1 .. 1."""
        if self.layout == "vgg19":
            mean, deviation = (
                x.new_tensor(values).view(3, 1, 1)
                for values in (_TORCHVISION_MEAN, _TORCHVISION_DEVIATION)
            )
            x = ((x + 1) / 2 - mean) / deviation
        found = {}
        for name, convolution in self.layers.items():
            if name.endswith("_1") and name != "conv1_1" and min(x.shape[2:]) >= 2:
                x = avg_pool2d(x, 2)
            found[name] = x = relu(convolution(x))
        return found


def build_features(layout: object) -> FeatureNetwork:
    """An untrained network. Raises ValueError for unknown layouts."""
    if not isinstance(layout, str) or layout not in LAYOUTS:
        raise ValueError(f"layout {layout!r}: one of {', '.join(LAYOUTS)}")
    return FeatureNetwork(layout)


def read_vgg19(path: Path) -> FeatureNetwork:
    """VGG-19 of a weights file with torchvision's names. Raises RequestError for other files."""
    network = FeatureNetwork("vgg19")
    names = dict(zip(network.layers, _TORCHVISION_CONVOLUTIONS, strict=True))
    state = read_state(path, read_weights_file(path, MAX_FILE_BYTES))
    expected = network.state_dict()
    found: dict[str, Tensor] = {}
    for layer, number in names.items():
        for part in ("weight", "bias"):
            theirs, ours = f"features.{number}.{part}", f"layers.{layer}.{part}"
            if theirs not in state:
                raise RequestError(
                    f"{path}: no tensor {theirs}; features= needs the state dict of "
                    "torchvision's vgg19"
                )
            shape, wanted = tuple(state[theirs].shape), tuple(expected[ours].shape)
            if shape != wanted:
                raise RequestError(f"{path}: {theirs} has shape {shape}, that of VGG-19 {wanted}")
            found[ours] = state[theirs]
    check_tensors(found, expected, str(path))
    network.load_state_dict(found)
    return network


class _FeatureLearner(Learner):
    """Trains a network to name the rotation and the domain of square crops."""

    def __init__(self) -> None:
        self.features = FeatureNetwork("small")
        self.heads = nn.Linear(LAYOUTS["small"][-1][0], ROTATIONS + 2)
        network = placed(nn.ModuleDict({"features": self.features, "heads": self.heads}))
        self.state = FitState(network, {"all": torch.optim.Adam(network.parameters())})

    def step(self, batch: Batch) -> Mapping[str, Tensor]:
        x = torch.cat([batch.source, batch.target])
        turns = torch.randint(
            ROTATIONS, (len(x),), generator=batch.generator, device=batch.generator.device
        )
        x = torch.stack(
            [torch.rot90(image, int(k), (1, 2)) for image, k in zip(x, turns, strict=True)]
        )
        domain = (torch.arange(len(x), device=x.device) >= len(batch.source)).long()
        scores = self.heads(self.features(x)["conv5_1"].mean(dim=(2, 3)))
        losses = {
            "rotation": cross_entropy(scores[:, :ROTATIONS], turns),
            "domain": cross_entropy(scores[:, ROTATIONS:], domain),
        }
        loss = losses["rotation"] + losses["domain"]
        self.update(loss)
        right = (scores[:, :ROTATIONS].argmax(dim=1) == turns).float().mean()
        return {"loss": loss.detach(), "rotation_accuracy": right}


def fitted_features(
    source: ImageSet, target: ImageSet, settings: FitSettings, file: str
) -> tuple[FeatureNetwork, dict[str, Any]]:
    """VGG-19 of a weights file, or, where `file` is empty, a small network trained on both domains.

    The small one learns to tell by how many quarter turns a crop was rotated and which domain it
    is from. It is trained again when a fit continues from a checkpoint, with the same result.
    Returns facts that name the network.
    """
    if file:
        path = Path(file)
        network = read_vgg19(path)
        placed(network).eval().requires_grad_(False)
        return network, {"features": "VGG-19", "features_sha256": sha256(path)}
    edge = min(TRAINING_EDGE, *source.size)
    sampler = BatchSampler(source, target, (edge, edge), TRAINING_BATCH, settings.seed)
    learner = initialised(settings.seed, _FeatureLearner)
    plan = FitPlan("features", TRAINING_STEPS, TRAINING_RATE, {})
    own = replace(settings, steps=TRAINING_STEPS, minutes=None, checkpoint=None)
    history, facts = run_fit(learner, sampler, plan, replace(own, report=FitSettings().report))
    return learner.features, {
        "features": "small network trained on rotation and domain of the given images",
        "features_steps": TRAINING_STEPS,
        "features_seconds": facts["seconds"],
        "features_rotation_accuracy": history[-1]["rotation_accuracy"],
    }


def gram_matrix(activations: Tensor) -> Tensor:
    """Gram matrices (B, C, C) of activations (B, C, h, w): mean products of two channels."""
    flat = activations.flatten(2)
    return flat @ flat.transpose(1, 2) / flat.shape[2]


def mean_gram_matrices(features: FeatureNetwork, images: ImageSet) -> dict[str, Tensor]:
    """Gram matrix (C, C) of each style layer, averaged over all images."""
    sums: dict[str, Tensor] = {}
    with torch.no_grad():
        for image in images.images:
            activations = features(to_tensor(image[None]))
            for layer in STYLE_LAYERS:
                gram = gram_matrix(activations[layer])[0]
                sums[layer] = sums[layer] + gram if layer in sums else gram
    return {layer: total / len(images) for layer, total in sums.items()}


class StyleLosses(nn.Module):
    """Losses of images against the style of a target domain, with the networks that they need."""

    def __init__(self, features: FeatureNetwork) -> None:
        super().__init__()
        self.features = features
        widths = features.widths()
        for layer in STYLE_LAYERS:
            channels = widths[layer]
            self.register_buffer(f"gram_{layer}", torch.zeros(channels, channels))

    @classmethod
    def of_images(cls, features: FeatureNetwork, images: ImageSet) -> StyleLosses:
        """Losses against the mean style of some images."""
        losses = cls(features).to(device())
        for layer, gram in mean_gram_matrices(features, images).items():
            losses.get_buffer(f"gram_{layer}").copy_(gram)
        return losses

    def content(self, activations: Mapping[str, Tensor], wanted: Mapping[str, Tensor]) -> Tensor:
        """Relative squared difference of the content layer."""
        return _relative(activations[CONTENT_LAYER], wanted[CONTENT_LAYER])

    def style(self, activations: Mapping[str, Tensor]) -> Tensor:
        """Relative squared difference of the Gram matrices, mean over layers and images."""
        losses: list[Tensor] = []
        for layer in STYLE_LAYERS:
            grams = gram_matrix(activations[layer])
            wanted = self.get_buffer(f"gram_{layer}")
            losses.extend(_relative(gram, wanted) for gram in grams)
        return torch.stack(losses).mean()


def _relative(value: Tensor, wanted: Tensor) -> Tensor:
    return (value - wanted).square().sum() / (wanted.square().sum() + _TINY)


def total_variation(x: Tensor) -> Tensor:
    """Mean absolute difference of neighbouring pixels."""
    down, right = x[:, :, 1:] - x[:, :, :-1], x[:, :, :, 1:] - x[:, :, :, :-1]
    return down.abs().mean() + right.abs().mean()
