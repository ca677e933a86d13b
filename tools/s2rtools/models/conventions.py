"""Output conventions: how a network's raw output is decoded to poses on the map."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_json

HeadingUnit = Literal["degrees", "radians", "cos_sin"]
HeadingFrame = Literal["map", "habitat"]


@dataclass(frozen=True, slots=True)
class OutputConvention:
    """Meaning of the raw output: x, y in metres, then the heading or its cosine and sine.

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

        Cosine and sine of a `cos_sin` network are not normalised.
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
        """The form that the index stores."""
        return json.dumps({"frame": self.frame, "heading": self.heading})


def parse_convention(text: str) -> OutputConvention:
    """Parse the index's JSON or an option's `HEADING[,FRAME]`, such as `degrees,map`.

    Raises RequestError naming the key and the allowed values.
    """
    if text.lstrip().startswith("{"):
        table = parse_json(text, "output convention")
        heading, frame = table.get("heading", ""), table.get("frame", "map")
    else:
        heading, _, frame = (part.strip() for part in text.partition(","))
        frame = frame or "map"
    for key, value, kind in (("heading", heading, HeadingUnit), ("frame", frame, HeadingFrame)):
        if value not in get_args(kind):
            known = ", ".join(get_args(kind))
            raise RequestError(f"output convention {text!r}: {key} {value!r}; one of {known}")
    return OutputConvention(heading, frame)
