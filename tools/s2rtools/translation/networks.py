"""Networks of the learned methods; images are (B, 3, h, w) float32 in -1 .. 1.

`Generator` and `PatchDiscriminator` follow Zhu et al., "Unpaired image-to-image translation using
cycle-consistent adversarial networks", 2017, with fewer channels and blocks, because they are
trained on two processor cores.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import Option, Options

REDUCTION = 4
"""Factor by which `Encoder` reduces both edges."""
MIN_EDGE = 16

Kind = TypeVar("Kind")

MAX_CHANNELS, MAX_BLOCKS = 128, 16
MAX_EDGE = 1024
"""Pixels of the longer edge of images at the working size."""
MAX_VALUES = 32 << 20
"""Values of one feature map at the working size (pixels times channels)."""


@dataclass(frozen=True, slots=True)
class GeneratorSize:
    """Channels at full resolution, residual blocks, and the limit of the change.

    `bound` is the largest change of an image in -1 .. 1; 2 reaches every colour from every colour.
    Raises ValueError for values out of range.
    """

    channels: int = 16
    blocks: int = 4
    bound: float = 2.0

    def __post_init__(self) -> None:
        whole = type(self.channels) is int and type(self.blocks) is int
        if not whole or not 1 <= self.channels <= MAX_CHANNELS:
            raise ValueError(f"channels {self.channels}: a whole number up to {MAX_CHANNELS}")
        if not 1 <= self.blocks <= MAX_BLOCKS:
            raise ValueError(f"blocks {self.blocks}: a whole number up to {MAX_BLOCKS}")
        if type(self.bound) not in (int, float) or not 0 < self.bound <= 2:
            raise ValueError(f"bound {self.bound}: a number above 0, at most 2")

    def document(self) -> dict[str, Any]:
        return asdict(self)


def check_working_size(size: tuple[int, int], channels: int) -> None:
    """Raise ValueError where features at a working size (rows, columns) need too much memory.

    The pixels are those of a square with the longer edge, because images may have any aspect.
    """
    edge = max(size)
    if edge > MAX_EDGE:
        raise ValueError(f"images of {edge} pixels; networks translate up to {MAX_EDGE}")
    if edge**2 * channels > MAX_VALUES:
        most = int((MAX_VALUES / channels) ** 0.5)
        raise ValueError(f"images of {edge} pixels with {channels} channels; at most {most} pixels")


def check_fit_size(name: str, images: ImageSet, channels: int) -> None:
    """Raise RequestError for images too large for a network with `channels` at full size."""
    try:
        check_working_size(images.size, channels)
    except ValueError as error:
        raise RequestError(f"{name}: {error}; fit at a smaller size") from error


def size_options(size: GeneratorSize) -> dict[str, Option]:
    """The options `channels` and `blocks` of a method whose default size is `size`."""
    return {
        "channels": Option(size.channels, 1, MAX_CHANNELS),
        "blocks": Option(size.blocks, 1, MAX_BLOCKS),
    }


def chosen_size(options: Options, bound: float = 2.0) -> GeneratorSize:
    """The size that the options `channels` and `blocks` name."""
    return GeneratorSize(options["channels"], options["blocks"], bound)


def initialised(seed: int, build: Callable[[], Kind]) -> Kind:
    """What `build` makes with random weights of `seed`; torch's global generator is unchanged."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return build()


def _norm(channels: int, normalised: bool) -> nn.Module:
    return nn.InstanceNorm2d(channels) if normalised else nn.Identity()


def _convolution(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, padding_mode="reflect")


class ResidualBlock(nn.Module):
    """x plus two 3 x 3 convolutions of x."""

    def __init__(self, channels: int, normalised: bool = True) -> None:
        super().__init__()
        self.change = nn.Sequential(
            _convolution(channels, channels, 3), _norm(channels, normalised), nn.ReLU(),
            _convolution(channels, channels, 3), _norm(channels, normalised),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        return x + self.change(x)


class Encoder(nn.Sequential):
    """Images to 4 `channels` features at a quarter of the edges, in three stages."""

    def __init__(self, channels: int, normalised: bool = True) -> None:
        super().__init__(
            *(
                nn.Sequential(
                    _convolution(inputs, outputs, kernel, stride),
                    _norm(outputs, normalised),
                    nn.ReLU(),
                )
                for inputs, outputs, kernel, stride in (
                    (3, channels, 7, 1),
                    (channels, 2 * channels, 3, 2),
                    (2 * channels, 4 * channels, 3, 2),
                )
            )
        )


class Decoder(nn.Sequential):
    """Features of an `Encoder` to three channels at the size of the image, without activation.

    Bilinear upsampling before each convolution; transposed convolutions left a grid of dots on the
    lines of roads.
    """

    def __init__(self, channels: int, normalised: bool = True) -> None:
        super().__init__(
            *(
                nn.Sequential(
                    nn.Upsample(scale_factor=2, mode="bilinear"),
                    _convolution(2 * outputs, outputs, 3),
                    _norm(outputs, normalised),
                    nn.ReLU(),
                )
                for outputs in (2 * channels, channels)
            ),
            _convolution(channels, 3, 7),
        )


class Generator(nn.Module):
    """A residual network that changes its input by at most `bound`.

    The last layer starts at zero, so that an untrained generator returns its input. This differs
    from Zhu et al., whose generator makes the whole image. Without instance normalisation
    (`normalised`) it learns maps of colours that are the same in all images. The features at full
    resolution are added before the last layer, so that changes end at edges.
    """

    def __init__(self, size: GeneratorSize, normalised: bool = True) -> None:
        super().__init__()
        self.bound, width = size.bound, 4 * size.channels
        self.encoder = Encoder(size.channels, normalised)
        self.blocks = nn.Sequential(*(ResidualBlock(width, normalised) for _ in range(size.blocks)))
        self.decoder = Decoder(size.channels, normalised)
        if not normalised:
            for layer in self.modules():
                if isinstance(layer, nn.Conv2d):
                    nn.init.kaiming_normal_(layer.weight)
        last = self.decoder[-1]
        nn.init.zeros_(last.weight)  # type: ignore[arg-type]
        nn.init.zeros_(last.bias)  # type: ignore[arg-type]

    def forward(self, x: Tensor) -> Tensor:
        fine = self.encoder[0](x)
        deep = self.blocks(self.encoder[2](self.encoder[1](fine)))
        change = self.decoder[2](self.decoder[1](self.decoder[0](deep)) + fine)
        return clipped(x + self.bound * torch.tanh(change))

    def features(self, x: Tensor) -> list[Tensor]:
        """Outputs of the three encoder stages, of the first and of the middle residual block."""
        found = [x := stage(x) for stage in self.encoder]
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in (0, len(self.blocks) // 2):
                found.append(x)
        return found


def clipped(x: Tensor) -> Tensor:
    """Clip to -1 .. 1; the gradient passes unchanged, so that clipped pixels can return."""
    return x + (x.clamp(-1, 1) - x).detach()


def luminance_image(x: Tensor) -> Tensor:
    """Luminance (B, 1, h, w) of RGB images, weights of ITU-R BT.601."""
    return (x * x.new_tensor([0.299, 0.587, 0.114]).view(3, 1, 1)).sum(dim=1, keepdim=True)


class PatchDiscriminator(nn.Module):
    """Scores (B, 1, ., .) of overlapping patches: high for real images.

    With three strided layers a patch has 70 x 70 pixels; `for_size` takes fewer layers for small
    images. Unlike that of Zhu et al. it has no instance normalisation, which hides the colours of a
    patch: without it, short fits came closer to the true counterparts.
    """

    def __init__(self, channels: int, layers: int) -> None:
        super().__init__()
        parts: list[nn.Module] = [nn.Conv2d(3, channels, 4, 2, 1), nn.LeakyReLU(0.2)]
        width = channels
        for number in range(1, layers + 1):
            inputs, width = width, channels * min(8, 2**number)
            stride = 1 if number == layers else 2
            parts += [nn.Conv2d(inputs, width, 4, stride, 1), nn.LeakyReLU(0.2)]
        self.score = nn.Sequential(*parts, nn.Conv2d(width, 1, 4, 1, 1))

    @classmethod
    def for_size(cls, channels: int, height: int, width: int) -> PatchDiscriminator:
        """Patches of 70, 34 or 16 pixels, at most about half of the shorter edge."""
        edge = min(height, width)
        return cls(channels, 3 if edge >= 128 else 2 if edge >= 48 else 1)

    def forward(self, x: Tensor) -> Tensor:
        scores: Tensor = self.score(x)
        return scores


class LatentEncoder(nn.Module):
    """Mean (B, 4 k, h/4, w/4) of a Gaussian with unit variance over latent codes.

    `shared` is the last block, the same module in both domains; None: a block of its own. Source:
    Liu, Breuel and Kautz, "Unsupervised image-to-image translation networks", 2017.
    """

    def __init__(self, size: GeneratorSize, shared: nn.Module | None = None) -> None:
        super().__init__()
        shared = shared or ResidualBlock(4 * size.channels)
        self.encoder = Encoder(size.channels)
        self.blocks = nn.Sequential(*(ResidualBlock(4 * size.channels) for _ in range(size.blocks)))
        self.shared = shared

    def forward(self, x: Tensor) -> Tensor:
        mean: Tensor = self.shared(self.blocks(self.encoder(x)))
        return mean


class LatentDecoder(nn.Module):
    """Images of latent codes; `shared` is the first block, the same module in both domains."""

    def __init__(self, size: GeneratorSize, shared: nn.Module | None = None) -> None:
        super().__init__()
        shared = shared or ResidualBlock(4 * size.channels)
        self.shared = shared
        self.blocks = nn.Sequential(*(ResidualBlock(4 * size.channels) for _ in range(size.blocks)))
        self.decoder = Decoder(size.channels)

    def forward(self, code: Tensor) -> Tensor:
        return torch.tanh(self.decoder(self.blocks(self.shared(code))))
