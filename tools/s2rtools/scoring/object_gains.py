"""True gains: by how much restoring each changed object lowers the error on each real view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.metrics import run_metrics
from s2rstore.records import SIDES, Side
from s2rtools.common.blocks import evenly_spread
from s2rtools.common.frame_resizing import overlap_shares
from s2rtools.scoring.counterfactual_errors import BATCH, CounterfactualErrors, EvaluatedRuns
from s2rtools.scoring.factor_effects import MIN_SHARE
from s2rtools.scoring.ground_truth import GroundTruth, move_camera
from s2rtools.scoring.harm_metrics import ScoredPairs

INSTANCES = 200
"""Default number of instances per run."""
_PAIRS_AT_ONCE = 128


@dataclass(frozen=True, slots=True, eq=False)
class ObjectGains:
    """V real views, and the K pairs of a view and a changed object that is visible in it.

    `iids` (V,) are in recording order, `trajectory` (V,) their codes. Pair k is object `item[k]` in
    view `view[k]`, ordered by view. By run: `before` (V,), the error in metres; `gain` (K,), the
    error minus that with the object restored, positive where the object harms; `is_new` (V,),
    whether the instance counts for the run. `masks` are the pixels at which the object is visible
    in either scene, packed bits, by run and side; `frame` is (height, width).
    """

    iids: NDArray[np.intp]
    trajectory: NDArray[np.intp]
    view: NDArray[np.intp]
    item: NDArray[np.intp]
    frame: tuple[int, int]
    before: Mapping[str, NDArray[np.float64]]
    gain: Mapping[str, NDArray[np.float64]]
    is_new: Mapping[str, NDArray[np.bool_]]
    masks: Mapping[tuple[str, Side], NDArray[np.uint8]]

    @property
    def runs(self) -> list[str]:
        return list(self.gain)

    def pixels(self, run: str, side: Side) -> NDArray[np.bool_]:
        """(K, height, width) the pixels of the side's image at which each object is visible."""
        height, width = self.frame
        flat = np.unpackbits(self.masks[run, side], axis=1, count=height * width)
        return flat.reshape(-1, height, width).astype(bool)

    def estimates(
        self, run: str, side: Side, maps: NDArray[np.floating], in_metres: bool
    ) -> NDArray[np.float64]:
        """Estimate (K,) of each pair from the heatmaps (V, h, w) of one side of the views.

        In metres: the sum of the heat over the object's visible pixels, a cell counting by the
        share that they cover; unknown heat is 0. Else: the mean heat over these pixels; NaN where
        none is known.
        """
        if len(maps) != len(self.iids):
            raise ValueError(f"{len(maps)} maps for {len(self.iids)} views")
        total, weight = np.zeros((2, self.view.size))
        pixels = self.pixels(run, side)
        for start in range(0, self.view.size, _PAIRS_AT_ONCE):
            rows = slice(start, start + _PAIRS_AT_ONCE)
            covered = _covered_shares(pixels[rows], maps.shape[1:])
            heat = np.asarray(maps[self.view[rows]], dtype=np.float64)
            known = np.isfinite(heat)
            total[rows] = (np.where(known, heat, 0.0) * covered).sum(axis=(1, 2))
            weight[rows] = (covered * known).sum(axis=(1, 2))
        if in_metres:
            return total
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(weight > 0, total / weight, np.nan)

    def pairs(
        self, run: str, estimate: NDArray[np.floating], in_metres: bool = False
    ) -> ScoredPairs:
        """True gains of a run with estimates (K,), over the instances that are new to the run."""
        new = self.is_new[run][self.view]
        return ScoredPairs(
            self.gain[run][new], np.asarray(estimate, dtype=np.float64)[new], self.view[new],
            self.trajectory, in_metres,
        )  # fmt: skip


def measure_object_gains(
    truth: GroundTruth, evaluated: EvaluatedRuns, instances: int = INSTANCES
) -> ObjectGains:
    """Render the real views again with each visible changed object restored, for all runs at once.

    At most `instances` instances per run, evenly spread over those that are new to it, count for
    it; runs with other training sets have other instances. An object is visible where it covers at
    least `MIN_SHARE` of the real view of any run, in either scene. A restored object is as in
    simulation; the sensor noise, the other factors and the run's adjustments stay.
    """
    errors = CounterfactualErrors(truth, evaluated)
    chosen = {run: _spread_instances(truth, run, instances) for run in errors.runs}
    iids = truth.store.in_recording_order(np.unique(np.concatenate([*chosen.values()])))
    is_new = {run: np.isin(iids, rows) for run, rows in chosen.items()}
    cameras = {(run, side): truth.camera_moves(run)[side] for run in errors.runs for side in SIDES}
    real = {move for (_, side), move in cameras.items() if side == "real"}
    visible = _visible_objects(truth, iids, real)
    view, place = np.nonzero(visible)
    item = np.array(truth.changed, dtype=np.intp)[place]
    packed = {
        (side, move): _packed_masks(truth, side, move, iids, view, item)
        for side, move in {(side, move) for (_, side), move in cameras.items()}
    }
    poses, numbers = truth.poses[iids], truth.numbers[iids]
    before = errors.of_views(truth.data.renderer("real"), poses, numbers)
    gain = {run: np.zeros(view.size) for run in errors.runs}
    for number in np.unique(item):
        pairs = np.flatnonzero(item == number)
        rows = view[pairs]
        renderer = truth.data.world.renderer(errors.active, restored=(int(number),))
        for run, after in errors.of_views(renderer, poses[rows], numbers[rows]).items():
            gain[run][pairs] = before[run][rows] - after
    frame = truth.data.recipe.frame
    trajectory = truth.store.instances.trajectory[iids].astype(np.intp)
    masks = {(run, side): packed[side, move] for (run, side), move in cameras.items()}
    return ObjectGains(iids, trajectory, view, item, (frame, frame), before, gain, is_new, masks)


def _spread_instances(truth: GroundTruth, run: str, count: int) -> NDArray[np.intp]:
    """At most `count` instances that are new to a run, evenly spread in recording order."""
    new = truth.store.in_recording_order(run_metrics.population(truth.store, run))
    return np.asarray(new[evenly_spread(len(new), count)], dtype=np.intp)


def _visible_objects(
    truth: GroundTruth, iids: NDArray[np.intp], moves: set[RenderChange]
) -> NDArray[np.bool_]:
    """(V, changed objects) whether an object covers enough of a real view in either scene."""
    shares = np.zeros((len(iids), len(truth.changed)))
    for move in moves:
        for start in range(0, len(iids), BATCH):
            rows = slice(start, start + BATCH)
            sim, real = _identities(truth, "real", move, iids[rows])
            for place, number in enumerate(truth.changed):
                share = ((sim == number) | (real == number)).mean(axis=(1, 2))
                shares[rows, place] = np.maximum(shares[rows, place], share)
    return shares >= MIN_SHARE


def _identities(
    truth: GroundTruth, side: Side, move: RenderChange, iids: NDArray[np.intp]
) -> list[NDArray[np.int16]]:
    """Object ids (n, height, width) in the sim and in the real scene, seen by a side's camera."""
    camera, poses = move_camera(truth.data.camera(side), move), truth.poses[iids]
    return [truth.data.renderer(scene).render(poses, camera, samples=0).identity for scene in SIDES]


def _packed_masks(
    truth: GroundTruth, side: Side, move: RenderChange, iids: NDArray[np.intp],
    view: NDArray[np.intp], item: NDArray[np.intp],
) -> NDArray[np.uint8]:  # fmt: skip
    """The pixels of each pair's object in either scene, in a side's view, as packed bits (K, n)."""
    pixels = truth.data.recipe.frame**2
    parts = [np.zeros((0, -(-pixels // 8)), dtype=np.uint8)]
    for start in range(0, len(iids), BATCH):
        sim, real = _identities(truth, side, move, iids[start : start + BATCH])
        pairs = np.flatnonzero((view >= start) & (view < start + BATCH))
        row, number = view[pairs] - start, item[pairs][:, None, None]
        mask = (sim[row] == number) | (real[row] == number)
        parts.append(np.packbits(mask.reshape(len(pairs), pixels), axis=1))
    return np.concatenate(parts)


def _covered_shares(pixels: NDArray[np.bool_], size: tuple[int, ...]) -> NDArray[np.float64]:
    """(K, rows, columns) share of each map cell that some pixels (K, height, width) cover."""
    if pixels.shape[1:] == size:
        return pixels.astype(np.float64)
    rows, cols = (overlap_shares(extent, cells) for extent, cells in
                  zip(pixels.shape[1:], size, strict=True))  # fmt: skip
    return np.asarray(rows @ pixels.astype(np.float64) @ cols.T)
