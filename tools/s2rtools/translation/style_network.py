"""Neural style transfer by one network: a generator trained with the losses of `style`.

Source: Johnson, Alahi and Fei-Fei, "Perceptual losses for real-time style transfer and
super-resolution", 2016: content and style losses of a fixed feature network, and total variation.
Differences: the style is the mean of all images of the target, the generator outputs a change of
its input of at most a quarter of the range, content and style losses are relative.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from s2rtools.common.checkpoint import FitState
from s2rtools.translation.adversarial_training import crop_size
from s2rtools.translation.fit_loop import (
    Batch,
    BatchSampler,
    FitPlan,
    Learner,
    run_fit,
)
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitResult, FitSettings, Option, Options, TranslationMethod
from s2rtools.translation.network_translator import GeneratorTranslator, placed
from s2rtools.translation.networks import (
    Generator,
    GeneratorSize,
    check_fit_size,
    chosen_size,
    initialised,
    size_options,
)
from s2rtools.translation.style_losses import StyleLosses, fitted_features, total_variation

STEPS = 800
LEARNING_RATE = 2e-4
SMOOTHNESS = 4.0
BOUND = 0.5
OPTIONS = {
    **size_options(GeneratorSize(blocks=3)), "batch": Option(2, 1, 64), "features": Option(""),
    "weight": Option(5.0, 0, 1e6),
}  # fmt: skip


class StyleNetworkTranslator(GeneratorTranslator):
    """The trained generator."""

    method = "style-network"


class StyleNetworkLearner(Learner):
    """A generator against fixed content and style losses; `weight` is that of the style."""

    def __init__(self, generator: Generator, losses: StyleLosses, weight: float) -> None:
        self.generator, self.losses, self.weight = generator, losses, weight
        self.state = FitState(generator, {"all": torch.optim.Adam(generator.parameters())})

    def step(self, batch: Batch) -> Mapping[str, Tensor]:
        translated = self.generator(batch.source)
        with torch.no_grad():
            wanted = self.losses.features(batch.source)
        activations = self.losses.features(translated)
        content = self.losses.content(activations, wanted)
        style = self.losses.style(activations)
        rough = total_variation(translated - batch.source)
        loss = content + self.weight * style + SMOOTHNESS * rough
        self.update(loss)
        return {"loss": loss.detach(), "content": content.detach(), "style": style.detach()}


def fit(source: ImageSet, target: ImageSet, settings: FitSettings, options: Options) -> FitResult:
    """Train the generator on images of the source; the budget counts without the features."""
    size, weight = chosen_size(options, BOUND), options["weight"]
    check_fit_size("style-network", source, size.channels)
    features, facts = fitted_features(source, target, settings, options["features"])
    generator = initialised(settings.seed, lambda: Generator(size))
    placed(generator)
    losses = StyleLosses.of_images(features, target).requires_grad_(False)
    learner = StyleNetworkLearner(generator, losses, weight)
    sampler = BatchSampler(source, target, crop_size(source), options["batch"], settings.seed)
    identity = {key: value for key, value in facts.items() if not key.endswith("seconds")}
    plan = FitPlan(
        "style-network", STEPS, LEARNING_RATE, {**size.document(), "weight": weight, **identity}
    )
    history, fitted = run_fit(learner, sampler, plan, settings)
    translator = StyleNetworkTranslator(generator, source.size, size.document())
    return FitResult(translator, history, facts | fitted)


METHOD = TranslationMethod(
    "style-network", "style transfer by one network", StyleNetworkTranslator, fit,
    learned=True, options=OPTIONS,
)  # fmt: skip
