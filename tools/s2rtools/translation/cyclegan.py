"""CycleGAN: two generators whose round trip returns the image.

Source: Zhu, Park, Isola and Efros, "Unpaired image-to-image translation using cycle-consistent
adversarial networks", 2017: least-squares adversarial losses, cycle and identity losses, image
pool, linear decay of the learning rate. Differences: generators output a change of their input (of
up to the full range) and have fewer channels and blocks; the weights of the cycle and identity
losses are 5 and 1 in place of 10 and 5, with which fits of a few hundred steps hardly changed the
images. The options `cycle`, `identity` and `rate` (of learning) set these values.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn.functional import l1_loss

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

STEPS = 2500
"""About 6 minutes on one core for images of 80 x 160 (0.15 s a step)."""
LEARNING_RATE = 2e-4
"""That of the source; at 1e-3 and at 4e-4, with and without spectral normalisation of the
discriminators, some seeds invented bright spots."""
WEIGHTS = {
    "cycle": Option(5.0, 0, 1000), "identity": Option(1.0, 0, 1000),
    "luminance": Option(0.0, 0, 100),
}  # fmt: skip


class CycleGanTranslator(GeneratorTranslator):
    """The generator from source to target."""

    method = "cyclegan"


class CycleLearner(AdversarialLearner):
    """Generators `target` (source to target) and `source` (back)."""

    def __init__(self, size: GeneratorSize, crop: tuple[int, int], weights: Options) -> None:
        generators = nn.ModuleDict({"target": Generator(size), "source": Generator(size)})
        super().__init__(generators, ("target", "source"), crop)
        self.weights = weights

    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        forth, back = self.generators["target"], self.generators["source"]
        # Instance normalisation treats each image alone: one pass for several images is the same.
        target, same_target = forth(torch.cat([batch.source, batch.target])).chunk(2)
        source, same_source = back(torch.cat([batch.target, batch.source])).chunk(2)
        returned = l1_loss(back(target), batch.source) + l1_loss(forth(source), batch.target)
        unchanged = l1_loss(same_target, batch.target) + l1_loss(same_source, batch.source)
        fooled = generator_loss(self.discriminators["target"], target)
        fooled = fooled + generator_loss(self.discriminators["source"], source)
        losses = {
            "adversarial": fooled,
            "cycle": self.weights["cycle"] * returned,
            "identity": self.weights["identity"] * unchanged,
        }
        if self.weights["luminance"]:
            bright = luminance_loss(target, batch.source) + luminance_loss(source, batch.target)
            losses["luminance"] = self.weights["luminance"] * bright
        return losses, {"target": target, "source": source}


METHOD = AdversarialFit(
    CycleGanTranslator, CycleLearner, lambda learner: learner.generators["target"], STEPS,
    LEARNING_RATE, WEIGHTS,
).method("two generators whose round trip returns the image")  # fmt: skip
