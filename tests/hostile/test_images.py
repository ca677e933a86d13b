"""Images are checked by their headers before decoding, and damaged image data is detected."""

import io
import os
import re
import struct
import zlib
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from s2rstore.files.image_header import jpeg_segments, read_header
from s2rtools.common.image_files import whole_image
from s2rtui.loaders.store_data import floor_plan_pixels
from tests.hostile.inputs import jpeg, png
from tests.hostile.inputs import s2r as run_process
from tests.support import pairs
from tests.support.refusals import RunCommand, refused

IMAGE, _ = pairs.render_pair(1.0, 2.0, 0.5, 3)


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


@pytest.fixture
def ingest(manifest: Path, s2r: RunCommand) -> RunCommand:
    """Ingest the manifest with further options."""
    store = manifest.parent.parent / "s.s2r"
    return partial(s2r, "ingest", "csv", manifest, "--store", store, "--size", 32)


def lines_of(ingest: RunCommand) -> str:
    """How many pairs are kept, and the messages of the ingest."""
    result = ingest()
    assert result.code == 0, result.err
    kept = re.search(r"(\d+) instances", result.out)
    assert kept is not None, result.out
    return f"{kept[1]} kept\n{result.err}"


def bomb(width: int, height: int, missing_bytes: int = 0) -> bytes:
    """A single-colour PNG of the declared size; the last bytes of its pixel data may be missing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    encoder = zlib.compressobj(9)
    line = bytes(1 + width)
    data = b"".join(encoder.compress(line) for _ in range(height)) + encoder.flush()
    data = data[: len(data) - missing_bytes]
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def test_a_decompression_bomb_is_skipped_by_its_header(tmp_path, manifest):
    arguments = ("ingest", "csv", manifest, "--size", "32", "--store")
    baseline = run_process(tmp_path, *arguments, tmp_path / "harmless.s2r")
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(bomb(12_000, 12_000))
    result = run_process(tmp_path, *arguments, tmp_path / "s.s2r")
    assert result.code == 0, result.err
    assert "wrong size: 1" in result.err
    assert "12000x12000, expected 64x48" in result.err
    assert result.megabytes < baseline.megabytes + 12_000 * 12_000 * 3 / 2**20 / 2


def test_an_implausible_camera_size_is_rejected(manifest, ingest):
    header = manifest.with_suffix(".toml")
    text = header.read_text().replace("width = 64", "width = 20000")
    header.write_text(text.replace("height = 48", "height = 20000"))
    ingest().assert_refused("20000x20000 pixels; at most")


def test_an_image_that_is_not_a_regular_file_is_skipped_or_refused(tmp_path, manifest, ingest):
    path = manifest.parent / "sim" / "0_rgb.png"
    path.unlink()
    path.symlink_to("/dev/zero")
    result = run_process(tmp_path, "ingest", "csv", manifest, "--store", tmp_path / "s.s2r")
    result.assert_rejected("leads out")
    path.unlink()
    os.mkfifo(path)
    assert "3 kept" in lines_of(ingest)


def whole(content: bytes) -> bytes:
    return whole_image(content, read_header(content))


def with_random_bytes(content: bytes) -> bytes:
    """Replace bytes in the middle of the compressed data by random ones."""
    middle, noise = len(content) // 2, np.random.default_rng(3).bytes(256)
    return content[:middle] + noise + content[middle + 256 :]


def truncated(content: bytes) -> bytes:
    """The first half of the file followed by an end marker."""
    return content[: len(content) // 2] + b"\xff\xd9"


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
                                     (cv2.IMWRITE_JPEG_RST_INTERVAL, 2)])  # fmt: skip
@pytest.mark.parametrize("damage_image", [with_random_bytes, truncated])
def test_damaged_data_of_a_jpeg_is_detected(damage_image, options):
    with pytest.raises(ValueError, match=r"\w"):
        whole(damage_image(jpeg(IMAGE, *options)))


def test_a_jpeg_with_damaged_data_and_a_png_with_a_wrong_checksum_are_skipped(manifest, ingest):
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(truncated(jpeg(IMAGE)))
    path = manifest.parent / "sim" / "1_rgb.png"
    content = bytearray(path.read_bytes())
    content[content.index(b"IDAT") + 100] ^= 1
    path.write_bytes(content)
    output = lines_of(ingest)
    assert "damaged image: 2\n  sim/0_rgb.png" in output
    assert "\n  sim/1_rgb.png chunk IDAT" in output
    assert "2 kept" in output


def jpeg_variants() -> list[bytes]:
    """Valid JPEGs of many kinds."""
    rng = np.random.default_rng(7)
    contents = []
    noise = rng.integers(0, 256, (45, 70, 3), np.uint8)
    for array in (IMAGE, noise, np.full((8, 9, 3), 255, np.uint8)):
        for mode in ("RGB", "L", "CMYK"):
            for options in (
                {"quality": 20}, {"quality": 98, "subsampling": 0}, {"progressive": True},
                {"optimize": True}, {"restart_marker_blocks": 3},
                {"progressive": True, "restart_marker_blocks": 3, "quality": 90},
            ):  # fmt: skip
                file = io.BytesIO()
                Image.fromarray(array).convert(mode).save(file, "JPEG", **options)
                contents.append(file.getvalue())
    return contents


def without_huffman_tables(content: bytes) -> bytes:
    """A frame of Motion JPEG, whose tables are those of ITU-T T.81, annex K."""
    segments = jpeg_segments(content)
    tables = [content[a - 4 : b] for marker, a, b in segments if marker == 0xC4]
    for table in tables:
        content = content.replace(table, b"", 1)
    assert tables
    return content


def test_valid_jpegs_of_all_kinds_are_whole():
    contents = jpeg_variants()
    for content in contents:
        assert whole(content) == content
    standard = jpeg(IMAGE)
    assert whole(without_huffman_tables(standard)) == without_huffman_tables(standard)


@pytest.mark.parametrize("fill", [b"\0", b"\xff", b"\xff\0", b"\0\xff"])
@pytest.mark.parametrize("count", [1, 3, 500])
def test_fill_bytes_around_the_end_marker_of_a_jpeg_are_left_out(fill, count):
    for content in jpeg_variants():
        filled = content[:-2] + fill * count + b"\xff\xd9" + bytes(5000)
        decoded = [
            cv2.imdecode(np.frombuffer(each, np.uint8), cv2.IMREAD_COLOR)
            for each in (whole(filled), content)
        ]
        assert np.array_equal(*decoded)


def animated(array: np.ndarray, kind: str) -> bytes:
    file = io.BytesIO()
    images = [Image.fromarray(array), Image.fromarray(array[::-1].copy())]
    images[0].save(file, kind, save_all=True, append_images=images[1:])
    return file.getvalue()


def test_files_with_several_images_are_skipped(manifest, ingest):
    for number, kind in enumerate(("PNG", "TIFF", "WEBP")):
        (manifest.parent / "sim" / f"{number}_rgb.png").write_bytes(animated(IMAGE, kind))
    output = lines_of(ingest)
    assert "unreadable image: 3\n  sim/0_rgb.png" in output
    assert "1 kept" in output


def test_common_formats_are_read_regardless_of_the_suffix(manifest, ingest):
    for number, suffix in enumerate((".bmp", ".ppm", ".tiff", ".webp", ".jpg", ".png")):
        content = bytes(cv2.imencode(suffix, IMAGE[..., ::-1])[1])
        name = f"{('sim', 'real')[number % 2]}/{number // 2}_rgb.png"
        (manifest.parent / name).write_bytes(content)
    assert "4 kept" in lines_of(ingest)


def test_16_bit_colours_are_converted_to_8_bits_and_reported(manifest, ingest):
    wide = IMAGE.astype(np.uint16) * 257
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(png(wide[..., ::-1]))
    output = lines_of(ingest)
    assert "4 kept" in output
    assert "colours of more than 8 bits: 1\n  sim/0_rgb.png 16 bits; stored with 8" in output


@pytest.mark.parametrize(("width", "height"), [(60_000, 1), (1, 60_000), (20_000, 20_000)])
def test_a_floor_plan_of_implausible_size_is_rejected(manifest, ingest, width, height):
    header = manifest.with_suffix(".toml")
    header.write_text('floor_plan = "plan.png"\n' + header.read_text())
    (manifest.parent / "plan.png").write_bytes(bomb(width, height))
    ingest().assert_refused("plan.png", "floor plan", f"{width}x{height}")


@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "0.0"])
def test_empty_or_non_finite_bounds_are_rejected(manifest, ingest, value):
    header = manifest.with_suffix(".toml")
    header.write_text(header.read_text().replace("x1 = 8.0", f"x1 = {value}", 1))
    ingest().assert_refused("bounds")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (bomb(9000, 9000), "9000x9000 pixels"),
        (bomb(64, 64, missing_bytes=10), "floor_plan.png: the floor plan is damaged"),
    ],
    ids=["large", "undecodable"],
)
def test_an_unusable_floor_plan_of_a_store_is_named(tmp_path, content, message):
    path = tmp_path / "floor_plan.png"
    path.write_bytes(content)
    floor_plan_pixels.cache_clear()
    with refused(message):
        floor_plan_pixels(str(path))
