"""UNIT: two variational autoencoders with a shared latent space and adversarial losses.

Source: Liu, Breuel and Kautz, "Unsupervised image-to-image translation networks", 2017, from its
formulas: weights 10 (adversarial), 0.1 (KL), 100 (reconstruction), 0.1 (KL of the cycle) and 100
(cycle), here divided by 10; Gaussians of unit variance; the last encoder block and first decoder
block are shared. Differences: least-squares adversarial losses, fewer channels and blocks, a
luminance loss of low weight, because nothing else in the losses keeps UNIT from exchanging bright
and dark, and an output that keeps the details of the image (`UnitNetwork`).
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
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Settings,
    TranslationMethod,
)
from s2rtools.translation.method_options import (
    SIZE_OPTIONS,
    check_request,
    generator_size,
    number,
    whole_number,
)
from s2rtools.translation.network_size import GeneratorSize
from s2rtools.translation.network_translator import NetworkTranslator
from s2rtools.translation.networks import (
    LatentDecoder,
    LatentEncoder,
    ResidualBlock,
    clipped,
    initialised,
)

STEPS = 3000
"""About 4 minutes on one core for images of 80 x 160 (0.09 s a step)."""
BATCH = 1
LEARNING_RATE = 2e-4
"""At 1e-3, fits of rooms invented bright spots."""
OPTIONS = (*SIZE_OPTIONS, "batch", "rate", "kl", "reconstruction", "cycle", "luminance")
DEFAULT_SIZE = GeneratorSize(blocks=2)
"""Blocks of each encoder and decoder, in addition to the shared ones."""


def _encoder(size: GeneratorSize, shared: nn.Module | None = None) -> LatentEncoder:
    return LatentEncoder(size, shared or ResidualBlock(4 * size.channels))


def _decoder(size: GeneratorSize, shared: nn.Module | None = None) -> LatentDecoder:
    return LatentDecoder(size, shared or ResidualBlock(4 * size.channels))


class UnitNetwork(nn.Module):
    """x + T(z) - S(z), where z is the mean latent code and T, S decode target and source.

    S(z) is the reconstruction of x: what both decoders blur cancels, and the details of x stay.
    """

    def __init__(self, encoder: nn.Module, source: nn.Module, target: nn.Module) -> None:
        super().__init__()
        self.encoder, self.source, self.target = encoder, source, target

    def forward(self, x: Tensor) -> Tensor:
        code = self.encoder(x)
        return clipped(x + self.target(code) - self.source(code))


class UnitTranslator(NetworkTranslator):
    """The autoencoder of the source and the decoder of the target."""

    method = "unit"

    @classmethod
    def build(cls, network_settings: Settings) -> nn.Module:
        size = GeneratorSize(**network_settings)
        return UnitNetwork(_encoder(size), _decoder(size), _decoder(size))


class UnitLearner(AdversarialLearner):
    """Encoders and decoders of both domains."""

    def __init__(
        self, size: GeneratorSize, crop: tuple[int, int], weights: Mapping[str, float]
    ) -> None:
        code, image = ResidualBlock(4 * size.channels), ResidualBlock(4 * size.channels)
        coders: dict[str, nn.Module] = {}
        for domain in ("source", "target"):
            coders[f"{domain}_encoder"] = _encoder(size, code)
            coders[f"{domain}_decoder"] = _decoder(size, image)
        super().__init__(nn.ModuleDict(coders), ("target", "source"), crop)
        self.weights = weights

    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        originals = {"source": batch.source, "target": batch.target}
        codes = {name: self.generators[f"{name}_encoder"](x) for name, x in originals.items()}
        other = {"source": "target", "target": "source"}
        zero = batch.source.new_zeros(())
        kl, reconstruction, cycle, bright, fooled = zero, zero, zero, zero, zero
        fakes = {}
        for name, original in originals.items():
            code = _sample(codes[name], batch.generator)
            reconstruction = reconstruction + l1_loss(self._decoded(name, code), original)
            fake = self._decoded(other[name], code)
            again = self.generators[f"{other[name]}_encoder"](fake)
            returned = self._decoded(name, _sample(again, batch.generator))
            cycle = cycle + l1_loss(returned, original)
            kl = kl + codes[name].square().mean() / 2 + again.square().mean() / 2
            bright = bright + luminance_loss(fake, original)
            fooled = fooled + fooling_loss(self.discriminators[other[name]], fake)
            fakes[other[name]] = fake
        parts = {"kl": kl, "reconstruction": reconstruction, "cycle": cycle, "luminance": bright}
        weighted = {name: self.weights[name] * value for name, value in parts.items()}
        return {"adversarial": fooled, **weighted}, fakes

    def _decoded(self, domain: str, code: Tensor) -> Tensor:
        image: Tensor = self.generators[f"{domain}_decoder"](code)
        return image


def _sample(mean: Tensor, generator: torch.Generator) -> Tensor:
    """A latent code of a Gaussian with unit variance."""
    noise = torch.randn(mean.shape, generator=generator, device=mean.device)
    return mean + noise


def fit(source: ImageSet, target: ImageSet, settings: FitSettings) -> FitResult:
    """Train both autoencoders; all but the encoder of the target becomes the translator."""
    check_request("unit", OPTIONS, source, target, settings)
    options = settings.options
    size = generator_size(options, DEFAULT_SIZE)
    defaults = {"kl": 0.01, "reconstruction": 10.0, "cycle": 10.0, "luminance": 0.5}
    weights = {name: number(options, name, value, 0, 1000) for name, value in defaults.items()}
    batch = whole_number(options, "batch", BATCH, 1, 64)
    rate = number(options, "rate", LEARNING_RATE, 1e-7, 1.0)
    crop = crop_size(source)
    learner = initialised(settings.seed, lambda: UnitLearner(size, crop, weights))
    sampler = BatchSampler(source, target, crop, batch, settings.seed)
    plan = FitPlan("unit", STEPS, rate, {**size.document(), **weights})
    progress = run_fit(learner, sampler, plan, settings)
    names = ("source_encoder", "source_decoder", "target_decoder")
    network = UnitNetwork(*(learner.generators[name] for name in names))
    translator = UnitTranslator(network, source.size, size.document())
    return FitResult(translator, progress.history, provenance(progress, sampler, plan))


METHOD = TranslationMethod(
    "unit", "two autoencoders with a shared latent space", UnitTranslator, fit,
    learned=True, options=OPTIONS,
)  # fmt: skip
