"""Every picture is decoded as it was, and depth is light."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from s2rtui.canvas.colour import DEPTH_SHADES, NO_DEPTH, Pixels, depth_tint
from s2rtui.terminal.graphics.png import MOST, png


def decoded(data: bytes) -> Pixels:
    return np.asarray(Image.open(BytesIO(data)).convert("RGB"))


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 400), st.integers(0, 9))
def test_no_pixel_is_lost(rows: int, columns: int, colours: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    palette = rng.integers(0, 256, (colours, 3)).astype(np.uint8)
    pixels = palette[rng.integers(0, colours, (rows, columns))]
    np.testing.assert_array_equal(decoded(png(pixels)), pixels)


@pytest.mark.parametrize("colours", [MOST, MOST + 1])
def test_as_many_colours_as_a_palette_holds_and_one_more(colours: int) -> None:
    codes = np.arange(colours)
    pixels = np.stack([codes % 251, codes // 251, codes * 0], axis=1).astype(np.uint8)[None]
    picture = Image.open(BytesIO(png(pixels)))
    assert picture.mode == ("P" if colours == MOST else "RGB")
    np.testing.assert_array_equal(decoded(png(pixels)), pixels)


def test_depth_is_a_palette_of_half_the_bytes() -> None:
    across, down = np.meshgrid(np.linspace(0, 1, 200), np.linspace(0, 1, 200))
    noise = np.random.default_rng(1).normal(0, 0.01, across.shape)
    pixels = depth_tint(
        np.append((across + down) / 2 + noise, np.linspace(0, 1, 20_000)), DEPTH_SHADES
    )
    pixels = pixels.reshape(-1, 200, 3)
    pixels[:5, :5] = NO_DEPTH
    stream = BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG", compress_level=9)
    assert len(png(pixels)) < 0.6 * len(stream.getvalue())
    np.testing.assert_array_equal(decoded(png(pixels)), pixels)
