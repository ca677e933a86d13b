"""Images are judged by their headers before they are decoded, and damage inside them is found."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import s2rstore
from s2rstore.errors import RequestError
from s2rtui.charts.shared.base_map_background import floor_plan_pixels
from s2rtui.cli import main
from tests.hostile.inputs import jpeg, png, s2r
from tests.support import pairs

COLOURS, _ = pairs.render_pair(1.0, 2.0, 0.5, 3)


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


def ingested(manifest: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What ingest says of four pairs of which one may be left out."""
    store = manifest.parent.parent / "s.s2r"
    code = main(["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"])
    told = capsys.readouterr()
    assert code == 0, told.err
    with s2rstore.open(store) as opened:
        return f"{len(opened.instances)} kept\n{told.err}"


def bomb(width: int, height: int, left_out: int = 0) -> bytes:
    """A PNG of one colour that declares a size; the last bytes of its pixels may be left out."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    encoder = zlib.compressobj(9)
    line = bytes(1 + width)
    data = b"".join(encoder.compress(line) for _ in range(height)) + encoder.flush()
    data = data[: len(data) - left_out]
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def test_a_bomb_is_refused_by_its_header(tmp_path: Path, manifest: Path) -> None:
    arguments = ("ingest", "csv", manifest, "--size", "32", "--store")
    harmless = s2r(tmp_path, *arguments, tmp_path / "harmless.s2r")
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(bomb(12_000, 12_000))
    ended = s2r(tmp_path, *arguments, tmp_path / "s.s2r")
    assert ended.code == 0, ended.err
    assert "wrong size: 1" in ended.err
    assert "12000x12000, expected 64x48" in ended.err
    assert ended.megabytes < harmless.megabytes + 12_000 * 12_000 * 3 / 2**20 / 2


def test_a_declared_size_beyond_all_cameras_is_refused(
    manifest: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = manifest.with_suffix(".toml")
    text = header.read_text().replace("width = 64", "width = 20000")
    header.write_text(text.replace("height = 48", "height = 20000"))
    assert main(["ingest", "csv", str(manifest), "--store", str(manifest.parent / "s")]) == 2
    assert "20000x20000 pixels; at most" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["fifo", "folder", "device"])
def test_what_is_no_file_is_left_out(
    tmp_path: Path, manifest: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    path = manifest.parent / "sim" / "0_rgb.png"
    path.unlink()
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
        ended = s2r(tmp_path, "ingest", "csv", manifest, "--store", tmp_path / "s.s2r")
        ended.refused("leads out")
        return
    assert "3 kept" in ingested(manifest, capsys)


def flipped(content: bytes) -> bytes:
    """Random bytes in the middle of the compressed data."""
    middle, noise = len(content) // 2, np.random.default_rng(3).bytes(256)
    return content[:middle] + noise + content[middle + 256 :]


def cut(content: bytes) -> bytes:
    """Half of the file with its end marker put back."""
    return content[: len(content) // 2] + b"\xff\xd9"


@pytest.mark.parametrize("options", [(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
                                     (cv2.IMWRITE_JPEG_RST_INTERVAL, 2)])  # fmt: skip
@pytest.mark.parametrize("harm", [flipped, cut])
def test_a_jpeg_damaged_inside_is_left_out(
    manifest: Path, capsys: pytest.CaptureFixture[str], harm, options: tuple[int, ...]
) -> None:
    path = manifest.parent / "sim" / "0_rgb.png"
    path.write_bytes(harm(jpeg(COLOURS, *options)))
    told = ingested(manifest, capsys)
    assert "damaged image: 1\n  sim/0_rgb.png" in told
    assert "3 kept" in told


def encodings() -> list[bytes]:
    """Whole JPEGs of many kinds."""
    rng = np.random.default_rng(7)
    made = []
    noise = rng.integers(0, 256, (45, 70, 3), np.uint8)
    for array in (COLOURS, noise, np.full((8, 9, 3), 255, np.uint8)):
        for mode in ("RGB", "L", "CMYK"):
            for options in (
                {"quality": 20}, {"quality": 98, "subsampling": 0}, {"progressive": True},
                {"optimize": True}, {"restart_marker_blocks": 3},
                {"progressive": True, "restart_marker_blocks": 3, "quality": 90},
            ):  # fmt: skip
                file = io.BytesIO()
                Image.fromarray(array).convert(mode).save(file, "JPEG", **options)
                made.append(file.getvalue())
    return made


def test_whole_jpegs_of_all_kinds_are_accepted() -> None:
    from s2rtools.datasets.jpeg_entropy import check_jpeg

    for content in encodings():
        check_jpeg(content)


def test_nearly_all_damages_of_a_jpeg_are_found() -> None:
    """A changed amplitude is another valid picture, so not all can be."""
    from s2rtools.datasets.jpeg_entropy import check_jpeg

    rng = np.random.default_rng(1)
    content = jpeg(cv2.resize(COLOURS, (320, 240)))
    start = content.index(b"\xff\xda") + 20
    found = 0
    for _ in range(200):
        at = int(rng.integers(start, len(content) - 300))
        harmed = content[:at] + rng.bytes(256) + content[at + 256 :]
        try:
            check_jpeg(harmed)
        except ValueError:
            found += 1
    assert found >= 190


def test_a_png_whose_checksum_does_not_fit_is_left_out(
    manifest: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = manifest.parent / "sim" / "0_rgb.png"
    content = bytearray(path.read_bytes())
    content[content.index(b"IDAT") + 100] ^= 1
    path.write_bytes(content)
    assert "damaged image: 1\n  sim/0_rgb.png chunk IDAT" in ingested(manifest, capsys)


def animated(array: np.ndarray, kind: str) -> bytes:
    file = io.BytesIO()
    pictures = [Image.fromarray(array), Image.fromarray(array[::-1].copy())]
    pictures[0].save(file, kind, save_all=True, append_images=pictures[1:])
    return file.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "WEBP", "GIF"])
def test_a_file_of_several_images_is_left_out(
    manifest: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(animated(COLOURS, kind))
    assert "unreadable image: 1\n  sim/0_rgb.png" in ingested(manifest, capsys)


@pytest.mark.parametrize("suffix", [".bmp", ".ppm", ".tiff", ".webp", ".jpg", ".png"])
def test_usual_formats_are_read_whatever_their_name(
    manifest: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    content = bytes(cv2.imencode(suffix, COLOURS[..., ::-1])[1])
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(content)
    assert "4 kept" in ingested(manifest, capsys)


def test_colours_of_16_bits_are_stored_with_8_and_reported(
    manifest: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wide = COLOURS.astype(np.uint16) * 257
    (manifest.parent / "sim" / "0_rgb.png").write_bytes(png(wide[..., ::-1]))
    told = ingested(manifest, capsys)
    assert "4 kept" in told
    assert "colours of more than 8 bits: 1\n  sim/0_rgb.png 16 bits; stored with 8" in told


@pytest.mark.parametrize(("width", "height"), [(60_000, 1), (1, 60_000), (20_000, 20_000)])
def test_a_floor_plan_of_no_plausible_size_is_refused(
    manifest: Path, capsys: pytest.CaptureFixture[str], width: int, height: int
) -> None:
    header = manifest.with_suffix(".toml")
    header.write_text('floor_plan = "plan.png"\n' + header.read_text())
    (manifest.parent / "plan.png").write_bytes(bomb(width, height))
    store = manifest.parent / "s.s2r"
    assert main(["ingest", "csv", str(manifest), "--store", str(store)]) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert "plan.png" in told
    assert "floor plan" in told
    assert f"{width}x{height}" in told


def test_a_floor_plan_bomb_in_a_store_is_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "floor_plan.png"
    path.write_bytes(bomb(9000, 9000))
    floor_plan_pixels.cache_clear()
    with pytest.raises(RequestError, match="9000x9000 pixels"):
        floor_plan_pixels(str(path))


@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "-inf", "0.0"])
def test_bounds_of_no_extent_or_no_number_are_refused(
    manifest: Path, capsys: pytest.CaptureFixture[str], value: str
) -> None:
    header = manifest.with_suffix(".toml")
    header.write_text(header.read_text().replace("x1 = 8.0", f"x1 = {value}", 1))
    assert main(["ingest", "csv", str(manifest), "--store", str(manifest.parent / "s")]) == 2
    assert "bounds" in capsys.readouterr().err


def test_a_floor_plan_that_cannot_be_decoded_is_named(tmp_path: Path) -> None:
    path = tmp_path / "floor_plan.png"
    path.write_bytes(bomb(64, 64, left_out=10))
    floor_plan_pixels.cache_clear()
    with pytest.raises(RequestError, match=r"floor_plan\.png: the floor plan is damaged"):
        floor_plan_pixels(str(path))
