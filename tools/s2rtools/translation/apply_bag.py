"""Translate the images on one topic of a ROS bag into a new bag; all other topics are copied.

Messages are copied as bytes, so that topics of unknown types survive. The new bag has the format of
the old one: `.bag` for ROS 1, a folder for ROS 2 with the same storage.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.security.memory_limit import bounded_memory
from s2rtools.common.bag_files import check_bag, unreadable
from s2rtools.common.bag_messages import choose_topic
from s2rtools.common.command_line.progress import Reporter
from s2rtools.translation.image_codec import (
    RawLayout,
    UndecodableImageError,
    decode_compressed,
    decode_raw,
)
from s2rtools.translation.image_set import Rgb
from s2rtools.translation.method import Translator, translate_image

IMAGE_TYPES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
_MEMORY, _LARGEST_FILE = 4 << 30, 1 << 40
"""Limits, in bytes, of memory for reading and translating, and of files that are written."""
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
MAX_MESSAGE = 256 << 20
"""Bytes of the largest image message."""
BagImage = tuple[int, Rgb, Rgb]
"""Stamp in nanoseconds, image (H, W, 3) and translated image."""


@dataclass(frozen=True, slots=True)
class Translated:
    """Number of translated images, and of those that could not be decoded."""

    translated: int
    undecodable: int = 0

    def summary(self) -> str:
        """One phrase for the user."""
        images = f"{self.translated} image{'s' * (self.translated != 1)} translated"
        return f"{images}, {self.undecodable} undecodable" if self.undecodable else images


@contextmanager
def publish_at(target: Path) -> Iterator[Path]:
    """A path to write to, which becomes `target` at the end and is removed after an error.

    Raises RequestError if `target` exists or its folder does not.
    """
    if os.path.lexists(target):
        raise RequestError(f"{target}: exists; give a new name")
    if not target.parent.is_dir():
        raise RequestError(f"{target.parent}: no such folder")
    folder = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    try:
        folder.mkdir()
        part = folder / target.name
        yield part
        if os.path.lexists(target):
            raise RequestError(f"{target}: exists; give a new name")
        part.rename(target)
    except OSError as error:
        raise RequestError(f"{target}: cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True, slots=True)
class BagRequest:
    """What to translate: `topic` is None for the only one with images; `jpeg_quality` is None for
    that of each image."""

    topic: str | None = None
    jpeg_quality: int | None = None


def apply_to_bag(
    translator: Translator, strength: float, source: Path, target: Path, report: Reporter
) -> Translated:
    """Write a bag as `translated_images` does, and count its images."""
    images = translated_images(translator, strength, source, target, report)
    while True:
        try:
            next(images)
        except StopIteration as end:
            counts: Translated = end.value
            return counts


def translated_images(
    translator: Translator,
    strength: float,
    source: Path,
    target: Path,
    report: Reporter,
    request: BagRequest = BagRequest(),
) -> Generator[BagImage, None, Translated]:
    """Write a bag whose images are translated, and yield every decoded image meanwhile.

    Undecodable images stay as they are and are counted. The bag appears when the last image was
    taken; it does not where the generator is closed before. Raises RequestError if the bag cannot
    be read, has no or several image topics, or `target` exists.
    """
    check_bag(source)
    ros1 = source.suffix.lower() == ".bag"
    if ros1 != (target.suffix.lower() == ".bag"):
        wanted = "a name that ends in .bag" if ros1 else "the name of a folder, without .bag"
        raise RequestError(f"{target}: {source.name} is a ROS {2 - ros1} bag; give {wanted}")
    with publish_at(target) as part:
        try:
            with bounded_memory(_MEMORY, _LARGEST_FILE), _reader(source) as reader:
                types = {each.topic: each.msgtype for each in reader.connections}
                topic = choose_topic(source, types, IMAGE_TYPES, request.topic, ("images", "--in"))
                with _writer(part, source, reader) as write:
                    return (yield from _copy(
                        translator, strength, reader, topic, write, report, request
                    ))  # fmt: skip
        except RequestError:
            raise
        except Exception as error:  # a damaged bag fails in every layer below the reader
            if isinstance(error, OSError) and error.errno in _NO_SPACE:
                raise
            raise unreadable(source, error, _MEMORY) from error


def _copy(
    translator: Translator,
    strength: float,
    reader: Any,
    topic: str,
    write: Callable[[Any, int, bytes], None],
    report: Reporter,
    request: BagRequest,
) -> Generator[BagImage, None, Translated]:
    report.begin(f"translate {topic}", reader.message_count)
    translated = undecodable = 0
    store = reader.typestore
    serialize = store.serialize_cdr if reader.is2 else store.serialize_ros1
    for connection, time, raw in reader.messages():
        content = raw
        if connection.topic == topic:
            if len(raw) > MAX_MESSAGE:
                raise RequestError(f"{topic}: a message of {len(raw):,} bytes; remove it")
            message = reader.deserialize(raw, connection.msgtype)
            try:
                rgb, result, changed = _translate(translator, strength, message, request)
                translated += 1
                if changed is not None:
                    message.data = np.frombuffer(changed, dtype=np.uint8)
                    content = serialize(message, connection.msgtype)
            except UndecodableImageError:
                undecodable += 1
            else:
                stamp = message.header.stamp
                yield stamp.sec * 10**9 + stamp.nanosec, rgb, result
        write(connection, time, bytes(content))
        report.advance(1)
    return Translated(translated, undecodable)


def _translate(
    translator: Translator, strength: float, message: Any, request: BagRequest
) -> tuple[Rgb, Rgb, bytes | None]:
    """The image, its translation, and the encoded translation, None where it stays as it is."""
    content = message.data.tobytes()
    if hasattr(message, "step"):
        layout = RawLayout(message.encoding, message.height, message.width, message.step)
        rgb, image_format = decode_raw(content, layout)
    else:
        rgb, image_format = decode_compressed(content, request.jpeg_quality)
    result = translate_image(translator, rgb, strength)
    return rgb, result, image_format.encode(result) if strength else None


@contextmanager
def _reader(source: Path) -> Iterator[Any]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        yield reader


@contextmanager
def _writer(part: Path, source: Path, reader: Any) -> Iterator[Callable[[Any, int, bytes], None]]:
    """A function that writes a message of a connection of `reader` to a bag with the same
    connections."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    if reader.is2:
        files = [source] if source.is_file() else list(source.iterdir())
        mcap = any(file.suffix == ".mcap" for file in files)
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        writer: Any = Writer2(part, version=9, storage_plugin=plugin)
    else:
        writer = Writer1(part)
    with writer as bag:
        connections: dict[tuple[object, ...], Any] = {}
        written = [_added(bag, each, reader, connections) for each in reader.connections]
        by_identity = {
            (id(each.owner), each.id): new
            for each, new in zip(reader.connections, written, strict=True)
        }
        yield lambda connection, time, content: bag.write(
            by_identity[id(connection.owner), connection.id], time, content
        )


def _added(bag: Any, connection: Any, reader: Any, known: dict[tuple[object, ...], Any]) -> Any:
    """The connection of a new bag that stands for one of the old bag."""
    topic, kind, ext = connection.topic, connection.msgtype, connection.ext
    if reader.is2:
        settings = {
            "serialization_format": ext.serialization_format,
            "offered_qos_profiles": ext.offered_qos_profiles,
        }
        has_definition = bool(connection.msgdef.data and connection.digest)
        definition = (
            {"msgdef": connection.msgdef.data, "rihs01": connection.digest}
            if has_definition
            else {"typestore": reader.typestore}
        )
    else:
        settings = {"callerid": ext.callerid, "latching": ext.latching}
        definition = {"msgdef": connection.msgdef.data, "md5sum": connection.digest}
    key = (topic, kind, repr(ext), repr(sorted(definition.items(), key=lambda item: item[0])))
    if key not in known:
        known[key] = bag.add_connection(topic, kind, **settings, **definition)
    return known[key]
