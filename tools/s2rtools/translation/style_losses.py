"""Content and style losses of Gatys, Ecker and Bethge, "Image style transfer using convolutional
neural networks", 2016.

Both are relative here: the squared difference is divided by the square of what is to be reached, so
that weights do not depend on the feature network or the size of the images.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from s2rtools.common.torch_device import device
from s2rtools.translation.feature_network import FeatureNetwork
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.network_translator import to_tensor

CONTENT_LAYER = "conv4_2"
STYLE_LAYERS = ("conv1_1", "conv2_1", "conv3_1", "conv4_1", "conv5_1")
_TINY = 1e-12


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
