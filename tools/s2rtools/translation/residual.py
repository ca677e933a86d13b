"""`mkl+residual`: the linear map of `mkl`, then a small network with a bounded change.

Paired fits regress the target (mean absolute difference). Unpaired fits train against a patch
discriminator; the change must keep gradients, and images of the target must stay as they are.

The fit is safe: the change is multiplied by the share in 0 .. 1 that is best on held-out images of
both domains, by the mean absolute difference of pairs, or by `patch_distance`. The share is 0, and
the translator equals `mkl`, unless that is better by `MIN_GAIN`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import l1_loss

from s2rtools.common.checkpoint import FitState
from s2rtools.common.wasserstein import sliced_wasserstein
from s2rtools.translation.adversarial_training import (
    AdversarialLearner,
    crop_size,
    generator_loss,
)
from s2rtools.translation.colour_statistics import Floats, linear_map, moments, transport
from s2rtools.translation.fit_loop import (
    Batch,
    BatchSampler,
    FitPlan,
    Learner,
    run_fit,
)
from s2rtools.translation.image_set import ImageSet, Rgb, resize
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    Option,
    Options,
    Settings,
    TranslationMethod,
)
from s2rtools.translation.network_translator import NetworkTranslator, placed
from s2rtools.translation.networks import (
    Generator,
    GeneratorSize,
    check_fit_size,
    chosen_size,
    clipped,
    initialised,
    size_options,
)

STEPS = 900
PAIRED_RATE, UNPAIRED_RATE = 1e-3, 3e-4
"""Learning rates; at 1e-3, the discriminator drove the change to its bound."""
IDENTITY_WEIGHT, GRADIENT_WEIGHT = 0.5, 0.5
SHARES = (0.25, 0.5, 0.75, 1.0)
MIN_GAIN = 0.02
HELD_OUT = 0.15
_FEW_IMAGES = 8
PATCH, PATCHES, SCALES = 5, 4096, (1, 2, 4)
OPTIONS = {
    **size_options(GeneratorSize(blocks=2)), "batch": Option(2, 1, 64),
    "bound": Option(0.25, 0.001, 1.0),
}  # fmt: skip
"""`bound` is the largest change as a share of the range of grey levels."""


class ResidualNetwork(nn.Module):
    """clip(matrix x + offset), plus `share` of the generator's change of that."""

    def __init__(self, size: GeneratorSize) -> None:
        super().__init__()
        self.generator = Generator(size, normalised=False)
        self.register_buffer("matrix", torch.eye(3))
        self.register_buffer("offset", torch.zeros(3))
        self.register_buffer("share", torch.ones(1))

    def set_map(self, source: ImageSet, target: ImageSet) -> None:
        """The linear map of `mkl`, for images in -1 .. 1."""
        before, after = moments(source.images), moments(target.images)
        matrix = transport(before, after)
        offset = (after[0] - 127.5 - matrix @ (before[0] - 127.5)) / 127.5
        self.get_buffer("matrix").copy_(torch.from_numpy(matrix))
        self.get_buffer("offset").copy_(torch.from_numpy(offset))

    def colour_map(self) -> tuple[Floats, Floats]:
        """Matrix (3, 3) and offset (3,) of the linear map for grey levels."""
        matrix, offset = (
            self.get_buffer(name).detach().cpu().numpy().astype(np.float64)
            for name in ("matrix", "offset")
        )
        return matrix, 127.5 * (offset + 1 - matrix.sum(axis=1))

    def mapped(self, x: Tensor) -> Tensor:
        """Images after the linear map."""
        linear = torch.einsum("ij,bjhw->bihw", self.get_buffer("matrix"), x)
        return (linear + self.get_buffer("offset").view(3, 1, 1)).clamp(-1, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.changed(self.mapped(x))

    def changed(self, mapped: Tensor) -> Tensor:
        """Images after the linear map plus the share of the generator's change."""
        share = self.get_buffer("share")
        if float(share) == 0:
            return mapped
        return clipped(mapped + share * (self.generator(mapped) - mapped))


class ResidualTranslator(NetworkTranslator):
    """The linear map at the size of the image, then the network at the working size."""

    method = "mkl+residual"
    network: ResidualNetwork

    def apply(self, rgb: Rgb) -> Rgb:
        matrix, offset = self.network.colour_map()
        mapped = linear_map(rgb, matrix, offset)
        return super().apply(mapped) if float(self.network.get_buffer("share")) else mapped

    def _forward(self, x: Tensor) -> Tensor:
        return self.network.changed(x)

    @classmethod
    def build(cls, network_settings: Settings) -> nn.Module:
        return ResidualNetwork(GeneratorSize(**network_settings))


class PairedLearner(Learner):
    """Mean absolute difference to the counterpart."""

    def __init__(self, network: ResidualNetwork) -> None:
        self.network = network
        self.state = FitState(network, {"all": torch.optim.Adam(network.parameters())})

    def step(self, batch: Batch) -> Mapping[str, Tensor]:
        loss = l1_loss(self.network(batch.source), batch.target)
        self.update(loss)
        return {"loss": loss.detach()}


class UnpairedLearner(AdversarialLearner):
    """Adversarial loss, gradients kept, images of the target unchanged."""

    def __init__(self, network: ResidualNetwork, crop: tuple[int, int]) -> None:
        super().__init__(nn.ModuleDict({"network": network}), ("target",), crop)
        self.network = network

    def generator_losses(self, batch: Batch) -> tuple[Mapping[str, Tensor], Mapping[str, Tensor]]:
        mapped = self.network.mapped(batch.source)
        fake, same = self.network.generator(torch.cat([mapped, batch.target])).chunk(2)
        losses = {
            "adversarial": generator_loss(self.discriminators["target"], fake),
            "identity": IDENTITY_WEIGHT * l1_loss(same, batch.target),
            "gradients": GRADIENT_WEIGHT * _gradient_loss(fake, mapped),
        }
        return losses, {"target": fake}


def _gradient_loss(first: Tensor, second: Tensor) -> Tensor:
    """Mean absolute difference of the differences between neighbouring pixels."""
    change = first - second
    down, right = change[:, :, 1:] - change[:, :, :-1], change[..., 1:] - change[..., :-1]
    return down.abs().mean() + right.abs().mean()


def held_out_rows(groups: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Rows to hold out: the last ones of each recording, so that every light is judged.

    At least one row; no rows where there are fewer than `_FEW_IMAGES`.
    """
    chosen = np.zeros(len(groups), dtype=bool)
    if len(groups) < _FEW_IMAGES:
        return chosen
    for code in np.unique(groups):
        rows = np.flatnonzero(groups == code)
        chosen[rows[len(rows) - int(HELD_OUT * len(rows)) :]] = True
    if not chosen.any():
        chosen[-max(1, int(HELD_OUT * len(groups))) :] = True
    return chosen


def fit(source: ImageSet, target: ImageSet, settings: FitSettings, options: Options) -> FitResult:
    """Fit the linear map, train the network, choose its share on held-out images."""
    size = chosen_size(options, 2 * options["bound"])
    check_fit_size("mkl+residual", source, size.channels)
    source_out = held_out_rows(source.groups)
    target_out = source_out if settings.paired else held_out_rows(target.groups)
    train = source.rows(np.flatnonzero(~source_out)), target.rows(np.flatnonzero(~target_out))
    judged = (
        source.rows(np.flatnonzero(source_out)) if source_out.any() else source,
        target.rows(np.flatnonzero(target_out)) if target_out.any() else target,
    )
    crop = crop_size(source)

    def build() -> PairedLearner | UnpairedLearner:
        network = ResidualNetwork(size)
        network.set_map(*train)
        placed(network)
        return PairedLearner(network) if settings.paired else UnpairedLearner(network, crop)

    learner = initialised(settings.seed, build)
    sampler = BatchSampler(*train, crop, options["batch"], settings.seed, settings.paired)
    rate = PAIRED_RATE if settings.paired else UNPAIRED_RATE
    plan = FitPlan("mkl+residual", STEPS, rate, size.document())
    history, fitted = run_fit(learner, sampler, plan, settings)
    translator = ResidualTranslator(learner.network, source.size, size.document())
    facts = {
        "held_out": bool(source_out.any() and target_out.any()),
        **_choose_share(translator, *judged, settings),
    }
    return FitResult(translator, history, facts | fitted)


def _choose_share(
    translator: ResidualTranslator, source: ImageSet, target: ImageSet, settings: FitSettings
) -> dict[str, object]:
    """Set the share of the change that is best on held-out images; returns the figures."""
    buffer = translator.network.get_buffer("share")

    def distance(share: float) -> float:
        buffer.fill_(share)
        translated = translator.translate(source.images)
        if settings.paired:
            return float(np.abs(translated.astype(np.float32) - target.images).mean())
        return patch_distance(translated, target.images, settings.seed)

    linear = distance(0.0)
    distances = {share: distance(share) for share in SHARES}
    best = min(distances, key=lambda share: distances[share])
    if not distances[best] < (1 - MIN_GAIN) * linear:
        best = 0.0
    buffer.fill_(best)
    return {
        "criterion": "mean absolute difference" if settings.paired else "patch distance",
        "distance_mkl": round(linear, 4),
        "distance_residual": round(min(distances.values()), 4),
        "share": best,
        "fallback": best == 0,
    }


def patch_distance(first: Rgb, second: Rgb, seed: int = 0) -> float:
    """Sliced Wasserstein distance of small patches, grey levels; equal sets have about 0.

    Mean over three scales. Source:
    Karras et al., "Progressive growing of GANs for improved quality, stability, and variation",
    2018. The same places are taken from sets of one shape, so that two translations of the same
    images are compared with little noise.
    """
    distances = []
    for scale in SCALES:
        both = [_patches(_reduced(images, scale), seed) for images in (first, second)]
        width = min(len(values) for values in both)
        distances.append(sliced_wasserstein(both[0][:width], both[1][:width], seed=seed))
    return float(np.mean(distances))


def _reduced(images: Rgb, scale: int) -> Rgb:
    height, width = images.shape[1:3]
    return resize(images, (max(PATCH, height // scale), max(PATCH, width // scale)))


def _patches(images: Rgb, seed: int) -> NDArray[np.float32]:
    """Random patches (`PATCHES`, 75) of images."""
    rng = np.random.default_rng(seed)
    count, height, width = images.shape[:3]
    rows = rng.integers(count, size=PATCHES)
    tops = rng.integers(height - PATCH + 1, size=PATCHES)
    lefts = rng.integers(width - PATCH + 1, size=PATCHES)
    steps = np.arange(PATCH)
    patches = images[
        rows[:, None, None], tops[:, None, None] + steps[:, None], lefts[:, None, None] + steps
    ]
    return patches.reshape(PATCHES, -1).astype(np.float32)


METHOD = TranslationMethod(
    "mkl+residual", "linear map and a small network with a bounded change", ResidualTranslator, fit,
    learned=True, options=OPTIONS, uses_pairs=True,
)  # fmt: skip
