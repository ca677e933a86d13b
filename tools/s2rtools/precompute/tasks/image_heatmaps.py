"""Task: heatmaps that need images alone, for runs whose predictions were imported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.dataset_reader import Frame
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.heatmaps import IMAGE_KINDS
from s2rtools.heatmaps.heatmap_method import ImageBatch, SideImages
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.domain_calibration import load_alignment
from s2rtools.precompute.tasks.network_outputs import FORWARD_ROWS, as_stored, heatmap_specs
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

STAGE = "images"
"""Name of the stages of these heatmaps."""
_READ_ROWS = 32


def image_stages(
    keys: ArrayKeys, run: Run, iids: range, kinds: Sequence[str], has_depth: bool = True
) -> list[Stage]:
    """The stage of the requested heatmap kinds of some instances; none where none is requested.

    `has_depth` tells whether both domains have depth.
    The arrays equal those that the forward stage of other runs computes, so that all runs of the
    same images share them.
    """
    specs = [
        spec
        for kind in kinds
        for spec in heatmap_specs(
            iids, kind, IMAGE_KINDS[kind].outputs(None), {}, *keys.heatmap(kind, {}, ()), has_depth
        )
    ]
    if not specs:
        return []
    return [Stage(STAGE, run.run, tuple(specs), FORWARD_ROWS, compute=compute_heatmaps)]


def compute_heatmaps(computer: UnitComputer, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """The missing heatmaps of a unit's instances, of the frames as they are stored."""
    store, run = computer.store, computer.store.run(unit.stage.run)
    alignment = load_alignment(store, run)
    kinds = dict.fromkeys(spec.kind for spec in unit.missing)
    batches: dict[ArraySpec, list[NDArray[Any]]] = {spec: [] for spec in unit.missing}
    rows = unit.instances
    for start in range(rows.start, rows.stop, _READ_ROWS):
        stop = min(start + _READ_ROWS, rows.stop)
        sim, real = (_images(store, run.domain(side), start, stop) for side in SIDES)
        pair = ImageBatch(sim, real, alignment)
        heatmaps = {kind: IMAGE_KINDS[kind].compute(pair) for kind in kinds}
        for spec in unit.missing:
            values = heatmaps[spec.kind][spec.side, spec.mode]
            batches[spec].append(as_stored(values, spec.dtype))
    return {spec: np.concatenate(parts) for spec, parts in batches.items()}


def _images(store: Store, name: str, start: int, stop: int) -> SideImages:
    """The images of iids [start, stop) in a domain."""
    domain, images = store.domain(name), store.frames(name, start, stop)
    frame = Frame.of(images["rgb"], images["depth"], domain)
    return SideImages(frame.rgb, frame.depth, frame.valid, domain.depth_scale)
