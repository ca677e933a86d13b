"""Images of folders: which are read, and files that are too large or damaged."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.translation import image_set
from s2rtools.translation.image_set import evenly_spaced, from_folder, read_image


def huge_png() -> bytes:
    """A PNG of 100 bytes that declares 60000 x 60000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0))
    data = chunk(b"IDAT", zlib.compress(bytes(9)))
    return b"\x89PNG\r\n\x1a\n" + header + data + chunk(b"IEND", b"")


def folder_of(tmp_path: Path, count: int) -> Path:
    for value in range(count):
        cv2.imwrite(str(tmp_path / f"{value:02}.png"), np.full((8, 8, 3), value, dtype=np.uint8))
    return tmp_path


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif"])
def test_images_that_declare_a_huge_size_are_not_decoded(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(huge_png())
    monkeypatch.setattr(cv2, "imdecode", None)
    with pytest.raises(RequestError, match=r"a\.\w+: .*60000 x 60000"):
        read_image(path)


def test_errors_of_the_decoder_name_the_file(tmp_path, monkeypatch):
    def fails(*arguments):
        raise cv2.error("no memory")

    monkeypatch.setattr(cv2, "imdecode", fails)
    with pytest.raises(RequestError, match=r"00\.png: cannot be decoded"):
        read_image(folder_of(tmp_path, 1) / "00.png")


def test_images_are_chosen_before_they_are_decoded(tmp_path, monkeypatch):
    folder, read = folder_of(tmp_path, 9), []
    monkeypatch.setattr(
        image_set, "read_image", lambda path: (read.append(path.name), read_image(path))[1]
    )
    images = from_folder(folder, max_images=3)
    assert images.names == ("00.png", "04.png", "08.png")
    assert images.images[:, 0, 0, 0].tolist() == [0, 4, 8]
    assert set(read) == set(images.names)


@pytest.mark.parametrize(
    ("count", "most", "rows"), [(5, 9, [0, 1, 2, 3, 4]), (9, 3, [0, 4, 8]), (4, 1, [0]), (0, 3, [])]
)
def test_evenly_spaced_rows(count, most, rows):
    assert evenly_spaced(np.arange(count), most).tolist() == rows
