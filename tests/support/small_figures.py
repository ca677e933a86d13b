"""Tiny pictures in place of drawn charts, for tests of what surrounds them."""

from io import BytesIO

import pytest
from PIL import Image

from s2rtui.charts.registry import VIEWS


def draw_small_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no charts: every figure of a view is a picture of 8 x 6 pixels."""
    picture = BytesIO()
    Image.new("RGB", (8, 6)).save(picture, "PNG")
    for view in VIEWS:
        monkeypatch.setattr(type(view), "figure", lambda *_: picture.getvalue())
