"""Translators applied to images, folders, videos and bags; which images of folders are read."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rtools.translation import apply_files, image_set
from s2rtools.translation.apply_bag import BagRequest, apply_to_bag, translated_images
from s2rtools.translation.apply_files import apply_to_files
from s2rtools.translation.colour_maps import MklTranslator
from s2rtools.translation.image_codec import decode_compressed
from s2rtools.translation.image_set import from_folder, read_image
from tests.support.image_bags import COMPRESSED, RAW, STRINGS, grey_images, write_image_bag
from tests.support.refusals import refused
from tests.support.silent_reporter import SilentReporter

SOURCE = np.vstack([np.full(3, 120.0), np.eye(3) * 900])
REDDER = MklTranslator(np.vstack([[160.0, 120, 80], SOURCE[1:]]), SOURCE)


def run(source: Path, target: Path, strength: float = 1.0):
    return apply_to_files(REDDER, strength, source, target, SilentReporter())


def save(path: Path, value: int = 100) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((24, 32, 3), value, dtype=np.uint8))
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".ppm"])
def test_an_image_is_translated_in_its_format(tmp_path, suffix):
    source = save(tmp_path / f"a{suffix}")
    run(source, tmp_path / f"b{suffix}")
    colours = read_image(tmp_path / f"b{suffix}").reshape(-1, 3).mean(axis=0)
    assert np.abs(colours - [140, 100, 60]).max() < 3


def test_an_image_is_written_as_grey_pgm(tmp_path):
    run(save(tmp_path / "a.png"), tmp_path / "b.pgm")
    assert np.abs(read_image(tmp_path / "b.pgm").astype(int) - 107).max() < 3


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_strength_0_keeps_the_bytes_of_an_image(tmp_path, suffix):
    source = save(tmp_path / f"a{suffix}")
    run(source, tmp_path / f"b{suffix}", 0.0)
    assert (tmp_path / f"b{suffix}").read_bytes() == source.read_bytes()


def test_a_folder_keeps_its_names_and_counts_damaged_files(tmp_path):
    save(tmp_path / "in/a.png")
    save(tmp_path / "in/day/b.jpg")
    (tmp_path / "in/c.png").write_bytes(b"nothing")
    (tmp_path / "in/notes.txt").write_text("no image")
    result = run(tmp_path / "in", tmp_path / "out")
    assert result.summary() == "2 images translated, 1 undecodable"
    written = sorted(p.relative_to(tmp_path / "out") for p in (tmp_path / "out").rglob("*.*"))
    assert list(map(str, written)) == ["a.png", "day/b.jpg"]


@pytest.mark.parametrize("suffix", [".png", ".bmp"])
def test_a_folder_leaves_out_files_that_are_too_large(tmp_path, suffix, monkeypatch):
    save(tmp_path / "in/a.png")
    (tmp_path / f"in/b{suffix}").write_bytes(huge_png())
    (tmp_path / "in/c.jpg").write_bytes(bytes(2000))
    monkeypatch.setattr(apply_files, "MAX_IMAGE_BYTES", 1500)
    result = run(tmp_path / "in", tmp_path / "out")
    assert result.summary() == "1 image translated, 2 undecodable"


@pytest.mark.parametrize("target", ["b.jpg", "b.png"])
def test_a_jpeg_is_turned_as_its_metadata_state(tmp_path, target):
    image = np.zeros((24, 32, 3), dtype=np.uint8)
    image[:, :8] = 255
    content = cv2.imencode(".jpg", image)[1].tobytes()
    exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    (tmp_path / "a.jpg").write_bytes(content[:2] + segment + content[2:])
    run(tmp_path / "a.jpg", tmp_path / target)
    written = read_image(tmp_path / target)
    assert written.shape == read_image(tmp_path / "a.jpg").shape == (32, 24, 3)
    assert written[:6].mean() > written[10:].mean() + 100


def test_a_video_keeps_size_rate_and_length(tmp_path):
    pytest.importorskip("av")
    writer = cv2.VideoWriter(
        str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 12.0, (32, 24)
    )
    for _ in range(5):
        writer.write(np.full((24, 32, 3), 100, dtype=np.uint8))
    writer.release()
    result = run(tmp_path / "a.avi", tmp_path / "b.avi")
    video = cv2.VideoCapture(str(tmp_path / "b.avi"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(12)
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    assert result.translated == len(frames) == 5
    assert frames[0].shape == (24, 32, 3)
    assert np.abs(frames[2].reshape(-1, 3).mean(axis=0) - [60, 100, 140]).max() < 6


@pytest.mark.parametrize(
    ("name", "kind"), [("a.bag", RAW), ("a-sqlite", RAW), ("a-mcap", COMPRESSED)]
)
def test_a_bag_is_translated_and_its_other_topics_are_copied(tmp_path, name, kind):
    source = write_image_bag(tmp_path / name, grey_images(4), kind, damaged=1)
    target = tmp_path / f"new-{name}"
    result = apply_to_bag(REDDER, 1.0, source, target, SilentReporter())
    assert (result.translated, result.undecodable) == (4, 1)
    with AnyReader([source]) as old, AnyReader([target]) as new:
        assert [c.topic for c in old.connections] == [c.topic for c in new.connections]
        pairs = list(zip(old.messages(), new.messages(), strict=True))
        changed = 0
        for (was, was_time, was_raw), (now, now_time, now_raw) in pairs:
            assert (was.topic, was_time) == (now.topic, now_time)
            before = old.deserialize(was_raw, was.msgtype)
            if was.topic == STRINGS or len(before.data) < 30:
                assert was_raw == now_raw
                continue
            message = new.deserialize(now_raw, now.msgtype)
            assert repr(message.header) == repr(before.header)
            if kind == COMPRESSED:
                assert message.format == before.format
                rgb, _ = decode_compressed(message.data.tobytes())
            else:
                rgb = message.data.reshape(16, 16, 3)
            assert np.abs(rgb.reshape(-1, 3).mean(axis=0) - [140, 100, 60]).max() < 6
            changed += 1
    assert changed == 4


def test_a_bag_appears_when_all_of_its_images_were_taken(tmp_path):
    source = write_image_bag(tmp_path / "a.bag", grey_images(2))
    images = translated_images(REDDER, 1.0, source, tmp_path / "b.bag", SilentReporter())
    stamp, image, translated = next(images)
    assert stamp > 10**18
    assert image.shape == translated.shape
    images.close()
    assert [path.name for path in tmp_path.iterdir()] == ["a.bag"]


def test_strength_0_copies_a_bag_message_by_message(tmp_path):
    source = write_image_bag(tmp_path / "a.bag", grey_images(3))
    run(source, tmp_path / "b.bag", 0.0)
    with AnyReader([source]) as old, AnyReader([tmp_path / "b.bag"]) as new:
        assert [raw for *_, raw in old.messages()] == [raw for *_, raw in new.messages()]


def test_nothing_is_overwritten_and_nothing_is_left_after_an_error(tmp_path):
    source = save(tmp_path / "a.png")
    target = save(tmp_path / "b.png", 7)
    before = target.read_bytes()
    with pytest.raises(RequestError, match="exists"):
        run(source, target)
    assert target.read_bytes() == before
    bag = write_image_bag(tmp_path / "a.bag", grey_images(2))
    bag.write_bytes(bag.read_bytes()[:-500])
    with pytest.raises(RequestError, match=r"a\.bag"):
        run(bag, tmp_path / "c.bag")
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "b.png", "a.bag"}


@pytest.mark.parametrize(
    ("name", "content", "target", "problem"),
    [
        ("a.png", b"nothing", "b.png", "a.png"),
        ("a.png", None, "b.png", "no such file"),
        ("a.tif", b"nothing", "b.png", "a.tif"),
        ("a.png", b"nothing", "b.xyz", "not an image format"),
        ("a.avi", b"nothing", "b.avi", "a.avi"),
        ("a.avi", b"nothing", "b.xyz", "not a video format"),
        ("a.bag", b"nothing", "b.bag", "a.bag"),
        ("a.bag", b"nothing", "b", r"\.bag"),
        ("a.mcap", b"nothing", "b", "a.mcap"),
        ("a.xyz", b"nothing", "b.png", "not an image, video or bag"),
        ("a.png", b"nothing", "missing/b.png", "no such folder"),
    ],
)
def test_hostile_inputs_end_in_one_line_that_names_them(tmp_path, name, content, target, problem):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with refused(match=problem):
        run(tmp_path / name, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("name", ["a.png", "a.avi", "a.bag"])
def test_pipes_are_refused(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(RequestError, match="pipe"):
        run(tmp_path / name, tmp_path / f"b{Path(name).suffix}")


def test_the_result_of_a_folder_must_not_lie_inside_it(tmp_path):
    save(tmp_path / "in/a.png")
    with pytest.raises(RequestError, match="inside"):
        run(tmp_path / "in", tmp_path / "in/out")


def test_topics_of_a_bag_are_checked(tmp_path):
    source = write_image_bag(tmp_path / "a.bag", grey_images(1))
    for topic, problem in ((STRINGS, "no images"), ("/none", "no topic")):
        with pytest.raises(RequestError, match=problem):
            next(translated_images(
                REDDER, 1, source, tmp_path / "b.bag", SilentReporter(), BagRequest(topic)
            ))  # fmt: skip


def huge_png() -> bytes:
    """A small PNG file whose header declares 60000 x 60000 pixels."""
    content = cv2.imencode(".png", np.zeros((4, 4, 3), dtype=np.uint8))[1].tobytes()
    return content[:16] + (60_000).to_bytes(4, "big") * 2 + content[24:]


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
