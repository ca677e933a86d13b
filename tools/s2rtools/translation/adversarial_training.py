"""Adversarial training that CycleGAN, CUT, UNIT and the residual method share.

Least-squares losses: Mao et al., "Least squares generative adversarial networks", 2017. Image pool:
Shrivastava et al., "Learning from simulated and unsupervised images through adversarial training",
2017.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn

from s2rtools.common.checkpoint import FitState
from s2rtools.common.torch_device import device
from s2rtools.translation.fit_loop import (
    Batch,
    BatchSampler,
    FitPlan,
    Learner,
    run_fit,
)
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Option,
    Options,
    TranslationMethod,
)
from s2rtools.translation.network_translator import NetworkTranslator, placed
from s2rtools.translation.networks import (
    GeneratorSize,
    PatchDiscriminator,
    check_fit_size,
    chosen_size,
    initialised,
    luminance_image,
    size_options,
)

POOL = 50
"""Earlier translations that a discriminator sees again."""
BETAS = (0.5, 0.999)
DISCRIMINATOR_CHANNELS = 24
CROP_PIXELS = 64 * 96


def crop_size(images: ImageSet) -> tuple[int, int]:
    """Rows and columns of training crops: about `CROP_PIXELS` in the aspect of the images."""
    height, width = images.size
    scale = min(1.0, (CROP_PIXELS / (height * width)) ** 0.5)
    return max(1, round(height * scale / 8)) * 8, max(1, round(width * scale / 8)) * 8


def generator_loss(discriminator: nn.Module, fake: Tensor) -> Tensor:
    """Mean of (D(fake) - 1)^2."""
    loss: Tensor = (discriminator(fake) - 1).square().mean()
    return loss


def discriminator_loss(discriminator: nn.Module, real: Tensor, fake: Tensor) -> Tensor:
    """Half the mean of (D(real) - 1)^2 and D(fake)^2."""
    loss: Tensor = (discriminator(real) - 1).square().mean() + discriminator(fake).square().mean()
    return loss / 2


def luminance_loss(translated: Tensor, original: Tensor) -> Tensor:
    """Mean of 1 - r, where r is the correlation of luminance over the pixels of each image.

    0 where bright stays bright, 2 where bright and dark are exchanged; flat images count as 1.
    """
    both = [luminance_image(x).flatten(1) for x in (translated, original)]
    first, second = (x - x.mean(dim=1, keepdim=True) for x in both)
    product = (first * second).mean(dim=1)
    spread = first.square().mean(dim=1) * second.square().mean(dim=1)
    return (1 - product / (spread + 1e-6).sqrt()).mean()


class ImagePool:
    """The last translations; half of a batch is exchanged for older ones once the pool is full."""

    def __init__(self, crop: tuple[int, int]) -> None:
        self.images = torch.zeros(POOL, 3, *crop, device=device())
        self.count = torch.zeros(1, dtype=torch.int64)

    def exchange(self, fakes: Tensor, generator: torch.Generator) -> Tensor:
        """Store translations (B, 3, h, w) and return as many new or old ones."""
        chosen = []
        numbers = torch.rand(len(fakes), 2, generator=generator, device=generator.device).cpu()
        for fake, (keep, place) in zip(fakes.detach(), numbers.tolist(), strict=True):
            count = int(self.count)
            if count < POOL:
                self.images[count] = fake
                self.count += 1
                chosen.append(fake)
            elif keep < 0.5:
                chosen.append(fake)
            else:
                index = int(place * POOL)
                chosen.append(self.images[index].clone())
                self.images[index] = fake
        return torch.stack(chosen)


class AdversarialLearner(Learner):
    """Generators against one patch discriminator per domain in `domains`.

    A subclass computes the losses of the generators.
    """

    max_gradient = 1.0

    def __init__(
        self, generators: nn.ModuleDict, domains: tuple[str, ...], crop: tuple[int, int]
    ) -> None:
        self.generators = generators
        placed(generators)
        self.discriminators = nn.ModuleDict(
            {
                domain: PatchDiscriminator.for_size(DISCRIMINATOR_CHANNELS, *crop)
                for domain in domains
            }
        )
        placed(self.discriminators)
        self.pools = {domain: ImagePool(crop) for domain in domains}
        buffers = {f"{domain}/images": pool.images for domain, pool in self.pools.items()}
        buffers |= {f"{domain}/count": pool.count for domain, pool in self.pools.items()}
        self.state = FitState(
            nn.ModuleDict({"generators": generators, "discriminators": self.discriminators}),
            {
                "generators": torch.optim.Adam(self.generators.parameters(), betas=BETAS),
                "discriminators": torch.optim.Adam(self.discriminators.parameters(), betas=BETAS),
            },
            buffers,
        )

    @abstractmethod
    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        """Weighted losses of the generators by name, and the translations by domain."""

    def step(self, batch: Batch) -> Mapping[str, Tensor]:
        self.discriminators.requires_grad_(False)
        losses, fakes = self.generator_losses(batch)
        total = torch.stack(list(losses.values())).sum()
        self.update(total, "generators")
        self.discriminators.requires_grad_(True)
        reals = {"source": batch.source, "target": batch.target}
        parts = [
            discriminator_loss(
                self.discriminators[domain],
                reals[domain],
                self.pools[domain].exchange(fake, batch.generator),
            )
            for domain, fake in fakes.items()
        ]
        told_apart = torch.stack(parts).sum()
        self.update(told_apart, "discriminators")
        named = {name: value.detach() for name, value in losses.items()}
        return {"loss": total.detach(), **named, "discriminator": told_apart.detach()}


@dataclass(frozen=True, slots=True)
class AdversarialFit:
    """A fit of two networks against each other, from which `method` makes a method.

    `learner` builds the networks from their size, the size of crops and the options named in
    `weights`, which weigh the losses; `network` is what of it the translator applies.
    """

    translator: type[NetworkTranslator]
    learner: Callable[[GeneratorSize, tuple[int, int], Options], AdversarialLearner]
    network: Callable[[AdversarialLearner], nn.Module]
    steps: int
    learning_rate: float
    weights: Mapping[str, Option]
    size: GeneratorSize = field(default_factory=GeneratorSize)

    def method(self, description: str) -> TranslationMethod:
        """The method with its options."""
        options = {
            **size_options(self.size), "batch": Option(1, 1, 64),
            "rate": Option(self.learning_rate, 1e-7, 1.0), **self.weights,
        }  # fmt: skip
        return TranslationMethod(
            self.translator.method, description, self.translator, self._fit,
            learned=True, options=options,
        )  # fmt: skip

    def _fit(
        self, source: ImageSet, target: ImageSet, settings: FitSettings, options: Options
    ) -> FitResult:
        name, size = self.translator.method, chosen_size(options)
        check_fit_size(name, source, size.channels)
        weights: dict[str, Any] = {key: options[key] for key in self.weights}
        crop = crop_size(source)
        learner = initialised(settings.seed, lambda: self.learner(size, crop, weights))
        sampler = BatchSampler(source, target, crop, options["batch"], settings.seed)
        plan = FitPlan(name, self.steps, options["rate"], {**size.document(), **weights})
        history, facts = run_fit(learner, sampler, plan, settings)
        translator = self.translator(self.network(learner), source.size, size.document())
        return FitResult(translator, history, facts)
