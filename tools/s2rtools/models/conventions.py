"""What a network's raw output means: unit of the heading and frame, decoded to the map."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rstore.files.input_files import parse_json

HeadingUnit = Literal["degrees", "radians", "cos_sin"]
HeadingFrame = Literal["map", "habitat"]


@dataclass(frozen=True, slots=True)
class OutputConvention:
    """Columns of the raw output: x, y in metres, then the heading or its cosine and sine.

    `frame` is `map` (forward = (cos a, sin a)) or `habitat` (yaw r with forward
    (-sin r, -cos r), so a = -pi/2 - r); positions are map coordinates in both.
    """

    heading: HeadingUnit
    frame: HeadingFrame = "map"

    @property
    def width(self) -> int:
        """K, the number of raw output columns."""
        return 4 if self.heading == "cos_sin" else 3

    def decode(self, raw: Tensor) -> Tensor:
        """(B, K) raw -> (B, 3) x, y in metres, heading in radians of the map frame, in [-pi, pi).

        Differentiable.
        """
        if self.heading == "cos_sin":
            parts = self.components(raw)
            angle = torch.atan2(parts[:, 3], parts[:, 2])
        else:
            angle = self._map_angle(raw)
        wrapped = torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
        return torch.cat([raw[:, :2], wrapped[:, None]], dim=1)

    def components(self, raw: Tensor) -> Tensor:
        """(B, K) raw -> (B, 4) x, y, cosine and sine of the map heading; differentiable.

        Cosine and sine of a `cos_sin` network are as it gives them, not normalised.
        """
        if self.heading != "cos_sin":
            angle = self._map_angle(raw)
            return torch.stack([raw[:, 0], raw[:, 1], angle.cos(), angle.sin()], dim=1)
        if self.frame == "map":
            return raw
        return torch.stack([raw[:, 0], raw[:, 1], -raw[:, 3], -raw[:, 2]], dim=1)

    def _map_angle(self, raw: Tensor) -> Tensor:
        angle = torch.deg2rad(raw[:, 2]) if self.heading == "degrees" else raw[:, 2]
        return -math.pi / 2 - angle if self.frame == "habitat" else angle

    def to_json(self) -> str:
        """The form that the index keeps."""
        return json.dumps({"frame": self.frame, "heading": self.heading})

    @classmethod
    def from_json(cls, text: str) -> OutputConvention:
        return parse_convention(text)


def parse_convention(text: str) -> OutputConvention:
    """From the index's JSON or from a command line's `HEADING[,FRAME]`, such as `degrees,map`.

    Raises RequestError.
    """
    if text.lstrip().startswith("{"):
        given = parse_json(text, "output convention")
        heading, frame = given.get("heading", ""), given.get("frame", "map")
    else:
        heading, _, frame = (part.strip() for part in text.partition(","))
        frame = frame or "map"
    if heading not in get_args(HeadingUnit):
        raise RequestError(_unknown_value(text, "heading", heading, get_args(HeadingUnit)))
    if frame not in get_args(HeadingFrame):
        raise RequestError(_unknown_value(text, "frame", frame, get_args(HeadingFrame)))
    return OutputConvention(heading, frame)


def _unknown_value(text: str, what: str, value: str, allowed: tuple[str, ...]) -> str:
    return f"output convention {text!r}: {what} {value!r}; one of {', '.join(allowed)}"
