"""Score how well each heatmap of a run finds the labelled changes, in images and on the floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from s2rstore import intervals
from s2rstore.intervals import LEVEL, MIN_DIFFERENCE, Interval, simultaneous_level
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.heatmaps import HEATMAP_KINDS
from s2rtools.scoring.ground_truth import (
    NO_CAMERA_MOVES,
    POSITIVE_SHARE,
    REBIN,
    CameraMoves,
    GroundTruth,
    to_cells,
)
from s2rtools.scoring.statistics import TOP_SHARE, RankedCells

Place = Literal["image", "floor"]

SMOOTH = 0.6
TILE = 12
"""Cells along each side of a floor tile, which counts as independent; larger than an object."""
MIN_SAMPLES = 3
_ROWS = 64


@dataclass(frozen=True, slots=True)
class HeatScore:
    """Score of one heatmap in one place, over `n` frames with positives or `n` floor cells.

    `without` counts the frames without positives. `base_rate` is the share of positive cells, the
    precision of a random map. Intervals are over frames, or over tiles of the floor; that of
    `tested`, which is `auroc` again, holds for all heatmaps of a run at once.
    """

    run: str
    kind: str
    mode: str | None
    side: str
    """sim, real, or both (floor maps added)."""
    place: Place
    auroc: Interval
    tested: Interval
    precision: Interval
    base_rate: float
    n: int
    without: int


def score_heatmaps(truth: GroundTruth, runs: list[str], seed: int) -> list[HeatScore]:
    """Scores of every heatmap kind of computed runs, and of a random map for comparison."""
    scores = [_random_image(truth, seed), _random_floor(truth, seed)]
    for run in runs:
        kinds = _scored_kinds(truth.store, run)
        level = simultaneous_level(len(kinds))
        for kind, mode in kinds:
            scores += _image_scores(truth, run, kind, mode, seed, level)
            scores += _floor_scores(truth, run, kind, mode, seed, level)
    return scores


def _scored_kinds(store: Store, run: str) -> list[tuple[str, str | None]]:
    """Kinds and modes to score; of kinds with several planes, the plane of the loss."""
    chosen: dict[tuple[str, str | None], None] = {}
    for record in store.array_kinds(run):
        if record.kind in HEATMAP_KINDS:
            mode = "loss" if HEATMAP_KINDS[record.kind].planes else record.mode
            chosen[record.kind, mode] = None
    return list(chosen)


def _image_scores(
    truth: GroundTruth, run: str, kind: str, mode: str | None, seed: int, level: float
) -> Iterator[HeatScore]:
    for side in SIDES:
        blocks = (
            truth.store.heatmaps(run, kind, side, start, start + _ROWS, mode)
            for start in range(0, len(truth.poses), _ROWS)
        )
        cells = np.concatenate([to_cells(block) for block in blocks])
        positive = truth.visible_objects(side, truth.camera_moves(run)[side]).cells
        scores = _per_frame(truth, cells, positive, seed, level)
        yield HeatScore(run, kind, mode, side, "image", *scores)


def _random_image(truth: GroundTruth, seed: int) -> HeatScore:
    positive = truth.visible_objects("real").cells
    cells = np.random.default_rng([seed, 1]).random(positive.shape)
    scores = _per_frame(truth, cells, positive, seed)
    return HeatScore("-", "random", None, "real", "image", *scores)


def _per_frame(
    truth: GroundTruth, cells: NDArray[Any], positive: NDArray[np.bool_], seed: int,
    level: float = LEVEL,
) -> tuple[Interval, Interval, Interval, float, int, int]:  # fmt: skip
    """Mean AUROC, also at `level`, and precision of frames with positives, and counts.

    These are the base rate and the frames with and without positives.
    """
    share = positive.mean(axis=(1, 2))
    scored = truth.store.in_recording_order((share > 0) & (share < 1))
    ranked = [
        RankedCells.of(cells[row], positive[row], np.random.default_rng([seed, int(row)]))
        for row in scored
    ]
    trajectory = truth.store.instances.trajectory[scored]
    areas = np.array([frame.auroc() for frame in ranked])
    auroc, tested = (_mean(areas, trajectory, each) for each in (LEVEL, level))
    precision = _mean(np.array([frame.precision(TOP_SHARE) for frame in ranked]), trajectory)
    base = float(share[scored].mean()) if scored.size else float("nan")
    return auroc, tested, precision, base, len(ranked), int((share == 0).sum())


def _floor_scores(
    truth: GroundTruth, run: str, kind: str, mode: str | None, seed: int, level: float
) -> Iterator[HeatScore]:
    """Scores of the floor maps of either side and of their sum."""
    planes: dict[Side | Literal["both"], NDArray[np.float64]] = {}
    for side in SIDES:
        total = np.nan_to_num(truth.store.map_grid(run, kind, side, mode, "sum"))
        count = truth.store.map_grid(run, kind, side, mode, "count")
        planes[side] = np.stack([_rebinned(total), _rebinned(count)])
    planes["both"] = planes["sim"] + planes["real"]
    for name, (total, count) in planes.items():
        heat = _smoothed(total, count)
        moves = truth.camera_moves(run)
        yield _floor_score(truth, run, kind, mode, name, heat, seed, moves, level)


def _random_floor(truth: GroundTruth, seed: int) -> HeatScore:
    shape = floor_truth(truth, "both")[0].shape
    heat = np.random.default_rng([seed, 2]).random(shape)
    return _floor_score(truth, "-", "random", None, "both", heat, seed)


def _floor_score(
    truth: GroundTruth, run: str, kind: str, mode: str | None, side: Side | Literal["both"],
    heat: NDArray[Any], seed: int, moves: CameraMoves = NO_CAMERA_MOVES, level: float = LEVEL,
) -> HeatScore:  # fmt: skip
    positive, observed = floor_truth(truth, side, moves)
    rows, cols = np.indices(observed.shape) // TILE
    tile = (rows * (observed.shape[1] // TILE + 1) + cols)[observed]
    ranked = RankedCells.of(heat[observed], positive[observed], np.random.default_rng([seed, 3]))
    _, tile = np.unique(tile, return_inverse=True)
    count = int(tile.max()) + 1 if tile.size else 0
    values = ranked.auroc(), ranked.precision(TOP_SHARE)

    def statistics(weights: NDArray[np.float64]) -> tuple[float, float]:
        return ranked.auroc(weights[tile]), ranked.precision(TOP_SHARE, weights[tile])

    without = intervals.without_each(statistics, count).reshape(count, len(values))

    def interval(figure: int, level: float) -> Interval:
        found = intervals.of_units(
            values[figure], without[:, figure], unit="floor tiles", level=level
        )
        return found.clipped(0.0, 1.0)

    auroc, tested, precision = interval(0, LEVEL), interval(0, level), interval(1, LEVEL)
    base = float(positive[observed].mean()) if observed.any() else float("nan")
    n = int(observed.sum())
    return HeatScore(run, kind, mode, side, "floor", auroc, tested, precision, base, n, 0)


def floor_truth(
    truth: GroundTruth, side: Side | Literal["both"], moves: CameraMoves = NO_CAMERA_MOVES
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Positive floor cells, and cells that a side (or either side) observed, (rows, columns).

    A cell is positive if a quarter of either side's samples show a labelled object.
    """
    shape = truth.visible_objects("sim", moves["sim"]).samples.shape
    positive, observed = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    for name in SIDES:
        objects = truth.visible_objects(name, moves[name])
        enough = objects.samples >= MIN_SAMPLES
        positive |= enough & (objects.hits >= POSITIVE_SHARE * objects.samples)
        if side in (name, "both"):
            observed |= enough
    return positive & observed, observed


def _rebinned(plane: NDArray[Any]) -> NDArray[np.float64]:
    rows, cols = plane.shape[0] // REBIN, plane.shape[1] // REBIN
    cut = plane[: rows * REBIN, : cols * REBIN].astype(np.float64)
    return np.asarray(cut.reshape(rows, REBIN, cols, REBIN).sum(axis=(1, 3)))


def _smoothed(total: NDArray[np.float64], count: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean heat per cell, smoothed by `SMOOTH` cells over the cells that have any heat."""
    known = count > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known, total / count, 0.0)
        soft = ndimage.gaussian_filter(mean, SMOOTH)
        soft /= ndimage.gaussian_filter(known.astype(np.float64), SMOOTH)
    return np.where(known, soft, np.nan)


def _mean(
    values: NDArray[np.float64], trajectory: NDArray[np.integer], level: float = LEVEL
) -> Interval:
    """Mean of shares."""
    mean = intervals.mean(values, trajectory, level=level, minimum=MIN_DIFFERENCE)
    return mean.clipped(0.0, 1.0)
