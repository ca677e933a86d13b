"""What the harm kinds and the shares of the gap cost for a pair of images, and in a precompute."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import s2rstore
from bench.budget import BudgetRow
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.counterfactual.gap_shares import gap_shares
from s2rtools.heatmaps import PairBatch
from s2rtools.heatmaps.harm import Harm, HarmFine
from s2rtools.models.load_model import load_model
from s2rtools.precompute.domain_calibration import load_alignment
from s2rtools.precompute.frame_reader import read_pairs
from s2rtools.precompute.run_backends import RunBackends
from s2rtools.precompute.tasks.network_outputs import side_batch
from s2rtools.training import pretrained

SIZES = (200, 400)
"""Instances of the stores whose difference in time is that of the instances alone."""
RUN = "dataaug"
_PAIRS, _WARM_UP = 64, 16


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Processor time of one thread in this process; wall time of a precompute by two workers."""
    small, large = (_precomputed(folder / f"harm-{size}.s2r", size) for size in SIZES)
    with s2rstore.open(folder / f"harm-{SIZES[0]}.s2r") as store:
        harmonise, harm, composites, passes = _milliseconds(store, store.run(RUN))
    yield BudgetRow("counterfactual of a pair, 128 x 128", harmonise, "ms")
    yield BudgetRow("harm and harm_fine of a pair, after it", harm, "ms", 60)
    yield BudgetRow("shares of the gap of a pair", composites + passes, "ms", 60)
    yield BudgetRow("... of it composites", composites, "ms")
    yield BudgetRow(f"precompute of the harm kinds, {SIZES[0]} instances", small, "s")
    yield BudgetRow(f"precompute of the harm kinds, {SIZES[1]} instances", large, "s")
    each = 1000 * (large - small) / (SIZES[1] - SIZES[0])
    yield BudgetRow("... each further instance, two workers", each, "ms", 60)


def _precomputed(path: Path, instances: int) -> float:
    """Make a world of two trajectories; wall seconds of the precompute of its harm kinds."""
    from s2rtui.cli import main as s2r

    with contextlib.redirect_stdout(sys.stderr):
        s2r(["ingest", "world", "--instances", str(instances // 2), "--store", str(path)])
        pretrained.add_pretrained_models(path)
    options = ["--run", RUN, "--kinds", "harm,harm_fine", "--workers", "2", "--threads", "1"]
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "s2rtui", "precompute", str(path), *options],
        check=True, stdout=sys.stderr,
    )  # fmt: skip
    return time.perf_counter() - began


def _milliseconds(store: Store, run: Run) -> NDArray[np.float64]:
    """Of counterfactuals, both harm kinds, composites and their passes (4,), for each pair."""
    record = store.provenance_object(f"run:{run.run}", "backend") or {}
    model = load_model(store, run.network("the harm kinds"), False)
    predictor, backend = RunBackends.from_record(record, run.run).open(model, 1)
    alignment = load_alignment(store, run)
    truth = {side: store.poses(run.domain(side)) for side in SIDES}
    totals = np.zeros(4)
    stop = _WARM_UP + _PAIRS
    for iid, frames in read_pairs(store, run, model.contract, 0, stop, backend.batch):
        rows = slice(iid, iid + len(frames["sim"].x))
        sim, real = (
            side_batch(backend, frames[side], truth[side][rows], features=False) for side in SIDES
        )
        pair = PairBatch(model, backend, sim, real, alignment, predictor)
        clock = [time.process_time()]
        _ = pair.counterfactuals
        clock.append(time.process_time())
        for kind in (Harm(), HarmFine()):
            kind.compute(pair)
        clock.append(time.process_time())
        composites = list(pair.composites())
        clock.append(time.process_time())
        for inputs, pose in zip(composites, real.truth, strict=True):
            gap_shares(pair.pose_backend, inputs, pose)
        clock.append(time.process_time())
        if iid >= _WARM_UP:
            totals += np.diff(clock)
    return 1000 * totals / _PAIRS
