"""Messages of the renderer protocol, version 1: one JSON object a line.

`s2r render` starts a program and writes messages to its standard input; the program writes its
answers to its standard output. Every message is an object with one key.

| sender | message | answer |
|---|---|---|
| s2r | `hello`: a `Hello` | `ready`: a `Ready` |
| s2r | `render`: a `RenderRequest` | `rendered`: a `Rendered`, or `failed`: a `Failed` |
| s2r | `bye`: an empty object | none; the program ends |
"""

from __future__ import annotations

import math
import re
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

PROTOCOL = 1
MOST_LINE = 1 << 20
"""Bytes of the longest message."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")
_Text = Annotated[str, Meta(min_length=1, max_length=200)]


class Hello(Struct, frozen=True, kw_only=True):
    """The camera of all frames, and the folder that the program writes them into.

    A pinhole: pixel i covers [i, i + 1), `width`, `height`, `fx`, `fy`, `cx` and `cy` are in
    pixels. `y_down` states that y of the map grows downwards on the drawn plan.
    """

    protocol: int = PROTOCOL
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    y_down: bool
    folder: str


class Parameter(Struct, frozen=True):
    """A number that a renderer can vary. `unit` is "1" for a factor."""

    name: str
    default: float
    minimum: float
    maximum: float
    unit: str = "1"

    def __post_init__(self) -> None:
        """Raises ValueError for a name with other characters, and for an impossible range."""
        if not _NAME.fullmatch(self.name):
            raise ValueError("parameter names hold letters, digits, and _ . - after the first")
        finite = math.isfinite(self.minimum) and math.isfinite(self.maximum)
        if not (finite and self.minimum <= self.default <= self.maximum):
            raise ValueError(
                f"parameter {self.name}: minimum <= default <= maximum does not hold for "
                f"{self.minimum:g}, {self.default:g}, {self.maximum:g}"
            )


class Ready(Struct, frozen=True, forbid_unknown_fields=True):
    """What a program is, and whether it renders depth."""

    name: _Text
    version: _Text
    parameters: tuple[Parameter, ...] = ()
    depth: bool = True

    def __post_init__(self) -> None:
        """Raises ValueError for a parameter that is declared twice."""
        names = [parameter.name for parameter in self.parameters]
        if len(set(names)) < len(names):
            raise ValueError("a parameter is declared twice")


class CameraPose(Struct, frozen=True):
    """A pose on the map, and that of the camera in a right-handed world whose z points up.

    `x` and `y` in metres and `heading` in radians are those of the robot in the map. `position` in
    metres and `quaternion` (w, x, y, z) are those of the camera: x of the world is that of the map,
    y is that of the map, negated where `y_down`. The quaternion turns the optical axes (x right, y
    down, z forward) into the world's.
    """

    x: float
    y: float
    heading: float
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3): a direction in the optical axes, times this matrix from the left, in the world's.

        The columns are the directions to the right, down and forward in the world.
        """
        w, x, y, z = self.quaternion
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )


class RenderRequest(CameraPose, frozen=True, kw_only=True):
    """A frame to render; `rgb` and `depth` name its files in the folder."""

    id: int
    parameters: dict[str, float] = {}
    rgb: str
    depth: str


class Rendered(Struct, frozen=True, forbid_unknown_fields=True):
    """The files of a frame are complete: an 8-bit RGB PNG, and unless `Ready.depth` is false depth.

    Depth is along the optical axis, 0 where there is none: an .npy of float32 (height, width) in
    metres, or a 16-bit PNG in millimetres.
    """

    id: int


class Failed(Struct, frozen=True, forbid_unknown_fields=True):
    """A frame cannot be rendered, for the reason that is stated."""

    id: int
    reason: Annotated[str, Meta(max_length=2000)]


class Bye(Struct, frozen=True):
    """No more frames are needed."""


class Message(Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A message of s2r; one field is set."""

    hello: Hello | None = None
    render: RenderRequest | None = None
    bye: Bye | None = None


class Answer(Struct, frozen=True, omit_defaults=True, kw_only=True, forbid_unknown_fields=True):
    """A message of a renderer; one field is set."""

    ready: Ready | None = None
    rendered: Rendered | None = None
    failed: Failed | None = None


def encode(message: Message | Answer) -> bytes:
    """The line of a message."""
    return msgspec.json.encode(message) + b"\n"


_messages = msgspec.json.Decoder(Message)
_answers = msgspec.json.Decoder(Answer)


def decode_message(line: bytes) -> Message:
    """Raises ValueError if the line is no message of s2r."""
    return _messages.decode(line)


def decode_answer(line: bytes) -> Answer:
    """Raises ValueError if the line is no answer of a renderer."""
    try:
        return _answers.decode(line)
    except RecursionError as error:
        raise ValueError("too many nested values") from error
