"""Live adjusting, in a thread of its own: one model kept loaded, the newest request first."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtui.charts.adjust.model import live_input
from s2rtui.loaders.loader import Fields, LoadContext
from s2rtui.session import adjusting
from s2rtui.session.provenance import about
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtools.interactive import LiveModel

SLOW_KINDS = ("occlusion",)
"""Heat that takes many passes is not computed while a slider moves."""


@dataclass(frozen=True, slots=True)
class _Held:
    """A loaded model and what it is of."""

    of: tuple[Path, int, str]
    model: LiveModel


class Bench:
    """The model that is being tried."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: _Held | None = None

    def model(self, store: Store, run: str) -> LiveModel:
        """The live model of a run; loading it takes seconds. Call with the lock held."""
        from s2rtools.interactive import LiveModel

        of = (store.path, store.generation, run)
        if self._held is None or self._held.of != of:
            self._close()
            self._held = _Held(of, LiveModel(store, run))
        return self._held.model

    def _close(self) -> None:
        if self._held is not None:
            self._held.model.close()
            self._held = None

    def leave(self) -> None:
        """Let the model go, once nobody is at it."""
        with self._lock:
            self._close()

    def read(self, store: Store, state: State, caller: LoadContext) -> Fields:
        """Pictures and predictions first, then heat, then heat on the floor.

        A prediction that is begun is finished and brought, so that the screen follows a slider
        that moves faster than the model.
        """
        with self._lock:
            if state.adjust is None or state.cursor is None or not caller.wanted():
                return {}
            model = self.model(store, state.run)
            if not caller.wanted():
                return {}
            chains = adjusting.chains(state.adjust)
            kinds = self._kinds(model, state)
            fields: Fields = {}
            unwanted: Callable[[], bool] = lambda: bool(fields) and not caller.wanted()  # noqa: E731
            for result in model.steps(state.cursor, chains, kinds, unwanted):
                heat = state.heat if state.heat and state.heat.kind in kinds else None
                ready = heat is not None and any(key[0] == heat.kind for key in result.heat)
                shown = live_input(store, state, result, heat if ready else None)
                fields = {"live": shown, "live_source": about(state), "live_floor_heat": None}
                if ready and heat is not None:
                    fields["live_floor_heat"] = model.floor_grid(
                        result, heat.kind, heat.side, heat.mode
                    )
                caller.bring(fields)
            return fields

    def _kinds(self, model: LiveModel, state: State) -> tuple[str, ...]:
        heat = state.heat
        if heat is None or heat.kind in SLOW_KINDS or heat.kind not in model.kinds:
            return ()
        return (heat.kind,)


_BENCH = Bench()


def leave() -> None:
    """Keep nothing."""
    _BENCH.leave()


def wants_live(store: Store, state: State) -> tuple[Any, ...] | None:
    """The live answer is wanted while the panel is open and nothing is missing."""
    adjust = state.adjust if state.adjusting else None
    if adjust is None or adjust.missing or state.cursor is None or adjust.run != state.run:
        return None
    return (state.generation, state.run, state.cursor, adjust.values, state.heat)


def read_live(store: Store, state: State, caller: LoadContext) -> Fields:
    """See `Bench.read`; a missing package is a RequestError that names it."""
    try:
        return _BENCH.read(store, state, caller)
    except ModuleNotFoundError as error:
        raise RequestError(
            f"adjusting live needs {error.name}: pip install 's2rtui[tools]'"
        ) from error
