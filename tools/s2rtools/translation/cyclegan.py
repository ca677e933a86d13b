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
    AdversarialLearner,
    crop_size,
    fooling_loss,
    luminance_loss,
)
from s2rtools.translation.fit_loop import Batch, BatchSampler, FitPlan, provenance, run_fit
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitResult, FitSettings, TranslationMethod
from s2rtools.translation.method_options import (
    SIZE_OPTIONS,
    check_request,
    generator_size,
    number,
    whole_number,
)
from s2rtools.translation.network_size import GeneratorSize
from s2rtools.translation.network_translator import GeneratorTranslator
from s2rtools.translation.networks import Generator, initialised

STEPS = 2500
"""About 6 minutes on one core for images of 80 x 160 (0.15 s a step)."""
BATCH = 1
LEARNING_RATE = 2e-4
"""That of the source; at 1e-3 and at 4e-4, with and without spectral normalisation of the
discriminators, some seeds invented bright spots."""
OPTIONS = (*SIZE_OPTIONS, "batch", "rate", "cycle", "identity", "luminance")


class CycleGanTranslator(GeneratorTranslator):
    """The generator from source to target."""

    method = "cyclegan"


class CycleLearner(AdversarialLearner):
    """Generators `target` (source to target) and `source` (back)."""

    def __init__(
        self, size: GeneratorSize, crop: tuple[int, int], cycle: float, identity: float,
        luminance: float,
    ) -> None:  # fmt: skip
        generators = nn.ModuleDict({"target": Generator(size), "source": Generator(size)})
        super().__init__(generators, ("target", "source"), crop)
        self.cycle, self.identity, self.luminance = cycle, identity, luminance

    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        forth, back = self.generators["target"], self.generators["source"]
        # Instance normalisation treats each image alone: one pass for several images is the same.
        target, same_target = forth(torch.cat([batch.source, batch.target])).chunk(2)
        source, same_source = back(torch.cat([batch.target, batch.source])).chunk(2)
        returned = l1_loss(back(target), batch.source) + l1_loss(forth(source), batch.target)
        unchanged = l1_loss(same_target, batch.target) + l1_loss(same_source, batch.source)
        fooled = fooling_loss(self.discriminators["target"], target)
        fooled = fooled + fooling_loss(self.discriminators["source"], source)
        losses = {
            "adversarial": fooled,
            "cycle": self.cycle * returned,
            "identity": self.identity * unchanged,
        }
        if self.luminance:
            bright = luminance_loss(target, batch.source) + luminance_loss(source, batch.target)
            losses["luminance"] = self.luminance * bright
        return losses, {"target": target, "source": source}


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Train both generators; the one from source to target becomes the translator."""
    check_request("cyclegan", OPTIONS, source, target, settings)
    options = settings.options
    size = generator_size(options)
    weights = {
        "cycle": number(options, "cycle", 5.0, 0, 1000),
        "identity": number(options, "identity", 1.0, 0, 1000),
        "luminance": number(options, "luminance", 0.0, 0, 100),
    }
    batch = whole_number(options, "batch", BATCH, 1, 64)
    rate = number(options, "rate", LEARNING_RATE, 1e-7, 1.0)
    crop = crop_size(source)
    learner = initialised(settings.seed, lambda: CycleLearner(size, crop, **weights))
    sampler = BatchSampler(source, target, crop, batch, settings.seed)
    plan = FitPlan("cyclegan", STEPS, rate, {**size.document(), **weights})
    progress = run_fit(learner, sampler, plan, settings)
    network = learner.generators["target"]
    translator = CycleGanTranslator(network, source.size, size.document())
    return FitResult(translator, progress.history, provenance(progress, sampler, plan))


METHOD = TranslationMethod(
    "cyclegan", "two generators whose round trip returns the image", CycleGanTranslator, fit,
    learned=True, options=OPTIONS,
)  # fmt: skip
