"""A loaded model that predicts one instance at a time under any adjustments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.geometry.floor_grid import FloorHeat
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.lru_cache import LruCache
from s2rstore.reader import DEFAULT_MODES, Store
from s2rstore.records import SIDES, Domain, Run, Side
from s2rstore.run_inputs import run_domain, run_render_change
from s2rtools.adjustments import Chain
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch, SideBatch
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.inference import open_float32
from s2rtools.models.load_model import load_model
from s2rtools.precompute.domain_calibration import load_alignment
from s2rtools.precompute.frame_reader import (
    FrameImages,
    Renderers,
    RunFrames,
    SourceBlock,
    side_frames,
)
from s2rtools.precompute.tasks.network_outputs import as_stored, side_batch

_FRAME_BYTES = 32 << 20
_RESULT_BYTES = 64 << 20

Chains = Mapping[Side, Chain]
Cancelled = Callable[[], bool]

HeatKey = tuple[str, Side, str | None]
"""Kind, side and mode of a heatmap; modes as `Store.heatmap` names them."""
Heat = Mapping[HeatKey, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class LiveSide:
    """Network input of one side, and the predicted pose.

    rgb (H, W, 3) uint8; depth (H, W) metres, NaN where invalid; both adjusted. `original` is the
    RGB image before the adjustments, None where no translator is among them. `surface` (H, W) is
    the raw depth before image adjustments, on which heat is projected. `domain` holds the cameras
    of the frame. x, y and error in metres, heading and heading_error in radians; NaN without a
    prediction.
    """

    domain: Domain
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    surface: NDArray[np.uint8] | NDArray[np.uint16]
    x: float
    y: float
    heading: float
    error: float
    heading_error: float
    original: NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LiveResult:
    """Both sides of one instance, with the heatmaps computed so far."""

    iid: int
    sim: LiveSide
    real: LiveSide
    heat: Heat = field(default_factory=dict)

    def side(self, side: Side) -> LiveSide:
        return self.sim if side == "sim" else self.real

    def default_mode(self, kind: str) -> str | None:
        """As `Store.default_mode`, of the heatmaps computed so far."""
        usual = DEFAULT_MODES.get(kind)
        modes = [mode for name, _, mode in self.heat if name == kind]
        return usual if usual in modes or not modes else modes[0]

    def heatmap(self, kind: str, side: Side, mode: str | None = None) -> NDArray[np.float32]:
        """A heatmap (rows, columns), as from `Store.heatmap`. RequestError if not computed."""
        key = kind, side, mode or self.default_mode(kind)
        if key not in self.heat:
            raise RequestError(f"heatmap {kind} {key[2] or ''}: not computed for these adjustments")
        return self.heat[key]


SideOutput = tuple[LiveSide, SideBatch]
"""A side after the forward pass."""


_SideImages = tuple[FrameImages, list[SourceBlock] | None]
"""A side's images of the frame size, and of the size of their source if that is another."""


def _image_bytes(images: _SideImages) -> int:
    blocks = [images[0], *(images[1] or [])]
    return sum(image.nbytes for block in blocks for image in block.values())


def _output_bytes(output: SideOutput) -> int:
    side, batch = output
    arrays = side.rgb, side.depth, side.surface, batch.x, batch.features, batch.embedding
    return sum(array.nbytes for array in arrays if array is not None)


class LiveModel:
    """Computes the values that precompute stores for a run of the same model with other chains.

    Only one thread may use it at a time. Recent frames and sides are cached. It always runs torch
    in float32; the values of a saved run deviate from it as the provenance of that run states.
    """

    def __init__(self, store: Store, run: str, trust: bool = False, threads: int = 0) -> None:
        """Load the model of a run and warm it up; `threads` 0 keeps torch's setting.

        Opens the store separately at the same generation, so that the caller may close it. Raises
        RequestError if the model cannot be loaded, or executes code and is not trusted.
        """
        self._store = s2rstore.open(store.path, generation=store.generation)
        try:
            self.run = self._store.run(run)
            model = self.run.network("live prediction")
            self._backend = open_float32(load_model(self._store, model, trust), threads)
            shape = self._backend.model.contract.shape
            self._backend.forward_all(np.zeros((1, *shape), dtype=np.float32))
        except BaseException:
            self._store.close()
            raise
        self._renderers: Renderers = {}
        self._frames = LruCache(_FRAME_BYTES, _image_bytes)
        self._outputs = LruCache(_RESULT_BYTES, _output_bytes)
        self._alignment: tuple[tuple[Any, ...], ImageAlignment | None] = ((), None)
        self._types: dict[str, dict[tuple[str | None, str | None], str]] = {}

    def close(self) -> None:
        self._store.close()

    @property
    def kinds(self) -> tuple[str, ...]:
        """The available heatmap kinds; those that need many passes come last."""
        calibrated = self._store.rig_offset(self.run.sim_domain, self.run.real_domain) is not None
        suited = [
            kind for kind in HEATMAP_KINDS.values()
            if kind.suits(self._backend.model) and (calibrated or not kind.aligned)
        ]  # fmt: skip
        return tuple(kind.name for kind in sorted(suited, key=lambda kind: kind.cost != "forward"))

    def compute(
        self, iid: int, chains: Chains, kinds: Sequence[str] = (),
        cancelled: Cancelled = lambda: False,
    ) -> LiveResult | None:  # fmt: skip
        """The last result of `steps`; None if cancelled."""
        results = list(self.steps(iid, chains, kinds, cancelled))
        return results[-1] if results and not cancelled() else None

    def steps(
        self, iid: int, chains: Chains, kinds: Sequence[str] = (),
        cancelled: Cancelled = lambda: False,
    ) -> Iterator[LiveResult]:  # fmt: skip
        """Yield images and predictions first, then the same with each heatmap kind added.

        A side that `chains` does not name keeps the run's adjustments. The iteration ends when
        `cancelled` returns True between two steps. Raises RequestError for unknown instances,
        adjustments and kinds, and for cameras that cannot be moved.
        """
        count = len(self._store.instances)
        if not 0 <= iid < count:
            raise RequestError(f"instance {iid}: the store holds 0 .. {count - 1}")
        known = self.kinds if kinds else ()
        for kind in kinds:
            if kind not in known:
                raise RequestError(f"heatmap kind {kind!r}: one of {', '.join(known)}")
        sim, real = (
            [dict(step) for step in chains.get(side, self.run.adjustments(side))] for side in SIDES
        )
        run = replace(self.run, sim_adjustments=sim, real_adjustments=real)
        outputs: list[SideOutput] = []
        for side in SIDES:
            if cancelled():
                return
            chain = tuple(
                (step["name"], float(step["value"]), step.get("sha256"))
                for step in run.adjustments(side)
            )
            compute = partial(self._compute_side, run, side, iid)
            outputs.append(self._outputs.get((iid, run.domain(side), chain), compute))
        if cancelled():
            return
        (sim_side, sim_batch), (real_side, real_batch) = outputs
        result = LiveResult(iid, sim_side, real_side)
        yield result
        pair = None
        for kind in kinds:
            if cancelled():
                return
            pair = pair or self._pair_batch(run, sim_batch, real_batch)
            result = replace(result, heat={**result.heat, **self._heatmaps(kind, pair)})
            yield result

    def floor_grid(
        self, result: LiveResult, kind: str, side: Side, mode: str | None = None
    ) -> NDArray[np.float32]:
        """Project one of a result's heatmaps on the floor, as precompute does for one instance.

        Returns the mean per cell of the map grid, NaN in empty cells.
        """
        heat = result.heatmap(kind, side, mode)
        dataset = self._store.dataset
        this, other = result.side(side), result.side("real" if side == "sim" else "sim")
        ray = HEATMAP_KINDS[kind].ray(mode or result.default_mode(kind))
        floor_heat = FloorHeat(
            this.domain, other.domain, dataset, side,
            self._store.rig_offset(self.run.sim_domain, self.run.real_domain),
            HEATMAP_KINDS[kind].surface if HEATMAP_KINDS[kind].aligned else None, ray,
        )  # fmt: skip
        sides = (this, other) if floor_heat.needs_other else (this,)
        self._store.require_depth((each.domain.domain for each in sides), "heat on the map")
        grid = MapGrid(dataset.bounds)
        other_depth = other.surface[None] if floor_heat.needs_other else None
        pose = self._store.poses(this.domain.domain)[result.iid][None]
        samples = floor_heat.samples(this.surface[None], other_depth, pose, grid)
        grid.add(*samples.values(heat[None], ray))
        return np.asarray(grid.aggregates()[0])

    def _compute_side(self, run: Run, side: Side, iid: int) -> SideOutput:
        domain, move = run_domain(self._store, run, side), run_render_change(self._store, run, side)
        source = RunFrames(self._store, run, renderers=self._renderers)

        def read() -> _SideImages:
            return source.read(side, iid, iid + 1), source.read_source(side, iid, iid + 1)

        images, blocks = self._frames.get((iid, domain.domain, move), read)
        frames = side_frames(
            images, domain, run.adjustments(side), self._backend.model.contract, self._store.path,
            blocks,
        )  # fmt: skip
        pose = self._store.poses(domain.domain)[iid][None]
        batch = side_batch(self._backend, frames, pose)
        metres = np.where(frames.valid[0], frames.depth[0] * np.float32(domain.depth_scale), np.nan)
        is_translated = any("sha256" in step for step in run.adjustments(side))
        finite = np.isfinite(batch.prediction[0]).all()
        x, y, heading = (float(v) if finite else math.nan for v in batch.prediction[0])
        live = LiveSide(
            domain, frames.rgb[0], metres.astype(np.float32), images["depth"][0], x, y, heading,
            math.hypot(x - pose[0, 0], y - pose[0, 1]),
            float(angles.distance(np.array([heading]), pose[:, 2])[0]),
            images["rgb"][0] if is_translated else None,
        )  # fmt: skip
        return live, batch

    def _pair_batch(self, run: Run, sim: SideBatch, real: SideBatch) -> PairBatch:
        moves = tuple(run_render_change(self._store, run, side) for side in SIDES)
        if self._alignment[0] != moves:
            self._alignment = moves, load_alignment(self._store, run)
        return PairBatch(self._backend.model, self._backend, sim, real, self._alignment[1])

    def _heatmaps(self, name: str, pair: PairBatch) -> dict[HeatKey, NDArray[np.float32]]:
        """A kind's maps of both sides, rounded to the precision of the stored arrays."""
        kind = HEATMAP_KINDS[name]
        if name not in self._types:
            outputs = kind.outputs(self._backend.model)
            self._types[name] = {(out.side, out.mode): out.dtype for out in outputs}
        heatmaps: dict[HeatKey, NDArray[np.float32]] = {}
        for (output_side, mode), values in kind.compute(pair).items():
            heat = as_stored(values, self._types[name][output_side, mode]).astype(np.float32)[0]
            for side in SIDES:
                if output_side not in (side, None):
                    continue
                if kind.planes:
                    heatmaps |= {
                        (name, side, plane): heat[n] for n, plane in enumerate(kind.planes)
                    }
                else:
                    heatmaps[name, side, mode] = heat[0] if heat.ndim == 3 else heat
        return heatmaps
