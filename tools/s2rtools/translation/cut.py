"""CUT: one generator that keeps what is where, by contrasting patches before and after.

Source: Park, Efros, Zhang and Zhu, "Contrastive learning for unpaired image-to-image translation",
2020: features of the generator's encoder at the same place in input and output agree more than at
other places (InfoNCE with temperature 0.07), also for images of the target, which should stay as
they are. Differences: the generator outputs a change of its input and is smaller; 64 patches and
projections to 64 numbers in place of 256.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy, normalize

from s2rtools.translation.adversarial_training import (
    AdversarialFit,
    AdversarialLearner,
    generator_loss,
    luminance_loss,
)
from s2rtools.translation.fit_loop import Batch
from s2rtools.translation.method import Option, Options
from s2rtools.translation.network_translator import GeneratorTranslator
from s2rtools.translation.networks import Generator, GeneratorSize

STEPS = 4000
"""About 5 minutes on one core for images of 80 x 160 (0.07 s a step)."""
LEARNING_RATE = 5e-4
WEIGHTS = {"contrast": Option(1.0, 0, 100), "luminance": Option(0.0, 0, 100)}
TEMPERATURE = 0.07
PATCHES = 64
PROJECTION = 64


class CutTranslator(GeneratorTranslator):
    """The generator from source to target."""

    method = "cut"


class PatchContrast(nn.Module):
    """InfoNCE loss between features at the same places of two images.

    Each layer's features are projected by a network of two layers.
    """

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.projections = nn.ModuleList(
            nn.Sequential(
                nn.Linear(width, PROJECTION), nn.ReLU(), nn.Linear(PROJECTION, PROJECTION)
            )
            for width in widths
        )

    def forward(
        self, queries: list[Tensor], keys: list[Tensor], generator: torch.Generator
    ) -> Tensor:
        """Mean over layers, images and patches; `queries` and `keys` are lists of (B, C, h, w)."""
        losses = []
        for projection, query, key in zip(self.projections, queries, keys, strict=True):
            places = query.shape[2] * query.shape[3]
            order = torch.randperm(places, generator=generator, device=query.device)[:PATCHES]
            first, second = (
                normalize(projection(x.flatten(2)[:, :, order].transpose(1, 2)), dim=2)
                for x in (query, key)
            )
            alike = first @ second.detach().transpose(1, 2) / TEMPERATURE
            truth = torch.arange(len(order), device=query.device).repeat(len(query))
            losses.append(cross_entropy(alike.flatten(0, 1), truth))
        return torch.stack(losses).mean()


class CutLearner(AdversarialLearner):
    """The generator `target` and the projections of its features."""

    def __init__(self, size: GeneratorSize, crop: tuple[int, int], weights: Options) -> None:
        self.generator = Generator(size)
        self.compare = PatchContrast(_feature_widths(size.channels, size.blocks))
        modules = nn.ModuleDict({"target": self.generator, "contrast": self.compare})
        super().__init__(modules, ("target",), crop)
        self.weights = weights

    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        originals = torch.cat([batch.source, batch.target])
        both = self.generator(originals)
        before, after = self.generator.features(originals), self.generator.features(both)
        contrast = self.compare(after, before, batch.generator)
        fake = both[: len(batch.source)]
        losses = {
            "adversarial": generator_loss(self.discriminators["target"], fake),
            "contrast": self.weights["contrast"] * contrast,
        }
        if self.weights["luminance"]:
            bright = luminance_loss(fake, batch.source)
            losses["luminance"] = self.weights["luminance"] * bright
        return losses, {"target": fake}


def _feature_widths(channels: int, blocks: int) -> tuple[int, ...]:
    """Channels of `Generator.features`."""
    deep = 4 * channels
    return (channels, 2 * channels, deep) + (deep,) * len({0, blocks // 2})


METHOD = AdversarialFit(
    CutTranslator, CutLearner, lambda learner: learner.generators["target"], STEPS, LEARNING_RATE,
    WEIGHTS,
).method("one generator, contrasting patches before and after")  # fmt: skip
