"""What is asked of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from s2rstore.errors import RequestError
from s2rstore.metrics.bootstrap import LEVEL
from s2rtools.sysid.parameter_space import Range


@dataclass(frozen=True, slots=True)
class SysidSettings:
    """`parameters` None: those searched by default. `held_out` drives None: a quarter, at least
    one. `evaluations` per seed None: as the simulator says. `window` in s. `ranges` take the place
    of those that the simulator declares.
    """

    simulator: str = "planar"
    parameters: tuple[str, ...] | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)
    seeds: int = 3
    held_out: int | None = None
    window: float = 3.0
    evaluations: int | None = None
    replicates: int = 2000
    level: float = LEVEL
    seed: int = 1
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 1 <= self.seeds <= 100:
            raise RequestError("--seeds: 1 .. 100")
        if self.held_out is not None and self.held_out < 1:
            raise RequestError("--held-out: at least 1")
        if not 0.2 <= self.window <= 600:
            raise RequestError("--window: 0.2 .. 600 s")
        if self.evaluations is not None and not 10 <= self.evaluations <= 1_000_000:
            raise RequestError("--evaluations: 10 .. 1000000")
        if not 0 <= self.seed < 2**31:
            raise RequestError("--seed: 0 .. 2147483647")
