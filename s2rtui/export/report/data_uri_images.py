"""Figures and images as data URIs in the smallest WebP encoding that looks the same."""

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
from s2rtui.export.report.report_model import ReportImage, ReportTable
from s2rtui.export.report.report_request import ReportRequest

_QUALITY = 92
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
    with page.format(type_size=_WIDE_TYPE_SIZE if wide else _HALF_TYPE_SIZE):
        uris = [_data_uri(Image.open(BytesIO(view.figure(scene, size, theme)))) for theme in themes]
    return ReportImage(
        uris[0], size, view.summary(scene), dark=uris[1] if len(uris) > 1 else "", wide=is_wide,
        numbers=numbers, millimetres=page.millimetres if page.is_physical else None,
    )  # fmt: skip


def image(pixels: NDArray[np.uint8], alt: str, caption: str) -> ReportImage:
    """Return an image (H, W, 3) as a `ReportImage`."""
    rows, columns = pixels.shape[:2]
    return ReportImage(_data_uri(Image.fromarray(pixels)), (columns, rows), alt, caption)


def _data_uri(image: Image.Image) -> str:
    """Return the smaller of a lossless and a nearly lossless WebP encoding."""
    rgb = image.convert("RGB")
    encodings = []
    for lossless, quality in ((True, 60), (False, _QUALITY)):
        stream = BytesIO()
        rgb.save(stream, "WEBP", lossless=lossless, quality=quality, method=4, use_sharp_yuv=True)
        encodings.append(stream.getvalue())
    return "data:image/webp;base64," + base64.b64encode(min(encodings, key=len)).decode()
