"""What something that was read is of, so that it is shown under no other name."""

from __future__ import annotations

from dataclasses import dataclass

from s2rtui.analysis.identity_cache import ArrayKey
from s2rtui.session.state import HeatChoice, State


@dataclass(frozen=True, slots=True)
class InstanceProvenance:
    """Pictures of one instance: whose, and which heat lies on them."""

    generation: int
    run: str
    iid: int | None
    heat: HeatChoice | None

    @property
    def source(self) -> tuple[int, str]:
        """What was read from."""
        return self.generation, self.run

    def told(self, state: State) -> str:
        """`41, activation (loss)`, and what is not that of the state."""
        parts = [f"{self.iid}", *([self.heat.label] if self.heat else ())]
        parts += [f"run {self.run}"] if self.run != state.run else []
        parts += [f"generation {self.generation}"] if self.generation != state.generation else []
        return ", ".join(parts)


def about(state: State) -> InstanceProvenance:
    """What pictures for a state are of."""
    return InstanceProvenance(state.generation, state.run, state.cursor, state.heat)


@dataclass(frozen=True, slots=True)
class HeatProvenance:
    """Heat on the map: `name` is what it is called by, `whose` the instance or the selection."""

    name: tuple[object, ...]
    whose: int | ArrayKey | None

    def told(self, state: State) -> str:
        """What differs from the state; empty for nothing."""
        if self == heat_of(state):
            return ""
        return f"of {self.whose}" if isinstance(self.whose, int) else "of an earlier selection"


def heat_of(state: State) -> HeatProvenance:
    """What the heat on the map is of."""
    whose: int | ArrayKey | None = None
    if state.overlay == "instance":
        whose = state.cursor
    elif state.overlay == "selection":
        whose = ArrayKey(state.selected)
    name = (state.generation, state.run, state.heat, state.overlay, state.aggregate)
    return HeatProvenance(name, whose)


def seen_of(state: State) -> tuple[object, ...]:
    """What it depends on which cells of the floor were seen."""
    return (state.generation, state.run, state.side, ArrayKey(state.selected))
