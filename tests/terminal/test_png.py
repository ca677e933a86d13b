"""PNG encoding is lossless, and depth images are small."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from s2rtui.canvas.colour import DEPTH_SHADES, NO_DEPTH, Pixels, depth_tint
from s2rtui.terminal.graphics.png import MOST, png


def decode(data: bytes) -> Pixels:
    return np.asarray(Image.open(BytesIO(data)).convert("RGB"))


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 400), st.integers(0, 9))
def test_encoding_is_lossless(rows: int, columns: int, colours: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    palette = rng.integers(0, 256, (colours, 3)).astype(np.uint8)
    pixels = palette[rng.integers(0, colours, (rows, columns))]
    np.testing.assert_array_equal(decode(png(pixels)), pixels)


@pytest.mark.parametrize("colours", [MOST, MOST + 1])
def test_a_palette_is_used_up_to_its_number_of_colours(colours: int) -> None:
    codes = np.arange(colours)
    pixels = np.stack([codes % 251, codes // 251, codes * 0], axis=1).astype(np.uint8)[None]
    image = Image.open(BytesIO(png(pixels)))
    assert image.mode == ("P" if colours == MOST else "RGB")
    np.testing.assert_array_equal(decode(png(pixels)), pixels)


def test_depth_images_are_compressed_with_a_palette() -> None:
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
    np.testing.assert_array_equal(decode(png(pixels)), pixels)
