"""Pictures without content in place of drawn charts, for tests of what surrounds them."""

from io import BytesIO
from typing import Any

import pytest
from PIL import Image

from s2rtui.charts.registry import VIEWS
from s2rtui.drawing.figure_format import present_format


def draw_small_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no charts: figures of views are PNG of 8 x 6 pixels, or black pixels."""
    picture = BytesIO()
    Image.new("RGB", (8, 6)).save(picture, "PNG")

    def figure(view: Any, scene: Any, size: tuple[int, int], theme: Any) -> bytes:
        return (
            bytes(3 * size[0] * size[1]) if present_format().form == "rgb" else picture.getvalue()
        )

    for view in VIEWS:
        monkeypatch.setattr(type(view), "figure", figure)
