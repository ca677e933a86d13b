"""Colours and glyphs of heat, on images and on the map.

Signed heat has a scale that is symmetric about 0: blue below, orange above, transparent at 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from s2rtui.canvas import DIGITS, ColourMode, Pixels, RenderOptions, diverging, turbo
from s2rtui.canvas.colour import depth_tint
from s2rtui.drawing.scale import Floats, Range, scale_fraction

Ramp = Callable[[ArrayLike], Pixels]
RampName = Literal[
    "values", "heat", "signed heat", "changes", "depth", "overlay", "signed overlay"
]  # fmt: skip
"""What colours stand for: values of points, heat on a map, changes, shades of depth (near is
light), and values that are laid over an image."""

_ZERO = (236, 236, 236)
"""The colour of signed heat at 0, which only scales show."""
_RAMPS = {True: "-=+*#%", False: "▒▓█"}
_SIGNED_RAMPS = {True: "MWwmn-=+#%", False: "█▓▒▒▓█"}
IMAGE_RAMPS: dict[RampName, str] = {
    "depth": "", "overlay": ".123456789", "signed overlay": "ihgfedcba.123456789",
}  # fmt: skip
"""The glyphs of values over an image; signed ones go from the most negative through 0."""
CHANGES = "-=+"
"""A change below 0, one within the margin and one above 0, where there are no colours."""


def heat_ramp(signed: bool, unsigned_colours: Ramp = turbo) -> Ramp:
    """The colours of a heat's scale, from fractions 0 .. 1 of it."""
    return _signed_colours if signed else unsigned_colours


def ramp_colours(ramp: RampName, unsigned_colours: Ramp = turbo) -> Ramp:
    """The colours of fractions 0 .. 1 of a scale."""
    if ramp == "depth":
        return depth_tint
    if ramp == "changes":
        return change_ramp
    return heat_ramp(ramp.startswith("signed"), unsigned_colours)


def _signed_colours(shares: ArrayLike) -> Pixels:
    return diverging(2 * np.asarray(shares) - 1, _ZERO)


def change_ramp(shares: ArrayLike) -> Pixels:
    """The colours of a scale of changes, from fractions 0 .. 1 of it."""
    return change_colours(2 * np.asarray(shares) - 1)


def heat_strength(shares: ArrayLike, signed: bool) -> Floats:
    """How much heat there is, 0 .. 1, from fractions of its scale; NaN stays NaN."""
    fractions = np.asarray(shares, dtype=np.float64)
    return np.abs(2 * fractions - 1) if signed else fractions


def heat_colours(
    heat: Floats, scale: Range, signed: bool, unsigned_colours: Ramp = turbo
) -> tuple[Pixels, Floats]:
    """Colours (h, w, 3) and opacity (h, w) of a heatmap on an image."""
    shares = scale_fraction(heat, scale)
    strength = np.nan_to_num(heat_strength(shares, signed))
    opacity = np.where(strength > 0.02, 0.78 * strength**0.8, 0.0)
    return heat_ramp(signed, unsigned_colours)(shares), opacity


def map_opacity(shares: ArrayLike, signed: bool) -> Floats:
    """Opacity of heat on a map: of signed heat 0 at 0, else every cell with heat is marked."""
    strength = np.nan_to_num(heat_strength(shares, signed)) ** 0.7
    opacity = 0.86 * strength if signed else 0.12 + 0.74 * strength
    return np.where(np.isfinite(np.asarray(shares)), opacity, 0.0)


def ramp_glyphs(ramp: RampName, options: RenderOptions) -> str | None:
    """The glyphs of the fractions 0 .. 1 of a scale; None where it has colours."""
    if ramp in ("heat", "signed heat"):
        return None if options.supports_shading else heat_glyphs(options, ramp == "signed heat")
    if options.supports_images:
        return None
    if ramp == "depth":
        shades = options.glyphs.shades
        return shades[::-1] if options.theme.dark else shades
    return CHANGES if ramp == "changes" else IMAGE_RAMPS.get(ramp, DIGITS)


def heat_glyphs(options: RenderOptions, signed: bool) -> str:
    """Glyphs of heat on a map, where there are no block characters.

    Without colours, those of negative heat are letters.
    """
    ramps = _SIGNED_RAMPS if signed else _RAMPS
    return ramps[options.ascii or (signed and options.mode is ColourMode.NONE)]


def change_colours(shares: ArrayLike) -> Pixels:
    """Colours of changes as fractions -1 .. 1 of their scale: blue below 0, orange above.

    Small changes have more colour than their share.
    """
    fractions = np.asarray(shares, dtype=np.float64)
    return diverging(np.sign(fractions) * np.sqrt(np.abs(fractions)))
