"""Gains of labelled objects: how much of heatmap `harm` lies on the pixels of each object.

The harm of an image sums to the metres of position error that the changed content of the real image
costs. Its sum over the pixels that show an object estimates by how much the error would fall if
that object looked as in simulation. An object's pixels are those of the real label image and, where
the sim domain has label images, those at which the real camera would see it in simulation: an
object that is missing in reality harms as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.dataset_reader import UNLABELLED
from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, ArrayRecord, Run
from s2rstore.run_inputs import run_render_change
from s2rtools.common.frame_resizing import overlap_shares, resized_depth
from s2rtools.counterfactual.pair_counterfactuals import working_size
from s2rtools.heatmaps.harm import Harm
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.domain_calibration import load_alignment

SOURCE = "label gains"
"""Key of a run's provenance: what its rows in table `label_gain` were computed from."""
_VERSION = 1
_BLOCK = 64
"""Instances that are read at once."""

Columns = dict[str, NDArray[np.int32] | NDArray[np.float64]]


def update_label_gains(root: Path, check: Callable[[], None] = lambda: None) -> list[str]:
    """Publish the gains of the runs whose harm or labels have changed; the names of these runs.

    `check` is called before anything is published, see `edit`.
    """
    made: dict[str, tuple[str, Columns | None]] = {}
    with s2rstore.open(root) as store:
        for run in store.runs.values() if store.has_poses else ():
            parts = _harm_parts(store, run)
            source = _source(store, run, parts)
            if source != store.provenance(f"run:{run.run}").get(SOURCE, ""):
                made[run.run] = source, _columns(store, run, parts) if source else None
    if made:
        with edit(root, check) as draft:
            for name, (source, columns) in made.items():
                draft.delete("label_gain", run=name)
                if columns is not None:
                    draft.insert("label_gain", {"run": [name] * columns["iid"].size, **columns})
                draft.set_provenance(f"run:{name}", {SOURCE: source})
    return list(made)


def image_gains(
    harm: NDArray[np.floating], real: NDArray[np.integer], sim: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Gain of each label 0 .. L in one image, metres, (L + 1,); NaN for labels that it lacks.

    `harm` (rows, cols) sums to metres; `real` and `sim` (h, w) are the labels of both scenes in the
    real view. A pixel counts for both of its labels, once where they are equal.
    """
    rows, cols = (
        overlap_shares(extent, cells) for extent, cells in zip(real.shape, harm.shape, strict=True)
    )
    heat = rows.T @ np.nan_to_num(harm.astype(np.float64)) @ cols
    differs = real != sim
    labels = np.concatenate([real.ravel(), sim[differs]]).astype(np.intp)
    sums = np.bincount(labels, np.concatenate([heat.ravel(), heat[differs]]))
    gains = sums.astype(np.float64)
    gains[np.bincount(labels) == 0] = np.nan
    gains[UNLABELLED] = np.nan
    return gains


def _harm_parts(store: Store, run: Run) -> list[ArrayRecord]:
    """The arrays of the real side's harm, one for each part of the data set."""
    records = store.array_parts(run.run)
    return [each for each in records if (each.kind, each.side) == (Harm.name, "real")]


def _source(store: Store, run: Run, parts: list[ArrayRecord]) -> str:
    """What the gains of a run are computed from; empty where it has no harm or no label images.

    Label images show what the cameras of the domains see, so there are no gains for a run that
    moves a camera.
    """
    keys = {side: store.label_keys.get(run.domain(side), "") for side in SIDES}
    moved = any(run_render_change(store, run, side) != UNCHANGED for side in SIDES)
    if not parts or moved or not any(keys.values()):
        return ""
    return content_key({"labels": keys, "harm": [p.path for p in parts], "version": _VERSION})


def _columns(store: Store, run: Run, parts: list[ArrayRecord]) -> Columns:
    """Columns iid, label and gain of the labels that the comparable pairs of a run show."""
    iids, labels, gains = [], [], []
    for iid, found in _gains(store, run, parts):
        shown = np.flatnonzero(np.isfinite(found))
        iids.append(np.full(shown.size, iid))
        labels.append(shown)
        gains.append(found[shown])
    none = [np.zeros(0)]
    return {
        "iid": np.concatenate(iids or none).astype(np.int32),
        "label": np.concatenate(labels or none).astype(np.int32),
        "gain": np.concatenate(gains or none),
    }


def _gains(
    store: Store, run: Run, parts: list[ArrayRecord]
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """The comparable pairs of a run with label images, and the gain of each label."""
    size = working_size((store.dataset.frame_height, store.dataset.frame_width))
    sim_domain, real_domain = (store.domain(run.domain(side)) for side in SIDES)
    alignment = load_alignment(store, run) if sim_domain.domain in store.label_keys else None
    for part in parts:
        stop = part.first_iid + part.shape[0]
        for start in range(part.first_iid, stop, _BLOCK):
            end = min(start + _BLOCK, stop)
            harm = store.heatmaps(run.run, Harm.name, "real", start, end, "position")
            real = store.label_images(real_domain.domain, start, end)
            sim = store.label_images(sim_domain.domain, start, end)
            depth = store.frames(sim_domain.domain, start, end, ("depth",))["depth"]
            valid = (depth >= sim_domain.depth_raw_min) & (depth <= sim_domain.depth_raw_max)
            for row in np.flatnonzero(store.comparable_pairs[start:end]):
                in_real = resized_depth(real[row], size)
                from_sim = np.zeros_like(in_real)
                if alignment is not None:
                    from_sim = alignment.counterfactuals.labels_in_real_view(
                        sim[row], depth[row], valid[row]
                    )
                if in_real.any() or from_sim.any():
                    yield start + int(row), image_gains(harm[row], in_real, from_sim)
