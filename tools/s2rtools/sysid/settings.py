"""Settings of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from s2rstore.errors import RequestError
from s2rstore.intervals import LEVEL
from s2rtools.sysid.parameter_space import Range


@dataclass(frozen=True, slots=True)
class SysidSettings:
    """Settings of an identification, with limits.

    `parameters` None: those searched by default. `held_out` is a number of drives, None: a quarter,
    at least one. `evaluations` per seed, None: the simulator's default. `window` in s. `ranges`
    replace those that the simulator declares.
    """

    simulator: str = "planar"
    parameters: tuple[str, ...] | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)
    seeds: int = 3
    held_out: int | None = None
    window: float = 3.0
    evaluations: int | None = None
    level: float = LEVEL
    seed: int = 1
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def __post_init__(self) -> None:
        held_out, evaluations = self.held_out, self.evaluations
        for valid, message in (
            (1 <= self.seeds <= 100, "--seeds: 1 .. 100"),
            (held_out is None or held_out >= 1, "--held-out: at least 1"),
            (0.2 <= self.window <= 600, "--window: 0.2 .. 600 s"),
            (evaluations is None or 10 <= evaluations <= 10**6, "--evaluations: 10 .. 1000000"),
            (0 <= self.seed < 2**31, "--seed: 0 .. 2147483647"),
        ):
            if not valid:
                raise RequestError(message)
