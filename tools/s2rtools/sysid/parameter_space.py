"""The searched parameters as a unit cube, and back to a simulator's values."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Parameter, Simulator


@dataclass(frozen=True, slots=True)
class Space:
    """Coordinates 0 .. 1 per parameter, linear or logarithmic as declared.

    `fixed` are the simulator's other values. `divided` maps a lumped parameter, as `damping/mass`,
    to the simulator's; these are ratios to the simulator's first shared parameter, which is fixed.
    """

    simulator: Simulator
    parameters: tuple[Parameter, ...]
    fixed: Mapping[str, float]
    divided: Mapping[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def lumped(self) -> bool:
        return bool(self.divided)

    def natural(self, cube: Floats) -> Floats:
        """Cube coordinates (..., p) in the parameters' units."""
        return np.stack(
            [_natural(one, cube[..., i]) for i, one in enumerate(self.parameters)], axis=-1
        )

    def cube(self, values: Mapping[str, float]) -> Floats:
        """The coordinates (p,) of the parameters' values, cut to the ranges."""
        return np.array([_share(one, values[one.name]) for one in self.parameters])

    def values(self, cube: Floats) -> dict[str, float]:
        """All values that the simulator takes."""
        found = dict(self.fixed)
        for parameter, value in zip(self.parameters, self.natural(cube).tolist(), strict=True):
            name = self.divided.get(parameter.name)
            if name is None:
                found[parameter.name] = value
            else:
                found[name] = value * self.fixed[self.simulator.shared[0]]
        return found

    def start(self) -> Floats:
        return self.cube({one.name: one.default for one in self.parameters})

    def widened(self, name: str) -> Space:
        """The same with one more parameter of the simulator, now searched."""
        fixed = {other: value for other, value in self.fixed.items() if other != name}
        declared = replace(self.simulator.parameter(name), default=self.fixed[name])
        return replace(self, parameters=(*self.parameters, declared), fixed=fixed)


def space_of(simulator: Simulator, names: Sequence[str] | None, fixed: Mapping[str, float],
             torques_known: bool) -> Space:  # fmt: skip
    """The space of the named parameters (None: those searched by default) and the latency.

    Where torques are not known the shared parameters are searched as ratios, the gain's among
    them. Raises RequestError for unknown names and values out of range.
    """
    declared = {one.name: one for one in simulator.parameters}
    chosen = _chosen(simulator, names, fixed)
    _check_names(simulator, chosen, fixed)
    if LATENCY not in chosen:
        chosen.append(LATENCY)
    values = {**simulator.defaults(), **fixed}
    if torques_known or not simulator.shared:
        searched = tuple(declared[name] for name in chosen)
        others = {name: value for name, value in values.items() if name not in chosen}
        return Space(simulator, searched, others, {})
    reference, *shared = simulator.shared
    wanted = [name for name in shared if name == "gain" or name in chosen]
    ratios = {f"{name}/{reference}": name for name in wanted if name not in fixed}
    searched = (
        *(_ratio(declared[name], declared[reference], values) for name in ratios.values()),
        *(declared[name] for name in chosen if name not in simulator.shared),
    )
    out = {*ratios.values(), *(one.name for one in searched)}
    return Space(simulator, searched, {n: v for n, v in values.items() if n not in out}, ratios)


def _chosen(
    simulator: Simulator, names: Sequence[str] | None, fixed: Mapping[str, float]
) -> list[str]:
    if names is not None:
        return list(dict.fromkeys(names))
    return [one.name for one in simulator.parameters if one.searched and one.name not in fixed]


def check(simulator: Simulator, names: Sequence[str] | None, fixed: Mapping[str, float],
          ranges: Collection[str]) -> None:  # fmt: skip
    """Raises RequestError where `space_of` would, and for ranges that nothing would search."""
    chosen = _chosen(simulator, names, fixed)
    _check_names(simulator, chosen, fixed)
    used = {*chosen, LATENCY, *simulator.shared}
    used |= {one.name for one in simulator.parameters if one.structural}
    for name in ranges:
        if name in fixed or name not in used:
            told = "fixed" if name in fixed else "not searched"
            raise RequestError(f"{name}: {told}, so it needs no range; leave one out")


def _check_names(simulator: Simulator, chosen: Sequence[str], fixed: Mapping[str, float]) -> None:
    known = {one.name: one for one in simulator.parameters}
    for name in (*chosen, *fixed):
        if name not in known:
            raise RequestError(
                f"{name}: no parameter of the simulator {simulator.name} (has: {', '.join(known)})"
            )
    for name, value in fixed.items():
        if name == LATENCY:
            raise RequestError(f"{LATENCY}: always searched; it cannot be fixed")
        if name in chosen:
            raise RequestError(f"{name}: both fixed and searched; leave one out")
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            raise RequestError(f"{name}={value:g}: out of its range {low:g} .. {high:g}")


def _ratio(of: Parameter, to: Parameter, values: Mapping[str, float]) -> Parameter:
    """The parameter `of / to`, over the range that theirs span about `to`'s middle."""
    middle = math.sqrt(to.low * to.high)
    spread = math.sqrt(to.high / to.low)
    low = of.low / middle / (spread if of.scale == "log" else 1.0)
    unit = f"{of.unit}/{to.unit}" if of.unit != "1" else f"1/{to.unit}"
    return Parameter(
        f"{of.name}/{to.name}", unit, low, of.high / middle * spread,
        values[of.name] / values[to.name], f"{of.name} over {to.name}", of.scale, True,
    )  # fmt: skip


def _natural(one: Parameter, share: Floats) -> Floats:
    if one.scale == "log":
        return one.low * (one.high / one.low) ** share
    return one.low + (one.high - one.low) * share


def _share(one: Parameter, value: float) -> float:
    if one.scale == "log":
        value = min(max(value, one.low), one.high)
        return math.log(value / one.low) / math.log(one.high / one.low)
    return min(max((value - one.low) / (one.high - one.low), 0.0), 1.0)


_FARTHEST = 5.0
"""Times the declared range, for parameters of either sign."""


@dataclass(frozen=True, slots=True)
class Range:
    """Searched from `low` to `high`; `scale` None: as the simulator declares it."""

    low: float
    high: float
    scale: Literal["linear", "log"] | None = None


def parse_range(text: str) -> Range:
    """LOW..HIGH, LOW..HIGH:log or LOW..HIGH:linear. Raises RequestError."""
    bounds, _, scale = text.partition(":")
    low, dots, high = bounds.partition("..")
    try:
        found = Range(float(low), float(high), _SCALES[scale.strip()])
    except (KeyError, ValueError):
        dots = ""
    if not dots:
        raise RequestError(f"{text}: expected LOW..HIGH or LOW..HIGH:log, such as 0.1..0.5")
    return found


_SCALES: dict[str, Literal["linear", "log"] | None] = {"": None, "log": "log", "linear": "linear"}


def with_ranges(simulator: Simulator, ranges: Mapping[str, Range]) -> Simulator:
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
