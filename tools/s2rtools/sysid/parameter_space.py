"""The searched parameters as coordinates of the unit cube, and their search ranges."""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Parameter, Simulator


@dataclass(frozen=True, slots=True)
class Space:
    """Coordinates 0 .. 1 per parameter, on a linear or logarithmic scale as declared.

    `fixed` are the values of the simulator's other parameters. `divided` maps a lumped parameter,
    such as `damping/mass`, to the simulator's parameter; it is the ratio to the simulator's first
    shared parameter, which is fixed.
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
        columns = [one.at_share(cube[..., i]) for i, one in enumerate(self.parameters)]
        return np.stack(columns, axis=-1)

    def cube(self, values: Mapping[str, float]) -> Floats:
        """The coordinates (p,) of the parameters' values, clipped to the ranges."""
        return np.array([one.share_of(values[one.name]) for one in self.parameters])

    def values(self, cube: Floats) -> dict[str, float]:
        """The values of all parameters of the simulator."""
        values = dict(self.fixed)
        for parameter, value in zip(self.parameters, self.natural(cube).tolist(), strict=True):
            name = self.divided.get(parameter.name)
            if name is None:
                values[parameter.name] = value
            else:
                values[name] = value * self.fixed[self.simulator.shared[0]]
        return values

    def start(self) -> Floats:
        """The coordinates (p,) of the default values."""
        return self.cube({one.name: one.default for one in self.parameters})

    def widened(self, name: str) -> Space:
        """This space with one more searched parameter, which was fixed."""
        fixed = {other: value for other, value in self.fixed.items() if other != name}
        declared = replace(self.simulator.parameter(name), default=self.fixed[name])
        return replace(self, parameters=(*self.parameters, declared), fixed=fixed)


def space_of(simulator: Simulator, names: Sequence[str] | None, fixed: Mapping[str, float],
             torques_known: bool) -> Space:  # fmt: skip
    """The space of the named parameters (None: those searched by default) and the latency.

    Where torques are not known, the shared parameters and the gain are searched as ratios. Raises
    RequestError for unknown names and values out of range.
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
    ratios = {
        f"{name}/{reference}": name
        for name in shared
        if name not in fixed and (name == "gain" or name in chosen)
    }
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
    """Raises RequestError where `space_of` would, and for ranges of parameters not searched."""
    chosen = _chosen(simulator, names, fixed)
    _check_names(simulator, chosen, fixed)
    used = {*chosen, LATENCY, *simulator.shared}
    used |= {one.name for one in simulator.parameters if one.structural}
    for name in ranges:
        if name in fixed or name not in used:
            state = "fixed" if name in fixed else "not searched"
            raise RequestError(f"{name}: {state}, so it needs no range; leave one out")


def _check_names(simulator: Simulator, chosen: Sequence[str], fixed: Mapping[str, float]) -> None:
    known = _declared(simulator, (*chosen, *fixed))
    for name, value in fixed.items():
        if name == LATENCY:
            raise RequestError(f"{LATENCY}: always searched; it cannot be fixed")
        if name in chosen:
            raise RequestError(f"{name}: both fixed and searched; leave one out")
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            raise RequestError(f"{name}={value:g}: out of its range {low:g} .. {high:g}")


def _declared(simulator: Simulator, names: Iterable[str]) -> dict[str, Parameter]:
    """All parameters by name. Raises RequestError where one of `names` is unknown."""
    known = {one.name: one for one in simulator.parameters}
    for name in names:
        if name not in known:
            raise RequestError(
                f"{name}: no parameter of the simulator {simulator.name} (has: {', '.join(known)})"
            )
    return known


def _ratio(of: Parameter, to: Parameter, values: Mapping[str, float]) -> Parameter:
    """The parameter `of / to`; its range combines both ranges about the middle of `to`."""
    middle = math.sqrt(to.low * to.high)
    spread = math.sqrt(to.high / to.low)
    low = of.low / middle / (spread if of.scale == "log" else 1.0)
    unit = f"{of.unit}/{to.unit}" if of.unit != "1" else f"1/{to.unit}"
    return Parameter(
        f"{of.name}/{to.name}", unit, low, of.high / middle * spread,
        values[of.name] / values[to.name], f"{of.name} over {to.name}", of.scale, True,
    )  # fmt: skip


_MAX_WIDENING = 5.0
"""Largest factor on the declared range of a parameter that may be negative."""


@dataclass(frozen=True, slots=True)
class Range:
    """Search range from `low` to `high`; `scale` None: as the simulator declares it."""

    low: float
    high: float
    scale: Literal["linear", "log"] | None = None


def parse_ranges(texts: Mapping[str, str], prefix: str) -> dict[str, Range]:
    """The range of each parameter, from LOW..HIGH, LOW..HIGH:log or LOW..HIGH:linear.

    Raises RequestError, beginning with `prefix` and the parameter.
    """
    scales: dict[str, Literal["linear", "log"] | None]
    scales = {"": None, "log": "log", "linear": "linear"}
    ranges = {}
    for name, text in texts.items():
        bounds, _, scale = text.partition(":")
        try:
            low, high = bounds.split("..", 1)
            ranges[name] = Range(float(low), float(high), scales[scale.strip()])
        except (KeyError, ValueError):
            raise RequestError(
                f"{prefix}{name}={text}: expected LOW..HIGH or LOW..HIGH:log, such as 0.1..0.5"
            ) from None
    return ranges


def with_ranges(simulator: Simulator, ranges: Mapping[str, Range]) -> Simulator:
    """A copy of the simulator with other ranges.

    Raises RequestError for unknown parameters and for ranges that they cannot have.
    """
    known = _declared(simulator, ranges)
    for name, limits in ranges.items():
        known[name] = _with_range(known[name], limits)
    changed = copy.copy(simulator)
    changed.parameters = tuple(known.values())
    return changed


def _with_range(one: Parameter, limits: Range) -> Parameter:
    scale, low, high = limits.scale or one.scale, limits.low, limits.high
    text = f"{one.name}={low:g}..{high:g}"
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise RequestError(f"{text}: must be two numbers, the lower first")
    if one.low < 0:
        lowest, highest = _MAX_WIDENING * one.low, _MAX_WIDENING * one.high
        if not lowest <= low < high <= highest:
            raise RequestError(f"{text}: must lie within {lowest:g} .. {highest:g}")
    elif low < 0 or (low == 0 and one.low > 0):
        raise RequestError(f"{text}: must be {'above' if one.low > 0 else 'at least'} 0")
    if scale == "log" and low <= 0:
        raise RequestError(f"{text}:log: a logarithmic range must begin above 0")
    return replace(one, low=low, high=high, scale=scale)
