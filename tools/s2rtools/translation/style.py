"""Neural style transfer by optimisation: each image is changed until its style is the target's.

Source: Gatys, Ecker and Bethge, "Image style transfer using convolutional neural networks", 2016:
content of conv4_2, Gram matrices of conv1_1 to conv5_1. Differences: the style is the mean of all
images of the target, the optimisation starts from the image itself and uses Adam for a fixed number
of iterations, and the change is kept smooth. One image takes about a second: `style-network` serves
robots.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Option,
    Options,
    Settings,
    TranslationMethod,
)
from s2rtools.translation.network_translator import NetworkTranslator
from s2rtools.translation.networks import check_fit_size
from s2rtools.translation.style_losses import (
    StyleLosses,
    build_features,
    fitted_features,
    total_variation,
)

MAX_ITERATIONS = 300
STEP = 0.02
"""Learning rate of Adam on pixels in -1 .. 1."""
SMOOTHNESS = 4.0
"""Weight of the total variation of the change, against coloured grain."""
OPTIONS = {
    "features": Option(""), "iterations": Option(60, 1, MAX_ITERATIONS),
    "weight": Option(5.0, 0, 1e6),
}  # fmt: skip


class StyleOptimisation(nn.Module):
    """Changes images until content and style losses are low; `weight` is that of the style."""

    def __init__(self, losses: StyleLosses, iterations: int, weight: float) -> None:
        super().__init__()
        self.losses, self.iterations, self.weight = losses, iterations, weight

    def forward(self, x: Tensor) -> Tensor:
        return torch.cat([self._optimised(image[None]) for image in x])

    def _optimised(self, original: Tensor) -> Tensor:
        with torch.no_grad():
            wanted = self.losses.features(original)
        image = original.clone().requires_grad_(True)
        optimizer = torch.optim.Adam([image], lr=STEP)
        for iteration in range(self.iterations):
            optimizer.param_groups[0]["lr"] = STEP * (1 - iteration / self.iterations)
            with torch.enable_grad():
                activations = self.losses.features(image)
                loss = self.losses.content(activations, wanted)
                loss = loss + self.weight * self.losses.style(activations)
                loss = loss + SMOOTHNESS * total_variation(image - original)
            (image.grad,) = torch.autograd.grad(loss, image)
            optimizer.step()
            with torch.no_grad():
                image.clamp_(-1, 1)
        return image.detach()


class StyleTranslator(NetworkTranslator):
    """The optimisation with its feature network and the Gram matrices of the target."""

    method = "style"
    quick = False

    @classmethod
    def build(cls, network_settings: Settings) -> nn.Module:
        iterations, weight = network_settings["iterations"], network_settings["weight"]
        if type(iterations) is not int or not 1 <= iterations <= MAX_ITERATIONS:
            raise ValueError(f"iterations {iterations}: a whole number up to {MAX_ITERATIONS}")
        if type(weight) is not float or not 0 <= weight <= 1e6:
            raise ValueError(f"weight {weight}: a number from 0 to 1000000")
        losses = StyleLosses(build_features(network_settings["layout"]))
        return StyleOptimisation(losses, iterations, weight)


def fit(source: ImageSet, target: ImageSet, settings: FitSettings, options: Options) -> FitResult:
    """Feature network and mean Gram matrices of the target; the budget is not used."""
    check_fit_size("style", source, 1)
    features, facts = fitted_features(source, target, settings, options["features"])
    check_fit_size("style", source, features.widths()["conv1_1"])
    losses = StyleLosses.of_images(features, target)
    document: dict[str, Any] = {
        "layout": features.layout, "iterations": options["iterations"],
        "weight": options["weight"],
    }  # fmt: skip
    network = StyleOptimisation(losses, options["iterations"], options["weight"])
    translator = StyleTranslator(network, source.size, document)
    settings.report(1.0, 0.0, 0.0)
    return FitResult(translator, [], {**facts, **document})


METHOD = TranslationMethod(
    "style", "style transfer by optimisation of each image (slow)", StyleTranslator, fit,
    learned=True, options=OPTIONS,
)  # fmt: skip
