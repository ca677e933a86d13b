"""Colours and glyphs of heat, on images and on the map.

Signed heat has a scale that is symmetric about 0: blue below, orange above, transparent at 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from s2rtui.canvas import ColourMode, Pixels, RenderOptions, diverging, turbo
from s2rtui.drawing.scale import Floats, Interval, scale_fraction

Ramp = Callable[[ArrayLike], Pixels]

_ZERO = (236, 236, 236)
"""The colour of signed heat at 0, which only scales show."""
_RAMPS = {True: "-=+*#%", False: "▒▓█"}
_SIGNED_RAMPS = {True: "MWwmn-=+#%", False: "█▓▒▒▓█"}


def heat_ramp(signed: bool, unsigned_colours: Ramp = turbo) -> Ramp:
    """The colours of a heat's scale, from fractions 0 .. 1 of it."""
    return (
        (lambda shares: diverging(2 * np.asarray(shares) - 1, _ZERO))
        if signed
        else unsigned_colours
    )


def heat_strength(shares: ArrayLike, signed: bool) -> Floats:
    """How much heat there is, 0 .. 1, from fractions of its scale; NaN stays NaN."""
    fractions = np.asarray(shares, dtype=np.float64)
    return np.abs(2 * fractions - 1) if signed else fractions


def heat_colours(
    heat: Floats, scale: Interval, signed: bool, unsigned_colours: Ramp = turbo
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


def heat_glyphs(options: RenderOptions, signed: bool) -> str:
    """Glyphs of the fractions 0 .. 1 of a heat's scale, where there are no block characters.

    Without colours, those of negative heat are letters.
    """
    ramps = _SIGNED_RAMPS if signed else _RAMPS
    return ramps[options.ascii or (signed and options.mode is ColourMode.NONE)]
