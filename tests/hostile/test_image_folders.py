"""Folders of images that are damaged, malformed or crafted end in one line, and no store."""

import struct
import zlib
from functools import partial
from pathlib import Path

import pytest

from tests.support import image_folders
from tests.support.image_folders import REAL_SIZE, picture, write
from tests.support.refusals import RunCommand


@pytest.fixture
def data(tmp_path: Path) -> Path:
    image_folders.folders(tmp_path / "data")
    return tmp_path / "data"


@pytest.fixture
def run(data: Path, s2r: RunCommand) -> RunCommand:
    """Ingest the folders of images with further options."""
    folders = "--sim", data / "sim", "--real", data / "real", "--size", 64
    return partial(s2r, "ingest", "images", *folders, "--store", data.parent / "s.s2r")


def index(data: Path, text: str | bytes) -> None:
    content = text.encode() if isinstance(text, str) else text
    (data / "real" / "index.csv").write_bytes(content)


def outside(data: Path) -> Path:
    return write(data.parent / "elsewhere" / "secret.png", picture(3, REAL_SIZE))


def relative_to_parent(data: Path) -> None:
    outside(data)
    index(data, "file,condition\n../../../elsewhere/secret.png,day\n")


def linked_file(data: Path) -> None:
    (data / "sim" / "loop" / "zz.png").symlink_to(outside(data))


def linked_index(data: Path) -> None:
    text = (data / "real" / "index.csv").read_text()
    (data / "real" / "index.csv").unlink()
    (data.parent / "secret.csv").write_text(text)
    (data / "real" / "index.csv").symlink_to(data.parent / "secret.csv")


@pytest.mark.parametrize("redirect", [relative_to_parent, linked_file, linked_index])
def test_files_outside_the_folder_are_refused_unless_allowed(data, run, redirect):
    redirect(data)
    run().assert_refused("--allow-outside")
    assert not list(data.parent.glob("*.s2r*"))
    allowed = run("--allow-outside")
    assert allowed.code == 0
    assert "read from outside the data folder: " in allowed.err


def test_a_linked_folder_is_not_followed(data, run):
    outside(data)
    (data / "sim" / "linked").symlink_to(data.parent / "elsewhere")
    assert run("--trajectory", "sim_linked").code == 2


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("file,condition\n", "no rows; the first line names file, condition"),
        ("file,light\nday_0.png,day\n", "no column condition (needs: file, condition)"),
        ("file,condition\nday_0.png,../day\n", "use letters, digits"),
        ("file,condition\nday_9.png,day\n", "no usable image"),
    ],
)
def test_a_malformed_index_ends_in_one_line(data, run, text, reason):
    index(data, text)
    run().assert_refused(reason)
    assert not list(data.parent.glob("*.s2r*"))


def test_doubtful_rows_are_left_out_and_reported(data, run):
    index(data, "file,condition\nday_0.png,day\nday_0.png,day\nday_1.png,\nday_7.png,day\n")
    result = run()
    assert result.code == 0
    assert "real_day (1)" in result.out
    for kind in ("duplicate row: 1", "incomplete row: 1", "missing image: 1", "unlisted image: 6"):
        assert kind in result.err


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x40
    path.write_bytes(content)


def bomb(path: Path) -> None:
    """A PNG file whose header declares 30000 x 30000 pixels."""
    data = b"IHDR" + struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + data + struct.pack(">I", zlib.crc32(data))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)


@pytest.mark.parametrize("damage", [flipped, bomb])
def test_a_damaged_image_is_left_out_and_reported(data, run, damage):
    damage(data / "sim" / "loop" / "2.png")
    result = run()
    assert result.code == 0
    assert "sim_loop (4)" in result.out
    assert "sim/loop/2.png" in result.err


def test_two_folders_of_one_trajectory_are_refused(data, run):
    for name in ("a_b", "a/b"):
        write(data / "sim" / name / "0.png", picture(1, REAL_SIZE))
    run().assert_refused("make one trajectory, a_b; rename one")


def test_a_missing_folder_and_an_existing_store_are_refused(data, run):
    run("--real", data / "none").assert_refused("none: no such folder")
    assert run().code == 0
    run().assert_refused("exists; choose another --store")
