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
    AdversarialFit,
    AdversarialLearner,
    generator_loss,
    luminance_loss,
)
from s2rtools.translation.fit_loop import Batch
from s2rtools.translation.method import Option, Options, Settings
from s2rtools.translation.network_translator import NetworkTranslator
from s2rtools.translation.networks import (
    GeneratorSize,
    LatentDecoder,
    LatentEncoder,
    ResidualBlock,
    clipped,
)

STEPS = 3000
"""About 4 minutes on one core for images of 80 x 160 (0.09 s a step)."""
LEARNING_RATE = 2e-4
"""At 1e-3, fits of rooms invented bright spots."""
WEIGHTS = {
    "kl": Option(0.01, 0, 1000), "reconstruction": Option(10.0, 0, 1000),
    "cycle": Option(10.0, 0, 1000), "luminance": Option(0.5, 0, 1000),
}  # fmt: skip
DEFAULT_SIZE = GeneratorSize(blocks=2)
"""Blocks of each encoder and decoder, in addition to the shared ones."""


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
        return UnitNetwork(LatentEncoder(size), LatentDecoder(size), LatentDecoder(size))


class UnitLearner(AdversarialLearner):
    """Encoders and decoders of both domains."""

    def __init__(self, size: GeneratorSize, crop: tuple[int, int], weights: Options) -> None:
        code, image = ResidualBlock(4 * size.channels), ResidualBlock(4 * size.channels)
        coders: dict[str, nn.Module] = {}
        for domain in ("source", "target"):
            coders[f"{domain}_encoder"] = LatentEncoder(size, code)
            coders[f"{domain}_decoder"] = LatentDecoder(size, image)
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
            fooled = fooled + generator_loss(self.discriminators[other[name]], fake)
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


def _network(learner: AdversarialLearner) -> UnitNetwork:
    """All but the encoder of the target."""
    names = ("source_encoder", "source_decoder", "target_decoder")
    return UnitNetwork(*(learner.generators[name] for name in names))


METHOD = AdversarialFit(
    UnitTranslator, UnitLearner, _network, STEPS, LEARNING_RATE, WEIGHTS, DEFAULT_SIZE
).method("two autoencoders with a shared latent space")
