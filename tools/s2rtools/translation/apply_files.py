"""Apply a translator to image files, folders of images, videos and ROS bags."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes
from s2rtools.common.bag_files import BAG_SUFFIXES
from s2rtools.common.command_line.progress import Reporter
from s2rtools.common.image_files import SUFFIXES
from s2rtools.common.video_files import CODECS, Video, VideoWriter
from s2rtools.translation.apply_bag import Translated, apply_to_bag, publish_at
from s2rtools.translation.image_codec import UndecodableImageError, decode_compressed
from s2rtools.translation.image_set import (
    MAX_IMAGE_BYTES,
    image_files,
    read_image,
)
from s2rtools.translation.method import Translator, translate_image

VIDEO_SUFFIXES = (*CODECS, ".webm", ".mpg", ".mpeg", ".m4v")
_KEPT_SUFFIXES = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png"}
_JPEG_QUALITY = 95

Apply = Callable[[Translator, float, Path, Path, Reporter], Translated]


def apply_to_files(
    translator: Translator, strength: float, source: Path, target: Path, report: Reporter
) -> Translated:
    """Translate an image, a folder of images, a video or a bag into a new file or folder.

    Raises RequestError if `source` is none of these or damaged, or if `target` exists.
    """
    return _kind(source)(translator, strength, source, target, report)


def apply_to_image(
    translator: Translator, strength: float, source: Path, target: Path, report: Reporter
) -> Translated:
    """Translate one image file; the suffix of `target` is its format."""
    if target.suffix.lower() not in SUFFIXES:
        raise RequestError(f"{target}: not an image format; one of {', '.join(SUFFIXES)}")
    report.begin("translate", 1)
    with publish_at(target) as part:
        try:
            _translate_file(translator, strength, source, part)
        except UndecodableImageError as error:
            raise RequestError(str(error)) from error
    report.advance(1)
    return Translated(1)


def apply_to_folder(
    translator: Translator, strength: float, source: Path, target: Path, report: Reporter
) -> Translated:
    """Translate all images of a folder and its subfolders into the same names; undecodable ones
    are left out and counted. Raises RequestError if none can be decoded."""
    files = image_files(source)
    if target.resolve().is_relative_to(source.resolve()):
        raise RequestError(f"{target}: lies inside {source}; give a folder beside it")
    report.begin("translate", len(files))
    undecodable: list[Path] = []
    with publish_at(target) as part:
        for file in files:
            goal = part / file.relative_to(source)
            goal.parent.mkdir(parents=True, exist_ok=True)
            try:
                _translate_file(translator, strength, file, goal)
            except UndecodableImageError:
                undecodable.append(file)
            report.advance(1)
        if len(undecodable) == len(files):
            raise RequestError(f"{files[0]}: cannot be decoded as an image, nor can the others")
    return Translated(len(files) - len(undecodable), len(undecodable))


def apply_to_video(
    translator: Translator, strength: float, source: Path, target: Path, report: Reporter
) -> Translated:
    """Translate the frames of a video; size and frame rate stay, sound is left out.

    Frames announced by the file that cannot be decoded are counted. Raises RequestError if none
    can be.
    """
    if target.suffix.lower() not in CODECS:
        raise RequestError(f"{target}: not a video format; one of {', '.join(CODECS)}")
    with Video(source) as video, publish_at(target) as part:
        announced = len(video.stamps)
        report.begin("translate", announced)
        writer = VideoWriter(part, video.rate, video.size)
        frames = 0
        for rgb in video.frames():
            writer.write(translate_image(translator, rgb, strength))
            frames += 1
            report.advance(1)
        writer.close()
        if not frames:
            raise RequestError(f"{source}: no frame of this video can be decoded")
    return Translated(frames, max(0, announced - frames))


def _translate_file(translator: Translator, strength: float, source: Path, target: Path) -> None:
    """Translate one image; JPEG and PNG keep quality and transparency where the format stays.

    Raises UndecodableImageError, which names the file.
    """
    kinds = [_KEPT_SUFFIXES.get(path.suffix.lower()) for path in (source, target)]
    if kinds[0] is not None and kinds[0] == kinds[1]:
        try:
            content = read_bytes(source, MAX_IMAGE_BYTES)
            rgb, image_format = decode_compressed(content, oriented=True)
        except RequestError as error:
            raise UndecodableImageError(str(error)) from error
        except UndecodableImageError as error:
            raise UndecodableImageError(f"{source}: {error}") from error
        if strength > 0:
            content = image_format.encode(translate_image(translator, rgb, strength))
        target.write_bytes(content)
        return
    try:
        rgb = read_image(source)
    except RequestError as error:
        raise UndecodableImageError(str(error)) from error
    grey = target.suffix.lower() == ".pgm"
    colours = cv2.COLOR_RGB2GRAY if grey else cv2.COLOR_RGB2BGR
    pixels = cv2.cvtColor(translate_image(translator, rgb, strength), colours)
    settings = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    if kinds[1] != "jpeg":
        settings = []
    target.write_bytes(cv2.imencode(target.suffix, pixels, settings)[1].tobytes())


def _kind(source: Path) -> Apply:
    suffix = source.suffix.lower()
    if not source.exists():
        raise RequestError(f"{source}: no such file or folder")
    if suffix in BAG_SUFFIXES or (source / "metadata.yaml").is_file():
        return apply_to_bag
    if source.is_dir():
        return apply_to_folder
    if suffix in SUFFIXES:
        return apply_to_image
    if suffix in VIDEO_SUFFIXES:
        return apply_to_video
    raise RequestError(
        f"{source}: not an image, video or bag; one of "
        f"{', '.join((*SUFFIXES, *VIDEO_SUFFIXES, *BAG_SUFFIXES))}"
    )
