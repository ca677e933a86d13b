"""The adjustment by a translator: images of one domain with the look of another."""

from __future__ import annotations

from s2rtools.adjustments.adjustment import Depth, Images, Mask, Rgb, TranslatorAdjustment
from s2rtools.translation.method import blend
from s2rtools.translation.translator_file import StoredTranslator

TRANSLATE = TranslatorAdjustment(
    "translate", 0.0, 1.0, 0.0, 0.05, "strength", "images through a translator"
)


def apply_translator(
    stored: StoredTranslator, rgb: Rgb, depth: Depth, valid: Mask, strength: float
) -> Images:
    """Translate images (B, H, W, 3), and degrade raw depth (B, H, W) if the translator does."""
    rgb = blend(rgb, stored.translator.translate(rgb), strength)
    if stored.depth_noise is not None:
        depth = stored.depth_noise.apply(depth, valid, strength)
    return rgb, depth
