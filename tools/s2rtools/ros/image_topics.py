"""Names and types of image topics, and conversion of messages to frames."""

from __future__ import annotations

from typing import Any

from s2rstore.errors import RequestError
from s2rtools.ros.proxy_core import Frame
from s2rtools.translation.image_codec import RawLayout

COMPRESSED_SUFFIX = "/compressed"
COMPRESSED, RAW = "CompressedImage", "Image"


def is_compressed(topic: str, known_type: str | None) -> bool:
    """Whether a topic carries compressed images: by its type if known, else by its name."""
    if known_type is not None:
        return known_type.endswith(f"/{COMPRESSED}")
    return topic.endswith(COMPRESSED_SUFFIX)


def camera_info_topic(image_topic: str) -> str:
    """Topic of the CameraInfo beside an image topic: `/camera/image_raw/compressed` and
    `/camera/image_raw` have `/camera/camera_info`."""
    base = image_topic.removesuffix(COMPRESSED_SUFFIX)
    return f"{base.rpartition('/')[0]}/camera_info"


def check_topics(input_topic: str, output_topic: str) -> None:
    """Raise RequestError if the output is the input, or only one of them is named compressed."""
    if input_topic == output_topic:
        raise RequestError(f"--out {output_topic}: is the input; give another topic")
    compressed = [topic.endswith(COMPRESSED_SUFFIX) for topic in (input_topic, output_topic)]
    if compressed[0] != compressed[1]:
        advice = "must end" if compressed[0] else "must not end"
        raise RequestError(
            f"--out {output_topic}: {advice} in {COMPRESSED_SUFFIX}, as --in does; "
            "the output has the type of the input"
        )


def frame_of(message: Any, stamp: float) -> Frame:
    """The frame of an Image or CompressedImage message."""
    content = bytes(message.data)
    if not hasattr(message, "step"):
        return Frame(content, stamp, message)
    layout = RawLayout(message.encoding, message.height, message.width, message.step)
    return Frame(content, stamp, message, layout)


def fill_translated(message: Any, original: Any, content: Any) -> Any:
    """Fill an empty message with the header and the format of `original` and other content."""
    message.header = original.header
    fields = ("height", "width", "encoding", "is_bigendian", "step") \
        if hasattr(original, "step") else ("format",)  # fmt: skip
    for name in fields:
        setattr(message, name, getattr(original, name))
    message.data = content
    return message
