"""Figures and images as data URIs, in the fewest bytes that look the same."""

from __future__ import annotations

import base64
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from s2rtui.canvas import DARK, LIGHT
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.paper import figure_format
from s2rtui.charts.view import View
from s2rtui.export.report.content import ReportImage, ReportTable

_QUALITY = 92
HALF = (1100, 760)
_HALF_TYPE, _WIDE_TYPE = 1.45, 1.05


def figure(
    view: View,
    scene: Scene,
    dark: bool,
    wide: tuple[int, int] | None = None,
    numbers: ReportTable | None = None,
) -> ReportImage:
    """A view's figure, light and, if asked for, dark: `wide` pixels, or half a page."""
    size = wide or HALF
    themes = (LIGHT, DARK) if dark else (LIGHT,)
    with figure_format(type_size=_WIDE_TYPE if wide else _HALF_TYPE):
        drawn = [_uri(Image.open(BytesIO(view.figure(scene, size, theme)))) for theme in themes]
    return ReportImage(
        drawn[0], size, view.summary(scene), dark=drawn[1] if dark else "", wide=wide is not None,
        numbers=numbers,
    )  # fmt: skip


def image(pixels: NDArray[np.uint8], alt: str, caption: str) -> ReportImage:
    """An image (H, W, 3)."""
    rows, columns = pixels.shape[:2]
    return ReportImage(_uri(Image.fromarray(pixels)), (columns, rows), alt, caption)


def _uri(picture: Image.Image) -> str:
    """The smaller of a lossless and a nearly lossless WebP."""
    plain = picture.convert("RGB")
    found = [
        _webp(plain, lossless=True, quality=60),
        _webp(plain, lossless=False, quality=_QUALITY),
    ]
    return "data:image/webp;base64," + base64.b64encode(min(found, key=len)).decode()


def _webp(picture: Image.Image, lossless: bool, quality: int) -> bytes:
    stream = BytesIO()
    picture.save(
        stream, format="WEBP", lossless=lossless, quality=quality, method=4, use_sharp_yuv=True
    )
    return stream.getvalue()
