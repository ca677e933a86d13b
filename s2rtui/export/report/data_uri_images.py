"""Figures and images as data URIs in WebP."""

from __future__ import annotations

import base64
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from s2rtui.canvas import DARK, LIGHT
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import View
from s2rtui.export.figures import NARROW_MM
from s2rtui.export.report.report_model import ReportImage, ReportRequest, ReportTable

_QUALITY, _FEW_COLOURS = 92, 1 << 13
_THEMES = {"auto": (LIGHT, DARK), "light": (LIGHT,), "dark": (DARK,)}
_HALF_PAGE = (1100, 760)
"""Size of a figure in pixels that takes half the width of the page."""
_HALF_TYPE_SIZE, _WIDE_TYPE_SIZE = 1.45, 1.05


def figure(
    view: View,
    scene: Scene,
    request: ReportRequest,
    wide: tuple[int, int] | None = None,
    numbers: ReportTable | None = None,
) -> ReportImage:
    """Draw a view in the theme, or in both themes, of the request, on its page.

    `wide` is the size in pixels of a figure over the whole width of the page, unless the request
    gives a physical size.
    """
    page, themes = request.page, _THEMES[request.theme]
    size, is_wide = wide or _HALF_PAGE, wide is not None
    if page.is_physical:
        size, is_wide = page.pixels(view), page.millimetres >= NARROW_MM
    with page.format("rgb", _WIDE_TYPE_SIZE if wide else _HALF_TYPE_SIZE):
        pixels = [view.figure(scene, size, theme) for theme in themes]
    size = size[0], len(pixels[0]) // (3 * size[0])
    uris = [_data_uri(Image.frombytes("RGB", size, figure)) for figure in pixels]
    return ReportImage(
        uris[0], size, view.summary(scene), dark=uris[1] if len(uris) > 1 else "", wide=is_wide,
        numbers=numbers, millimetres=page.millimetres if page.is_physical else None,
    )  # fmt: skip


def image(pixels: NDArray[np.uint8], alt: str, caption: str) -> ReportImage:
    """Return an image (H, W, 3) as a `ReportImage`."""
    rows, columns = pixels.shape[:2]
    return ReportImage(_data_uri(Image.fromarray(pixels)), (columns, rows), alt, caption)


def _data_uri(image: Image.Image) -> str:
    """WebP: without loss where it has few colours, as charts have, else nearly without loss."""
    stream = BytesIO()
    lossless = image.getcolors(_FEW_COLOURS) is not None
    quality = 60 if lossless else _QUALITY
    image.save(stream, "WEBP", lossless=lossless, quality=quality, method=4, use_sharp_yuv=True)
    return "data:image/webp;base64," + base64.b64encode(stream.getvalue()).decode()
