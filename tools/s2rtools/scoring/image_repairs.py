"""Score heatmaps on any data: how much the error falls where an image is repaired by their order.

The cells of a real image are replaced by those of its counterfactual, which shows the content of
the sim image in the real view and light, in the order of a heatmap. A heatmap that finds what harms
the prediction lowers the error by fewer cells than a random order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.heatmap_kinds import heatmap_facts
from s2rstore.intervals import Interval, paired_difference
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.common.blocks import evenly_spread
from s2rtools.counterfactual.attribution import pose_errors
from s2rtools.counterfactual.counterfactual_inputs import CounterfactualInputs
from s2rtools.heatmaps import HEATMAP_KINDS, PairBatch
from s2rtools.inference import Backend, open_backend
from s2rtools.models.load_model import load_model
from s2rtools.precompute.domain_calibration import load_alignment
from s2rtools.precompute.frame_reader import RunFrames, read_pairs
from s2rtools.precompute.tasks.network_outputs import side_batch
from s2rtools.scoring.ground_truth import to_cells
from s2rtools.scoring.harm_report import heatmaps_of, scored_modes

CELLS = 8
"""Cells along each side of an image."""
SHARES = (0.05, 0.1, 0.2, 0.4)
"""Shares of the cells that are replaced."""
RANDOM_ORDERS = 4
RANDOM = "random"
Mode = tuple[str, str | None]


@dataclass(frozen=True, slots=True)
class ImageRepair:
    """Mean decrease of the real error in metres with a `share` of the cells replaced.

    `over_random` is the mean of the paired differences to the decrease by a random order. Over `n`
    instances that are new to the run; `whole` is the decrease with all cells replaced.
    """

    run: str
    kind: str
    mode: str | None
    share: float
    gain: Interval
    over_random: Interval
    whole: float
    n: int


def score_image_repairs(
    store: Store,
    runs: Sequence[str],
    instances: int,
    seed: int = 1,
    trust: bool = False,
    advance: Callable[[int], object] = lambda steps: None,
) -> list[ImageRepair]:
    """Repair at most `instances` real images per run by every heatmap of the real side.

    `advance` is called after each run. Raises RequestError for fewer than 2 or more than 100000
    instances, and where the rigs are not calibrated.
    """
    if not 2 <= instances <= 100_000:
        raise RequestError(f"--views {instances}: 2 .. 100000")
    rows: list[ImageRepair] = []
    for run in runs:
        iids = _new_instances(store, run, instances)
        if iids.size:
            rows += _of_run(store, run, iids, seed, trust)
        advance(1)
    if not rows:
        raise RequestError(f"{store.path}: no instance is new to {', '.join(runs)}")
    return rows


def _new_instances(store: Store, run: str, count: int) -> NDArray[np.intp]:
    """At most `count` instances that are new to a run, evenly spread, in recording order."""
    rows = store.in_recording_order(run_metrics.population(store, run))
    return np.asarray(rows[evenly_spread(rows.size, count)], dtype=np.intp)


def _of_run(
    store: Store, run: str, iids: NDArray[np.intp], seed: int, trust: bool
) -> list[ImageRepair]:
    record = store.run(run)
    backend = open_backend(load_model(store, record.network("scoring"), trust), "torch")
    modes = [m for m in scored_modes(store, [run]) if HEATMAP_KINDS[m[0]].compares_images]
    orders = {mode: _cell_order(store, run, mode, iids) for mode in modes}
    rng = np.random.default_rng(seed)
    drawn = np.stack([
        [rng.permutation(CELLS * CELLS) for _ in range(RANDOM_ORDERS)] for _ in iids
    ])  # fmt: skip
    gains: dict[Mode, list[NDArray[np.float64]]] = {mode: [] for mode in (*modes, (RANDOM, None))}
    whole = []
    for place, inputs, truth in _inputs(store, run, backend, iids):
        before = _errors(backend, inputs.real[None], truth)[0]
        whole.append(before - _errors(backend, inputs.counterfactual[None], truth)[0])
        for mode in modes:
            gains[mode].append(before - _repaired(backend, inputs, truth, orders[mode][place]))
        at_random = [_repaired(backend, inputs, truth, order) for order in drawn[place]]
        gains[RANDOM, None].append(before - np.mean(at_random, axis=0))
    trajectory = store.instances.trajectory[iids]
    chance = np.stack(gains[RANDOM, None])
    rows = []
    for (kind, variant), values in gains.items():
        of_mode = np.stack(values)
        for column, share in enumerate(SHARES):
            gain = paired_difference(of_mode[:, column], trajectory)
            over = paired_difference((of_mode - chance)[:, column], trajectory)
            mean = float(np.mean(whole))
            rows.append(ImageRepair(run, kind, variant, share, gain, over, mean, iids.size))
    return rows


def _inputs(
    store: Store, run: str, backend: Backend, iids: NDArray[np.intp]
) -> Iterator[tuple[int, CounterfactualInputs, NDArray[np.float64]]]:
    """Number, counterfactual inputs and true pose (3,) of each instance."""
    record = store.run(run)
    alignment = load_alignment(store, record)
    frames, contract = RunFrames(store, record), backend.model.contract
    poses = {side: store.poses(record.domain(side)) for side in SIDES}
    for place, iid in enumerate(iids.tolist()):
        for _, sides in read_pairs(store, record, contract, iid, iid + 1, 1, frames):
            sim, real = (
                side_batch(backend, sides[side], poses[side][iid : iid + 1], None, False)
                for side in SIDES
            )
            pair = PairBatch(backend.model, backend, sim, real, alignment)
            yield place, pair.counterfactuals[0], poses["real"][iid]


def _cell_order(store: Store, run: str, mode: Mode, iids: NDArray[np.intp]) -> NDArray[np.intp]:
    """Cells (n, CELLS^2) of each image, from the most to the least heat."""
    heat = heatmaps_of(store, run, mode[0], "real", mode[1], iids)
    cells = to_cells(heat)
    side = cells.shape[1] // CELLS
    blocks = cells.reshape(len(cells), CELLS, side, CELLS, side)
    means = np.where(np.isfinite(blocks), blocks, 0).mean(axis=(2, 4)).reshape(len(cells), -1)
    if not heatmap_facts(mode[0]).is_signed:
        means = np.abs(means)
    return np.asarray(np.argsort(-means, axis=1, kind="stable"), dtype=np.intp)


def _repaired(
    backend: Backend,
    inputs: CounterfactualInputs,
    truth: NDArray[np.float64],
    order: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Errors (shares,) with the first cells of the order replaced."""
    height, width = inputs.real.shape[1:]
    rows, cols = (np.arange(extent) * CELLS // extent for extent in (height, width))
    cell = rows[:, None] * CELLS + cols[None]
    rank = np.empty(order.size, dtype=np.intp)
    rank[order] = np.arange(order.size)
    images = [
        np.where(rank[cell] < round(share * order.size), inputs.counterfactual, inputs.real)
        for share in SHARES
    ]
    return _errors(backend, np.stack(images), truth)


def _errors(
    backend: Backend, x: NDArray[np.float32], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    return pose_errors(backend.poses(x), truth)[:, 0]
