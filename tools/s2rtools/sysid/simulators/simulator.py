"""What a simulator must offer so that its parameters can be identified."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from s2rtools.motion_logs import Commands

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Values = Mapping[str, float]
LATENCY = "latency"
"""The parameter that every simulator declares: s from a command to its first effect."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a simulator, with its range.

    `searched` by default; `structural`: a way in which reality may differ that is no tuning knob,
    kept out of the default search and only tested; `smooth`: least squares may fit it.
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
    smooth: bool = True


@dataclass(frozen=True, slots=True)
class Replays:
    """Many stretches of driving, packed.

    Replay i covers `times[first[i] : first[i + 1]]` (s, increasing; it starts at the first of
    them) under the commands of drive `drive[i]`, `values[:, held[d] : held[d + 1]]`, that hold
    from `command_time` on; before the first of them every channel is 0.
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
    """`replays` are (number of the drive, its times)."""
    lengths = [len(times) for _, times in replays]
    held = np.cumsum([0, *(len(told.time) for told in commands)])
    values = [np.concatenate([told.channels[name] for told in commands]) for name in channels]
    return Replays(
        np.ascontiguousarray(np.concatenate([times for _, times in replays])),
        np.cumsum([0, *lengths]),
        np.array([drive for drive, _ in replays], dtype=np.int64),
        np.ascontiguousarray(np.concatenate([told.time for told in commands])),
        np.ascontiguousarray(np.stack(values)),
        held,
    )


Residual = Callable[[Floats], Floats]
"""Columns of normalised parameters (p, k) in, columns of residuals (n, k) out."""


class Simulator:
    """A simulated robot: a file of its own and a line in `SIMULATORS`.

    A state is (x, y, heading, speed, turn rate) in m, rad, m/s and rad/s; the robot does not slip
    sideways.
    """

    name: ClassVar[str]
    parameters: tuple[Parameter, ...]
    torques: ClassVar[tuple[str, ...]]
    """Channels of known wheel torques, N m."""
    efforts: ClassVar[tuple[str, ...]]
    """Channels, in the order of `torques`, in units that a parameter of `shared` turns to N m."""
    shared: ClassVar[tuple[str, ...]] = ()
    """Parameters that can all be multiplied by one number, without changing any motion; the first
    is the one that the others are divided by where efforts leave them unknown."""

    evaluations: ClassVar[int] = 400
    """Of the objective, that one seed's search may spend by default."""

    rounds: ClassVar[int] = 8
    """Of least squares and better start states, at most."""

    def replay(self, values: Values, replays: Replays, states: Floats) -> Floats:
        """States (n, 5) at all times, from the start `states` (r, 5); `values` of all parameters.

        Deterministic; must not raise inside the declared ranges.
        """
        raise NotImplementedError

    def simulate(self, values: Values, commands: Commands, state: Floats, times: Floats) -> Floats:
        """States (n, 5) at `times`, from `state` (5,) at the first of them; others at default."""
        replays = pack([commands], [(0, np.asarray(times, np.float64))], self.channels(commands))
        return self.replay({**self.defaults(), **values}, replays, np.atleast_2d(state))

    def polish(self, residual: Residual, start: Floats, smooth: NDArray[np.bool_]) -> Floats | None:
        """The simulator's own least squares from `start` (p,) in [0, 1]; None where it has none."""
        return None

    def defaults(self) -> dict[str, float]:
        return {parameter.name: parameter.default for parameter in self.parameters}

    def parameter(self, name: str) -> Parameter:
        """Raises KeyError."""
        return {parameter.name: parameter for parameter in self.parameters}[name]

    def channels(self, commands: Commands) -> tuple[str, ...]:
        """The channels of `commands` that drive it; raises KeyError where it has none."""
        for names in (self.torques, self.efforts):
            if all(name in commands.channels for name in names):
                return names
        raise KeyError(", ".join(self.torques))
