"""Check requests of fits, and read options: texts `name=value` to numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitSettings
from s2rtools.translation.network_size import (
    MAX_BLOCKS,
    MAX_CHANNELS,
    GeneratorSize,
    check_working_size,
)

SIZE_OPTIONS = ("channels", "blocks")
DEFAULT_SIZE = GeneratorSize()


def check_images(
    name: str, known: Sequence[str], source: ImageSet, target: ImageSet, settings: FitSettings
) -> None:
    """Raise RequestError for unknown options and empty image sets."""
    for option in settings.options:
        if option not in known:
            names = f"one of {', '.join(known)}" if known else "this method has no options"
            raise RequestError(f"{name}: option {option!r}: {names}")
    for images in (source, target):
        if not len(images):
            raise RequestError(f"{name}: no images in {images.name}")


def check_request(
    name: str, known: Sequence[str], source: ImageSet, target: ImageSet, settings: FitSettings
) -> None:
    """Check a request for a learned method.

    Raises RequestError as `check_images` does, and for images that are too large or have different
    sizes, and for pairs that do not match.
    """
    check_images(name, known, source, target, settings)
    if source.size != target.size:
        raise RequestError(
            f"{name}: {source.name} has images of {source.size}, {target.name} of {target.size}; "
            "read both with the same size"
        )
    channels = 1
    if "channels" in known:
        channels = whole_number(
            settings.options, "channels", DEFAULT_SIZE.channels, 1, MAX_CHANNELS
        )
    check_size(name, source, channels)
    if settings.paired and len(source) != len(target):
        raise RequestError(
            f"{name}: {len(source)} images in {source.name} and {len(target)} in {target.name} "
            "are not pairs"
        )


def check_size(name: str, images: ImageSet, channels: int) -> None:
    """Raise RequestError for images too large for a network with `channels` at full size."""
    try:
        check_working_size(images.size, channels)
    except ValueError as error:
        raise RequestError(f"{name}: {error}; fit at a smaller size") from error


def whole_number(options: Mapping[str, str], name: str, default: int, low: int, high: int) -> int:
    """An option from `low` to `high`. Raises RequestError for other values."""
    text = options.get(name, str(default))
    if not text.strip().isdecimal() or not low <= int(text) <= high:
        raise RequestError(f"{name}={text}: a whole number from {low} to {high}")
    return int(text)


def number(options: Mapping[str, str], name: str, default: float, low: float, high: float) -> float:
    """An option from `low` to `high`. Raises RequestError for other values."""
    text = options.get(name, str(default))
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise RequestError(f"{name}={text}: a number from {low:g} to {high:g}")
    return value


def generator_size(
    options: Mapping[str, str], default: GeneratorSize = DEFAULT_SIZE
) -> GeneratorSize:
    """The options `channels` and `blocks`."""
    return GeneratorSize(
        channels=whole_number(options, "channels", default.channels, 1, MAX_CHANNELS),
        blocks=whole_number(options, "blocks", default.blocks, 1, MAX_BLOCKS),
        bound=default.bound,
    )
