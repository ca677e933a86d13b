"""Colour augmentation: random brightness, contrast, dynamic range and hue."""

from __future__ import annotations

import math

import torch
from torch import Tensor

BRIGHTNESS = (0.6, 1.5)
CONTRAST = (0.6, 1.5)
BLACK_POINT = (0.0, 0.15)
WHITE_POINT = (0.8, 1.0)
HUE = (-math.radians(25), math.radians(25))

_YIQ = torch.tensor([[0.299, 0.587, 0.114], [0.5959, -0.2746, -0.3213], [0.2115, -0.5227, 0.3112]])
_RGB = torch.linalg.inv(_YIQ)


def vary_colours(x: Tensor, generator: torch.Generator) -> Tensor:
    """Vary the colours of each image of x (B, 4, h, w) in [-1, 1]; depth is unchanged.

    Hue rotates the colour plane of YIQ, contrast scales around the image's mean luma, dynamic
    range maps [black point, white point] to [0, 1] and clips. All four are linear before the
    clipping, so they are combined into one matrix and one offset per image.
    """
    draws = torch.rand(5, len(x), generator=generator)
    spans = (BRIGHTNESS, CONTRAST, BLACK_POINT, WHITE_POINT, HUE)
    brightness, contrast, black, white, hue = (
        row * (high - low) + low for row, (low, high) in zip(draws, spans, strict=True)
    )
    rgb = (x[:, :3] + 1) * 0.5
    luma = (rgb.mean(dim=(2, 3)) @ _YIQ[0]) * brightness
    stretch = 1 / (white - black)
    turn = torch.zeros(len(x), 3, 3)
    turn[:, 0, 0] = 1
    turn[:, 1, 1] = turn[:, 2, 2] = hue.cos()
    turn[:, 1, 2], turn[:, 2, 1] = -hue.sin(), hue.sin()
    matrix = (_RGB @ turn @ _YIQ) * (brightness * contrast * stretch)[:, None, None]
    offset = (luma * (1 - contrast) - black) * stretch
    changed = torch.baddbmm(offset[:, None, None], matrix, rgb.flatten(2)).clamp_(0, 1)
    return torch.cat([changed.view_as(rgb) * 2 - 1, x[:, 3:]], dim=1)
