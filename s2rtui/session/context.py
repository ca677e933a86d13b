"""The context that reducers read. A reducer is `(context, state, *arguments) -> state`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import Query, base_population
from s2rstore.reader import Store
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes


class BasePopulations:
    """Base populations and trained instances by generation, run and view; equal ones share one
    array.

    Caches that compare arrays by identity then survive a change of the run.
    """

    def __init__(self) -> None:
        self._masks: dict[tuple[object, ...], NDArray[np.bool_]] = {}

    def mask(self, store: Store, state: State, query: Query) -> NDArray[np.bool_]:
        """(N,) mask of the instances that count in the state's run and population."""
        key = (store.generation, state.run, state.population)
        return self._shared(key, lambda: base_population(query.context))

    def trained(self, store: Store, state: State, query: Query) -> NDArray[np.bool_]:
        """(N,) mask of the instances in view that the model of the state's run was trained on."""
        key = (store.generation, state.run, state.trajectories, "trained")
        return self._shared(key, lambda: query.trained)

    def _shared(
        self, key: tuple[object, ...], compute: Callable[[], NDArray[np.bool_]]
    ) -> NDArray[np.bool_]:
        if key not in self._masks:
            computed = compute()
            equal = (mask for mask in self._masks.values() if np.array_equal(mask, computed))
            self._masks[key] = next(equal, computed)
        return self._masks[key]

    def drop_generation(self, generation: int) -> None:
        """Release the masks of a generation that is closed."""
        self._masks = {key: mask for key, mask in self._masks.items() if key[0] != generation}


@dataclass(frozen=True, slots=True)
class SessionContext:
    """The open store, the user's notes, and cached base populations.

    `defers_loading`: background workers read columns, so a reducer must not read them itself.
    """

    store: Store
    notes: Notes
    base_populations: BasePopulations
    defers_loading: bool = False


class Reducer(Protocol):
    """A pure transition: reads the context, returns the next state, changes neither."""

    def __call__(
        self, context: SessionContext, state: State, /, *arguments: Any, **options: Any
    ) -> State: ...
