"""Live adjustments: predict with the run's model, which stays loaded between requests."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from s2rstore.errors import RequestError
from s2rstore.heatmap_kinds import heatmap_facts
from s2rstore.reader import Store
from s2rtui.charts.adjust import live_input
from s2rtui.loaders.loader import Fields, LoadContext
from s2rtui.session import adjusting
from s2rtui.session.heatmaps import without_blanks
from s2rtui.session.provenance import instance_provenance
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtools.interactive import LiveModel


class LivePredictor:
    """Holds the model of one run, with its (store path, generation, run)."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._loaded: tuple[tuple[Path, int, str], LiveModel] | None = None

    def model(self, store: Store, run: str) -> LiveModel:
        """The live model of a run; loading it takes seconds. Call with the lock held."""
        from s2rtools.interactive import LiveModel

        key = (store.path, store.generation, run)
        if self._loaded is None or self._loaded[0] != key:
            self._close()
            self._loaded = key, LiveModel(store, run)
        return self._loaded[1]

    def _close(self) -> None:
        if self._loaded is not None:
            self._loaded[1].close()
            self._loaded = None

    def release(self) -> None:
        """Free the model once no request uses it."""
        with self._lock:
            self._close()

    def read(self, store: Store, state: State, context: LoadContext) -> Fields:
        """Publish images and predictions first, then the heatmap, then heat on the map.

        A prediction that has started is finished and shown, so that the screen follows a slider
        that moves faster than the model.
        """
        with self._lock:
            if state.adjust is None or state.cursor is None or not context.is_current():
                return {}
            model = self.model(store, state.run)
            if not context.is_current():
                return {}
            chains = adjusting.adjustment_chains(store, state.adjust)
            heat = state.shown_heat
            if heat is not None and not _is_live(heat.kind, model):
                heat = None
            kinds = () if heat is None else (heat.kind,)
            fields: Fields = {}

            def is_cancelled() -> bool:
                return bool(fields) and not context.is_current()

            for result in model.steps(state.cursor, chains, kinds, is_cancelled):
                ready = heat if heat and any(key[0] == heat.kind for key in result.heat) else None
                grid = None
                if ready is not None:
                    cells = model.floor_grid(result, ready.kind, ready.side, ready.mode)
                    grid = without_blanks(cells, ready, "mean")
                fields = {
                    "live": live_input(store, state, result, ready),
                    "live_source": instance_provenance(state),
                    "live_floor_heat": grid,
                }
                context.publish(fields)
            return fields


def _is_live(kind: str, model: LiveModel) -> bool:
    """Whether a heatmap kind is computed while images are adjusted."""
    return kind in model.kinds and not heatmap_facts(kind).is_slow


_PREDICTOR = LivePredictor()


def release() -> None:
    """Free the loaded model."""
    _PREDICTOR.release()


def live_key(store: Store, state: State) -> tuple[Any, ...] | None:
    """A live prediction is needed while the panel is open and the tools are installed."""
    adjust = state.adjust if state.adjusting else None
    if adjust is None or adjust.missing or state.cursor is None or adjust.run != state.run:
        return None
    steps = adjust.values, adjust.run_steps
    return (state.generation, state.run, state.cursor, *steps, state.heat)


def read_live(store: Store, state: State, context: LoadContext) -> Fields:
    """See `LivePredictor.read`; a missing package is a RequestError that names it."""
    try:
        return _PREDICTOR.read(store, state, context)
    except ModuleNotFoundError as error:
        message = f"live adjustments need {error.name}: pip install 's2rtui[tools]'"
        raise RequestError(message) from error
