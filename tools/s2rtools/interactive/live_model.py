"""One run's model, kept loaded, answering for one instance at a time under any adjustments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry.floor_grid import MapGrid, Projector
from s2rstore.geometry.reprojection import HeatSurface
from s2rstore.metrics import pose_metrics
from s2rstore.reader import DEFAULT_MODES, Store
from s2rstore.records import SIDES, Run, Side
from s2rstore.run_inputs import run_domain, run_move
from s2rtools.adjustments import Chain
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import Backend
from s2rtools.interactive.live_result import HeatKey, LiveResult, LiveSide
from s2rtools.interactive.recent import RecentValues
from s2rtools.models.library import load_model
from s2rtools.precompute import rig_calibration
from s2rtools.precompute.frame_reader import FrameImages, Renderers, RunFrames, side_frames
from s2rtools.precompute.run_context import as_stored, side_batch
from s2rtools.precompute.stages import MAP_SETTINGS
from s2rtools.rendering import no_renderer_reason

_HELD = 8

Chains = Mapping[Side, Chain]
Cancelled = Callable[[], bool]


def _never() -> bool:
    return False


@dataclass(frozen=True, slots=True, eq=False)
class _Answer:
    """A side after the forward pass."""

    shown: LiveSide
    batch: SideBatch


class LiveModel:
    """Computes what precompute would store for a run of the same model with the given chains.

    For use by one thread at a time, any one. What did not change since the last calls is not
    computed again: an unchanged side, frames that were read or rendered. Always plain torch in
    float32, which is what a saved run is computed with.
    """

    def __init__(self, store: Store, run: str, trust: bool = False, threads: int = 0) -> None:
        """Load the model of a run and warm it up; `threads` 0 leaves torch's own setting.

        The store is opened once more at its generation, so that the caller may close its own.
        Raises RequestError where the model cannot be loaded, or executes code and is not trusted.
        """
        self._store = s2rstore.open(store.path, generation=store.generation)
        try:
            self.run = self._store.run(run)
            self._backend = Backend(load_model(self._store, self.run.model, trust), threads)
            height, width = self._backend.model.network.input_size
            self._backend.forward_all(np.zeros((1, 4, height, width), dtype=np.float32))
        except BaseException:
            self._store.close()
            raise
        self._renderers: Renderers = {}
        self._frames: RecentValues[FrameImages] = RecentValues(2 * _HELD)
        self._answers: RecentValues[_Answer] = RecentValues(2 * _HELD)
        self._alignments: RecentValues[ImageAlignment | None] = RecentValues(2)
        self._types: dict[str, dict[tuple[str | None, str | None], str]] = {}

    def close(self) -> None:
        self._store.close()

    @property
    def reason_against_moving(self) -> str | None:
        """Why the adjustments that need a renderer cannot be had here; None where they can."""
        return no_renderer_reason(self._store)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The heatmap kinds that can be asked for, those that need many passes last."""
        known = self._store.correction(self.run.sim_domain, self.run.real_domain) is not None
        suited = [
            kind for kind in HEATMAP_KINDS.values()
            if kind.suits(self._backend.model) and (known or not kind.aligned)
        ]  # fmt: skip
        return tuple(kind.name for kind in sorted(suited, key=lambda kind: kind.cost != "forward"))

    def compute(
        self, iid: int, chains: Chains, kinds: Sequence[str] = (), cancelled: Cancelled = _never
    ) -> LiveResult | None:
        """The last of `steps`; None where it was cancelled."""
        found = list(self.steps(iid, chains, kinds, cancelled))
        return found[-1] if found and not cancelled() else None

    def steps(
        self, iid: int, chains: Chains, kinds: Sequence[str] = (), cancelled: Cancelled = _never
    ) -> Iterator[LiveResult]:
        """Pictures and predictions first, then the same with each heatmap kind as it is ready.

        A side that `chains` does not name keeps the run's own adjustments. `cancelled` is asked
        between the steps; once it says so, nothing more comes. Raises RequestError for unknown
        instances, adjustments and kinds, and for cameras that cannot be moved.
        """
        run = self._adjusted(iid, chains)
        self._check(kinds)
        answers: dict[Side, _Answer] = {}
        for side in SIDES:
            if cancelled():
                return
            answers[side] = self._answer(run, side, iid)
        if cancelled():
            return
        result = LiveResult(iid, answers["sim"].shown, answers["real"].shown)
        yield result
        pair = None
        for kind in kinds:
            if cancelled():
                return
            pair = pair or self._pair(run, answers)
            result = replace(result, heat={**result.heat, **self._heat(kind, pair)})
            yield result

    def floor_grid(
        self, result: LiveResult, kind: str, side: Side, mode: str | None = None
    ) -> NDArray[np.float32]:
        """One of a result's heatmaps on the floor: the mean per cell of the map grid, NaN where
        nothing fell, as precompute lays it for this instance alone.
        """
        heat = result.heatmap(kind, side, mode)
        dataset, truth = self._store.dataset, self._store.instances
        frame = dataset.frame_height, dataset.frame_width
        own, other = result.side(side), result.side("real" if side == "sim" else "sim")
        surface = HeatSurface(
            own.domain, other.domain, frame, side == "real",
            self._store.correction(self.run.sim_domain, self.run.real_domain),
            HEATMAP_KINDS[kind].surface if HEATMAP_KINDS[kind].aligned else None,
        )  # fmt: skip
        grid = MapGrid(dataset.bounds, MAP_SETTINGS["cells"])
        heights = tuple(MAP_SETTINGS["heights"])
        projector = Projector(surface.domain, frame, dataset.y_down, heights)
        away = other.surface[None] if surface.needs_other else None
        pose = np.array([[getattr(truth, name)[result.iid] for name in ("x", "y", "heading")]])
        ray = HEATMAP_KINDS[kind].ray(mode or DEFAULT_MODES.get(kind))
        depth = surface.depth(own.surface[None], away)
        grid.add(*projector.project(heat[None], depth, pose, ray, grid))
        return np.asarray(grid.aggregates()[0])

    def _adjusted(self, iid: int, chains: Chains) -> Run:
        """The run as it would be with these chains."""
        count = len(self._store.instances)
        if not 0 <= iid < count:
            raise RequestError(f"instance {iid}: the store holds 0 .. {count - 1}")
        own = {side: chains.get(side, self.run.adjustments(side)) for side in SIDES}
        sim, real = ([dict(step) for step in own[side]] for side in SIDES)
        return replace(self.run, sim_adjustments=sim, real_adjustments=real)

    def _check(self, kinds: Sequence[str]) -> None:
        known = self.kinds if kinds else ()
        for kind in kinds:
            if kind not in known:
                raise RequestError(f"heatmap kind {kind!r}: one of {', '.join(known)}")

    def _answer(self, run: Run, side: Side, iid: int) -> _Answer:
        chain = tuple((step["name"], float(step["value"])) for step in run.adjustments(side))
        key = iid, run.domain(side), chain
        return self._answers.get(key, lambda: self._compute_side(run, side, iid))

    def _compute_side(self, run: Run, side: Side, iid: int) -> _Answer:
        domain, move = run_domain(self._store, run, side), run_move(self._store, run, side)
        source = RunFrames(self._store, run, renderers=self._renderers)
        images = self._frames.get(
            (iid, domain.domain, move), lambda: source.read(side, iid, iid + 1)
        )
        size = self._backend.model.network.input_size
        frames = side_frames(images, domain, run.adjustments(side), size)
        truth = self._store.instances
        pose = np.array([[truth.x[iid], truth.y[iid], truth.heading[iid]]])
        batch = side_batch(self._backend, frames, pose)
        metres = np.where(frames.valid[0], frames.depth[0] * np.float32(domain.depth_scale), np.nan)
        x, y, heading = (float(value) for value in _known(batch.prediction)[0])
        shown = LiveSide(
            domain, frames.rgb[0], metres.astype(np.float32), images["depth"][0], x, y, heading,
            math.hypot(x - pose[0, 0], y - pose[0, 1]),
            float(pose_metrics.heading_error(np.array([heading]), pose[:, 2])[0]),
        )  # fmt: skip
        return _Answer(shown, batch)

    def _pair(self, run: Run, answers: Mapping[Side, _Answer]) -> PairBatch:
        moves = tuple(run_move(self._store, run, side) for side in SIDES)
        aligned = self._alignments.get(
            moves, lambda: rig_calibration.load_alignment(self._store, run)
        )
        sim, real = (answers[side].batch for side in SIDES)
        return PairBatch(self._backend.model, self._backend, sim, real, aligned)

    def _heat(self, name: str, pair: PairBatch) -> dict[HeatKey, NDArray[np.float32]]:
        """A kind's maps of both sides in the precision that precompute stores them in."""
        kind = HEATMAP_KINDS[name]
        if name not in self._types:
            outputs = kind.outputs(self._backend.model)
            self._types[name] = {(out.side, out.mode): out.dtype for out in outputs}
        found: dict[HeatKey, NDArray[np.float32]] = {}
        for (own, mode), values in kind.compute(pair).items():
            made = as_stored(values, self._types[name][own, mode]).astype(np.float32)[0]
            for side in SIDES:
                if own not in (side, None):
                    continue
                if kind.planes:
                    found |= {(name, side, plane): made[n] for n, plane in enumerate(kind.planes)}
                else:
                    found[name, side, mode] = made[0] if made.ndim == 3 else made
        return found


def _known(poses: NDArray[Any]) -> NDArray[np.float64]:
    """Poses (n, 3); one that is not finite is missing as a whole."""
    return np.where(np.isfinite(poses).all(axis=1, keepdims=True), poses, np.nan)
