"""Interface of simulators whose parameters can be identified."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from s2rtools.motion_logs import Commands

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Values = Mapping[str, float]
LATENCY = "latency"
"""The parameter that every simulator declares: time from a command to its first effect, s."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a simulator, with its range.

    `searched`: part of the default search; `structural`: a difference of the robot's construction,
    which is tested but not searched by default.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    scale: Literal["linear", "log"] = "log"
    searched: bool = False
    structural: bool = False

    def at_share(self, share: Floats) -> Floats:
        """Values at `share`, positions 0 .. 1 in the range."""
        if self.scale == "log":
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def share_of(self, value: float) -> float:
        """The position 0 .. 1 of a value in the range, clipped."""
        if self.scale == "log":
            value = min(max(value, self.low), self.high)
            return math.log(value / self.low) / math.log(self.high / self.low)
        return min(max((value - self.low) / (self.high - self.low), 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Replays:
    """Many replays of commands, packed into arrays.

    Replay i starts at the first of the times `times[first[i] : first[i + 1]]` (s, increasing). It
    executes the commands of drive d = `drive[i]`: `values[:, held[d] : held[d + 1]]`, each from its
    `command_time` on; before the first command every channel is 0.
    """

    times: Floats
    first: Integers
    drive: Integers
    command_time: Floats
    values: Floats
    held: Integers

    def __len__(self) -> int:
        return len(self.first) - 1


def pack(commands: Sequence[Commands], replays: Sequence[tuple[int, Floats]],
         channels: Sequence[str]) -> Replays:  # fmt: skip
    """Pack `replays`, pairs of an index into `commands` and the times of the replay."""
    values = [np.concatenate([each.channels[name] for each in commands]) for name in channels]
    return Replays(
        np.ascontiguousarray(np.concatenate([times for _, times in replays])),
        np.cumsum([0, *(len(times) for _, times in replays)]),
        np.array([drive for drive, _ in replays], dtype=np.int64),
        np.ascontiguousarray(np.concatenate([each.time for each in commands])),
        np.ascontiguousarray(np.stack(values)),
        np.cumsum([0, *(len(each.time) for each in commands)]),
    )


class Simulator:
    """A simulated robot; each simulator is one module and one entry of `SIMULATORS`.

    A state is (x, y, heading, speed, turn rate) in m, rad, m/s and rad/s; the robot does not slip
    sideways.
    """

    name: ClassVar[str]
    parameters: tuple[Parameter, ...]
    torques: ClassVar[tuple[str, ...]]
    """Channels of known wheel torques, N m."""
    efforts: ClassVar[tuple[str, ...]]
    """Channels, in the order of `torques`, in units that the parameter `gain` converts to N m."""
    shared: ClassVar[tuple[str, ...]] = ()
    """Parameters whose common factor changes no motion. Where torques are unknown, the others are
    searched as ratios to the first."""
    evaluations: ClassVar[int] = 400
    """Default number of evaluations of the objective per seed."""

    def replay(self, values: Values, replays: Replays, states: Floats) -> Floats:
        """States (n, 5) at all times, from the start `states` (r, 5); `values` of all parameters.

        Deterministic; must not raise inside the declared ranges.
        """
        raise NotImplementedError

    def simulate(self, values: Values, commands: Commands, state: Floats, times: Floats) -> Floats:
        """States (n, 5) at `times`, from `state` (5,) at the first; missing values are defaults."""
        replays = pack([commands], [(0, np.asarray(times, np.float64))], self.channels(commands))
        return self.replay({**self.defaults(), **values}, replays, np.atleast_2d(state))

    def defaults(self) -> dict[str, float]:
        return {parameter.name: parameter.default for parameter in self.parameters}

    def parameter(self, name: str) -> Parameter:
        """Raises KeyError for an unknown name."""
        return {parameter.name: parameter for parameter in self.parameters}[name]

    def channels(self, commands: Commands) -> tuple[str, ...]:
        """The channels of `commands` that the simulator uses. Raises KeyError without any."""
        for names in (self.torques, self.efforts):
            if all(name in commands.channels for name in names):
                return names
        raise KeyError(", ".join(self.torques))
