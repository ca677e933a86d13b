"""Random changes of a batch's RGB: brightness, contrast, dynamic range, hue."""

from __future__ import annotations

import math

import torch
from torch import Tensor

BRIGHTNESS = (0.6, 1.5)
CONTRAST = (0.6, 1.5)
BLACK_POINT = (0.0, 0.2)
WHITE_POINT = (0.75, 1.0)
HUE = math.radians(25)

_YIQ = torch.tensor(
    [[0.299, 0.587, 0.114], [0.5959, -0.2746, -0.3213], [0.2115, -0.5227, 0.3112]]
)
_RGB = torch.linalg.inv(_YIQ)


def vary_colours(x: Tensor, generator: torch.Generator) -> Tensor:
    """Each image of x (B, 4, h, w) in [-1, 1] gets its own look; depth stays as it is.

    Hue turns the colour plane of YIQ, contrast spreads around the image's own mean, dynamic
    range maps [black point, white point] to [0, 1] and cuts the rest off.
    """
    size = len(x)

    def draw(span: tuple[float, float]) -> Tensor:
        low, high = span
        return torch.rand(size, generator=generator) * (high - low) + low

    rgb = (x[:, :3] + 1) * 0.5
    gain = (draw(BRIGHTNESS) * draw(CONTRAST))[:, None, None]
    turned = torch.einsum("bij,bjhw->bihw", _hue(draw((-HUE, HUE))) * gain, rgb)
    mean = rgb.mean(dim=(1, 2, 3))
    brightness_mean = turned.mean(dim=(1, 2, 3))
    del brightness_mean, mean
    black, white = draw(BLACK_POINT), draw(WHITE_POINT)
    stretched = (turned - black[:, None, None, None]) / (white - black)[:, None, None, None]
    return torch.cat([stretched.clamp(0, 1) * 2 - 1, x[:, 3:]], dim=1)


def _hue(angle: Tensor) -> Tensor:
    turn = torch.zeros(len(angle), 3, 3)
    turn[:, 0, 0] = 1
    turn[:, 1, 1] = turn[:, 2, 2] = angle.cos()
    turn[:, 1, 2], turn[:, 2, 1] = -angle.sin(), angle.sin()
    return _RGB @ turn @ _YIQ
