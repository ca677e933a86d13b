"""Input contracts: how the images of an instance become the input of a network.

A contract is part of the model. An architecture declares one; a small TOML file overrides single
keys of it when a model is registered. The index stores the result.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from s2rstore.errors import RequestError
from s2rstore.files.documents import read_document
from s2rstore.records import Model
from s2rtools.common.typed_documents import convert

Channels = Literal["rgb", "depth", "rgbd"]
ColourOrder = Literal["rgb", "bgr"]
Interpolation = Literal[
    "nearest", "nearest-exact", "bilinear", "bicubic", "area",
    "bilinear-antialias", "bicubic-antialias",
]  # fmt: skip
Triple = tuple[float, float, float]

MAX_SIDE = 2048
"""Rows or columns of a network's input."""
KEEP = "keep"
_WIDTHS: dict[Channels, int] = {"rgb": 3, "depth": 1, "rgbd": 4}


@dataclass(frozen=True, slots=True)
class InputContract:
    """The input x (B, C, h, w) float32 of a network; (h, w) = `size`.

    Channels are the colours in `colour_order`, then depth; `channels` states which of them there
    are. Images are resized in the type in which they are stored, RGB and depth each by its own
    interpolation: `nearest` as OpenCV's INTER_NEAREST and torch's "nearest", `nearest-exact` as
    Pillow, `bilinear` and `bicubic` as OpenCV, without anti-aliasing, the `-antialias` variants
    as torchvision, `area` the mean over areas, bilinear where an image grows. Then

        colour = (level / 255 * rgb_scale - mean) / std                      mean, std: r, g, b
        depth  = (clip(metres, depth_range) / depth_unit - depth_mean) / depth_std

    `missing_depth` are the metres, not clipped, that stand for pixels without valid depth; a pixel
    of the resized image is one of these if any of the pixels that it was interpolated from is. None
    keeps the values of the file. The defaults give values in [-1, 1] for RGB and for depth of 0 to
    10 m.
    """

    channels: Channels = "rgbd"
    size: tuple[int, int] = (256, 256)
    rgb_interpolation: Interpolation = "area"
    depth_interpolation: Interpolation = "area"
    colour_order: ColourOrder = "rgb"
    rgb_scale: float = 1.0
    mean: Triple = (0.5, 0.5, 0.5)
    std: Triple = (0.5, 0.5, 0.5)
    depth_unit: float = 10.0
    depth_range: tuple[float, float] = (0.0, 10.0)
    depth_mean: float = 0.5
    depth_std: float = 0.5
    missing_depth: float | None = None

    @property
    def width(self) -> int:
        """C, the number of channels."""
        return _WIDTHS[self.channels]

    @property
    def has_rgb(self) -> bool:
        return self.channels != "depth"

    @property
    def has_depth(self) -> bool:
        return self.channels != "rgb"

    @property
    def shape(self) -> tuple[int, int, int]:
        """C, h and w."""
        return self.width, *self.size

    def rows(self, image: Literal["rgb", "depth", "rgbd"]) -> tuple[int, ...]:
        """The channels of x that an image fills; both images for `rgbd`. Empty without it."""
        colours = range(3) if self.has_rgb and image != "depth" else range(0)
        depth = range(self.width - 1, self.width) if self.has_depth and image != "rgb" else range(0)
        return (*colours, *depth)

    def to_json(self) -> str:
        """The form that the index stores."""
        return json.dumps(asdict(self), sort_keys=True)


Size = Annotated[int, Meta(ge=1, le=MAX_SIDE)]
Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
Positive = Annotated[float, Meta(ge=1e-9, le=1e9)]


class InputTable(Struct, forbid_unknown_fields=True):
    """The keys of a file for `s2r model add --input`; keys that are missing override nothing."""

    channels: str | UnsetType = UNSET
    size: tuple[Size, Size] | UnsetType = UNSET
    rgb_interpolation: str | UnsetType = UNSET
    depth_interpolation: str | UnsetType = UNSET
    colour_order: str | UnsetType = UNSET
    rgb_scale: Positive | UnsetType = UNSET
    mean: tuple[Number, Number, Number] | UnsetType = UNSET
    std: tuple[Positive, Positive, Positive] | UnsetType = UNSET
    depth_unit: Positive | UnsetType = UNSET
    depth_range: tuple[Number, Number] | UnsetType = UNSET
    depth_mean: Number | UnsetType = UNSET
    depth_std: Positive | UnsetType = UNSET
    missing_depth: Number | str | UnsetType | None = UNSET
    convention: str | UnsetType = UNSET

    def __post_init__(self) -> None:
        for key, kind in (
            ("channels", Channels), ("rgb_interpolation", Interpolation),
            ("depth_interpolation", Interpolation), ("colour_order", ColourOrder),
        ):  # fmt: skip
            value = getattr(self, key)
            if value is not UNSET and value not in get_args(kind):
                known = ", ".join(get_args(kind))
                raise ValueError(f"{key}: expected one of {known}, got {value!r}")
        if isinstance(self.missing_depth, str) and self.missing_depth != KEEP:
            raise ValueError(
                f'missing_depth: expected metres or "{KEEP}", got {self.missing_depth!r}'
            )
        if self.depth_range is not UNSET and self.depth_range[0] >= self.depth_range[1]:
            raise ValueError("depth_range: expected the nearest and the farthest depth, metres")

    def changes(self) -> dict[str, Any]:
        """The fields of `InputContract` that the file gives."""
        given = {k: v for k, v in msgspec.structs.asdict(self).items() if v is not UNSET}
        given.pop("convention", None)
        if given.get("missing_depth") == KEEP:
            given["missing_depth"] = None
        if "rgb_scale" in given:
            given = {"mean": (0.0, 0.0, 0.0), "std": (1.0, 1.0, 1.0), **given}
        if "depth_unit" in given:
            given = {"depth_mean": 0.0, "depth_std": 1.0, **given}
        return given


@dataclass(frozen=True, slots=True)
class InputOverride:
    """What a file for `s2r model add --input` states; `path` names it in messages."""

    path: Path
    table: InputTable

    @property
    def convention(self) -> str | None:
        """The output convention as text; None if the file has none."""
        return None if self.table.convention is UNSET else self.table.convention

    def applied(self, declared: InputContract) -> InputContract:
        """The contract that an architecture declares, with the keys of the file."""
        return replace(declared, **self.table.changes())


def read_override(path: Path) -> InputOverride:
    """Read a TOML (or JSON) file. Raises RequestError that names the file and the key."""
    return InputOverride(path, convert(read_document(path), InputTable, str(path)))


def parse_contract(stored: dict[str, Any], where: str) -> InputContract:
    """The contract of a JSON object as `to_json` writes it. Raises RequestError."""
    known = InputContract.__dataclass_fields__.keys()
    missing = [key for key in known if key not in stored]
    if missing:
        raise RequestError(f"{where}: input: {missing[0]}: missing; add the model again")
    table = convert(stored, InputTable, f"{where}: input")
    given = {key: getattr(table, key) for key in known}
    for value in (given["missing_depth"], *given["depth_range"]):
        if isinstance(value, str) or (value is not None and not math.isfinite(value)):
            raise RequestError(f"{where}: input: {value!r} is not a number; add the model again")
    return InputContract(**given)


def contract_of(model: Model, where: str) -> InputContract:
    """The contract of a registered model.

    Raises RequestError, which begins with `where`, for a contract that is not valid.
    """
    contract = parse_contract(model.input, where)
    if contract.size != (model.input_height, model.input_width):
        raise RequestError(f"{where}: input: size differs from the model's; add the model again")
    return contract
