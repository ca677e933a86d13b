"""Ranges of parameters that a user declares, as `latency=0..0.5` and `mass=5..30:log`."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from s2rstore.errors import RequestError
from s2rtools.sysid.simulators.simulator import Parameter, Simulator

_FARTHEST = 5.0
"""Times the declared range, for parameters of either sign."""


@dataclass(frozen=True, slots=True)
class Range:
    """Searched from `low` to `high`; `scale` None: as the simulator declares it."""

    low: float
    high: float
    scale: Literal["linear", "log"] | None = None


def parsed(text: str) -> Range:
    """LOW..HIGH, LOW..HIGH:log or LOW..HIGH:linear. Raises RequestError."""
    bounds, _, scale = text.partition(":")
    low, dots, high = bounds.partition("..")
    try:
        found = Range(float(low), float(high), _SCALES[scale.strip()])
    except (KeyError, ValueError):
        dots = ""
    if not dots:
        raise RequestError(f"{text}: give LOW..HIGH or LOW..HIGH:log, as 0.1..0.5")
    return found


_SCALES: dict[str, Literal["linear", "log"] | None] = {"": None, "log": "log", "linear": "linear"}


def ranged(simulator: Simulator, ranges: Mapping[str, Range]) -> Simulator:
    """The simulator with other ranges.

    Raises RequestError for unknown parameters and ranges that it cannot have.
    """
    known = {one.name: one for one in simulator.parameters}
    for name, wanted in ranges.items():
        if name not in known:
            told = f"{name}: no parameter of the simulator {simulator.name}"
            raise RequestError(f"{told} (has: {', '.join(known)})")
        known[name] = _with(known[name], wanted)
    made = copy.copy(simulator)
    made.parameters = tuple(known.values())
    return made


def _with(one: Parameter, wanted: Range) -> Parameter:
    scale = wanted.scale or one.scale
    told = f"{one.name}={wanted.low:g}..{wanted.high:g}"
    if not (math.isfinite(wanted.low) and math.isfinite(wanted.high) and wanted.low < wanted.high):
        raise RequestError(f"{told}: must be two numbers, the lower first")
    if one.low < 0:
        least, most = _FARTHEST * one.low, _FARTHEST * one.high
        if not least <= wanted.low < wanted.high <= most:
            raise RequestError(f"{told}: must lie within {least:g} .. {most:g}")
    elif wanted.low < 0 or (wanted.low == 0 and one.low > 0):
        raise RequestError(f"{told}: must be {'over' if one.low > 0 else 'at least'} 0")
    if scale == "log" and wanted.low <= 0:
        raise RequestError(f"{told}:log: a logarithmic range must begin over 0")
    return replace(one, low=wanted.low, high=wanted.high, scale=scale)
