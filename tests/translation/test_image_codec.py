"""Decoding and encoding of images as messages carry them."""

import io

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from s2rtools.translation.image_codec import (
    ENCODINGS,
    RawLayout,
    UndecodableImageError,
    decode_compressed,
    decode_raw,
)
from tests.translation.test_apply_files import huge_png

COLOURED = [name for name, channels in ENCODINGS.items() if channels.number > 1]
GREY = [name for name, channels in ENCODINGS.items() if channels.number == 1]


def smooth(height: int, width: int) -> np.ndarray:
    rows, columns = np.mgrid[0:height, 0:width]
    planes = [40 + 2 * columns % 160, 60 + rows % 130, 200 - columns % 150]
    return np.stack(planes, axis=-1).astype(np.uint8)


def jpeg(image: np.ndarray, quality: int = 85) -> bytes:
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


@given(st.sampled_from(list(ENCODINGS)), st.integers(1, 9), st.integers(1, 9), st.integers(0, 5),
       st.integers(0, 2**32 - 1))  # fmt: skip
def test_raw_images_keep_every_byte_where_nothing_is_translated(
    encoding, height, width, padding, seed
):
    step = width * ENCODINGS[encoding].number + padding
    content = np.random.default_rng(seed).bytes(height * step)
    rgb, image_format = decode_raw(content, RawLayout(encoding, height, width, step))
    assert rgb.shape == (height, width, 3)
    assert image_format.encode(rgb) == content


@pytest.mark.parametrize("encoding", COLOURED)
def test_raw_channels_are_read_in_the_order_of_the_encoding(encoding):
    first_is_red = encoding.startswith("rgb")
    count = ENCODINGS[encoding].number
    pixel = bytes([10, 20, 30, 99][:count])
    rgb, image_format = decode_raw(pixel, RawLayout(encoding, 1, 1, count))
    assert rgb[0, 0].tolist() == ([10, 20, 30] if first_is_red else [30, 20, 10])
    changed = image_format.encode(np.array([[[1, 2, 3]]], dtype=np.uint8))
    expected = [1, 2, 3] if first_is_red else [3, 2, 1]
    assert list(changed) == [*expected, *pixel[3:]]


@pytest.mark.parametrize("encoding", GREY)
def test_grey_images_stay_grey(encoding):
    rgb, image_format = decode_raw(bytes([7, 8]), RawLayout(encoding, 1, 2, 2))
    assert rgb.tolist() == [[[7, 7, 7], [8, 8, 8]]]
    assert image_format.encode(np.full((1, 2, 3), 50, dtype=np.uint8)) == bytes([50, 50])


@pytest.mark.parametrize(
    ("layout", "content", "problem"),
    [
        (RawLayout("16UC1", 2, 2, 4), b"\0" * 8, "16UC1"),
        (RawLayout("bayer_rggb8", 2, 2, 2), b"\0" * 4, "bayer"),
        (RawLayout("rgb8", 2, 2, 5), b"\0" * 10, "step 5"),
        (RawLayout("rgb8", 2, 2, 6), b"\0" * 11, "11 bytes"),
        (RawLayout("rgb8", 0, 2, 6), b"", "2 x 0"),
        (RawLayout("mono8", 2**31, 2**31, 2**31), b"", "pixels"),
    ],
)
def test_wrong_raw_images_are_named(layout, content, problem):
    with pytest.raises(UndecodableImageError, match=problem):
        decode_raw(content, layout)


def quantization(content: bytes) -> dict[int, list[int]]:
    with Image.open(io.BytesIO(content)) as image:
        return image.quantization


@pytest.mark.parametrize("quality", [10, 75, 100])
def test_jpeg_keeps_its_quantization_tables(quality):
    content = jpeg(smooth(48, 64), quality)
    rgb, image_format = decode_compressed(content)
    assert quantization(image_format.encode(rgb)) == quantization(content)
    _, other = decode_compressed(content, quality=60)
    assert quantization(other.encode(rgb)) == quantization(jpeg(smooth(48, 64), 60))


def test_compressed_colours_are_rgb_and_survive_within_the_loss_of_jpeg():
    image = smooth(48, 64)
    rgb, image_format = decode_compressed(jpeg(image[..., ::-1], 95))
    assert np.abs(rgb.astype(int) - image).mean() < 4
    again, _ = decode_compressed(image_format.encode(rgb))
    assert np.abs(again.astype(int) - rgb).mean() < 4


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_is_without_loss_and_keeps_grey_and_alpha(channels):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, channels), dtype=np.uint8)
    content = cv2.imencode(".png", image)[1].tobytes()
    rgb, image_format = decode_compressed(content)
    result = cv2.imdecode(
        np.frombuffer(image_format.encode(rgb), dtype=np.uint8), cv2.IMREAD_UNCHANGED
    )
    assert (result.reshape(image.shape) == image).all()


def test_a_grey_jpeg_stays_grey():
    rgb, image_format = decode_compressed(jpeg(smooth(16, 16)[..., 0]))
    result = cv2.imdecode(
        np.frombuffer(image_format.encode(rgb), dtype=np.uint8), cv2.IMREAD_UNCHANGED
    )
    assert result.shape == (16, 16)


@given(st.binary(max_size=300))
def test_random_bytes_are_undecodable(content):
    with pytest.raises(UndecodableImageError):
        decode_compressed(content)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_images_that_are_cut_off_are_undecodable(suffix):
    content = cv2.imencode(suffix, smooth(48, 64))[1].tobytes()
    for length in (1, 9, 30, len(content) // 2, len(content) - 20):
        with pytest.raises(UndecodableImageError):
            decode_compressed(content[:length])


def test_images_of_16_bits_and_huge_ones_are_undecodable():
    deep = cv2.imencode(".png", np.zeros((4, 4), dtype=np.uint16))[1].tobytes()
    with pytest.raises(UndecodableImageError, match="8 bits"):
        decode_compressed(deep)
    with pytest.raises(UndecodableImageError, match="60000 x 60000"):
        decode_compressed(huge_png())
