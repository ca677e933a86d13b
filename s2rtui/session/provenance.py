"""The instance, run and selection that loaded data belong to, so that views label them right."""

from __future__ import annotations

from dataclasses import dataclass, replace

from s2rtui.analysis.identity_cache import ArrayKey
from s2rtui.session.state import HeatChoice, State


@dataclass(frozen=True, slots=True)
class InstanceProvenance:
    """The instance and heatmap that images belong to."""

    generation: int
    run: str
    iid: int | None
    heat: HeatChoice | None

    @property
    def source(self) -> tuple[int, str]:
        """The generation and run that were read."""
        return self.generation, self.run

    def label(self, state: State) -> str:
        """`41, activation (loss)`, and run and generation if they differ from the state's."""
        parts = [f"{self.iid}", *([self.heat.label] if self.heat else ())]
        parts += [f"run {self.run}"] if self.run != state.run else []
        parts += [f"generation {self.generation}"] if self.generation != state.generation else []
        return ", ".join(parts)

    def difference(self, other: InstanceProvenance) -> str:
        """The parts of the label in which it differs from another; empty if they are equal."""
        parts = [f"{self.iid}"] if self.iid != other.iid else []
        if self.heat != other.heat:
            parts.append(self.heat.label if self.heat else "no heat")
        parts += [f"run {self.run}"] if self.run != other.run else []
        parts += [f"generation {self.generation}"] if self.generation != other.generation else []
        return ", ".join(parts)


def instance_provenance(state: State) -> InstanceProvenance:
    """The provenance of images loaded for a state."""
    heat = state.shown_heat and replace(state.shown_heat, side="real")  # images show both sides
    return InstanceProvenance(state.generation, state.run, state.cursor, heat)


@dataclass(frozen=True, slots=True)
class HeatProvenance:
    """The source of heat on the map: `name` identifies it, `members` its instance or selection."""

    name: tuple[object, ...]
    members: int | ArrayKey | None

    def label(self, state: State) -> str:
        """How it differs from the state, as text; empty if it does not."""
        if self == heat_provenance(state):
            return ""
        return f"of {self.members}" if isinstance(self.members, int) else "of an earlier selection"


def heat_provenance(state: State) -> HeatProvenance:
    """The provenance of heat loaded for a state."""
    members: int | ArrayKey | None = None
    if state.overlay == "instance":
        members = state.cursor
    elif state.overlay == "selection":
        members = ArrayKey(state.selected)
    name = (state.generation, state.run, state.heat, state.overlay, state.aggregate)
    return HeatProvenance(name, members)


def visible_floor_key(state: State) -> tuple[object, ...]:
    """Key of everything that the seen floor of the selection depends on."""
    return (state.generation, state.run, state.side, ArrayKey(state.selected))


def groups_key(state: State, grouping: str) -> tuple[object, ...]:
    """Everything that the errors of the groups of a grouping depend on."""
    return state.generation, state.run, grouping, ArrayKey(state.base)
