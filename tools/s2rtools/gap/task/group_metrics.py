"""Mean errors, gap and relative drop of groups of instances, with block bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.bootstrap import Blocks, block_counts, corrected, percentile_bounds
from s2rtools.gap.axis_result import GapSettings

Floats = NDArray[np.float64]

_MIN_UNITS = 3
"""Fewest resampling units with instances of a group that give it an interval."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupErrors:
    """Errors (n,) of the same instances in recording order, in metres, and their blocks.

    `constant` is the error of the constant prediction of the mean position, on sim images.
    """

    sim: Floats
    real: Floats
    constant: Floats
    blocks: Blocks

    @property
    def gap(self) -> Floats:
        return self.real - self.sim


def group_metrics(
    errors: GroupErrors, codes: NDArray[np.integer], names: Sequence[str], settings: GapSettings
) -> dict[str, dict[str, Any]]:
    """Metrics by name of the group: n, mean errors, gap and relative drop with their intervals.

    `baseline` is the mean error of the constant prediction. `codes` (n,) index `names`; other codes
    belong to no group. Bounds are None where fewer than 3 resampling units have instances of the
    group; the relative drop, gap / sim error, is None where the sim error is 0.
    """
    blocks, known = errors.blocks, (codes >= 0) & (codes < len(names))
    label = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
    cell = (label * len(names) + codes)[known]

    def summed(values: Floats) -> Floats:
        flat = np.bincount(cell, values[known], minlength=blocks.count * len(names))
        return np.asarray(flat.reshape(blocks.count, len(names)), dtype=np.float64)

    per_block = summed(np.ones(codes.size))
    sim, real, constant = summed(errors.sim), summed(errors.real), summed(errors.constant)
    counts = block_counts(blocks, settings)
    n, units = per_block.sum(axis=0), _unit_counts(per_block, blocks.units)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = (real - sim).sum(axis=0) / n
        drop = (real - sim).sum(axis=0) / sim.sum(axis=0)
        gaps = corrected(counts @ (real - sim) / (counts @ per_block), gap, units, settings.level)
        drops = corrected(counts @ (real - sim) / (counts @ sim), drop, units, settings.level)
    metrics = {}
    for index in np.flatnonzero(n).tolist():
        metrics[names[index]] = {
            "n": int(n[index]),
            "sim": float(sim[:, index].sum() / n[index]),
            "real": float(real[:, index].sum() / n[index]),
            "baseline": float(constant[:, index].sum() / n[index]),
            "gap": _interval_json(gap[index], gaps[:, index], settings.level),
            "relative_drop": _interval_json(drop[index], drops[:, index], settings.level),
        }
    return metrics


def _unit_counts(per_block: Floats, units: NDArray[np.int64]) -> Floats:
    """Number of resampling units with rows of each group (groups,); below `_MIN_UNITS` 0."""
    per_unit = np.zeros((int(units.max()) + 1, per_block.shape[1]))
    np.add.at(per_unit, units, per_block)
    count = (per_unit > 0).sum(axis=0).astype(np.float64)
    return np.where(count < _MIN_UNITS, 0.0, count)


def no_gap_interval(errors: GroupErrors, settings: GapSettings) -> list[float]:
    """Bounds of the mean gap when sim and real of whole units are exchanged at random."""
    rng, units = np.random.default_rng(settings.seed), errors.blocks.units
    signs = rng.choice([-1.0, 1.0], (settings.replicates, errors.blocks.unit_count))[:, units]
    means = signs @ errors.blocks.sums(errors.gap) / errors.gap.size
    return list(percentile_bounds(means, settings.level))


def _interval_json(value: float, replicates: Floats, level: float) -> dict[str, float | None]:
    low, high = percentile_bounds(replicates[np.isfinite(replicates)], level)
    plain = [float(v) if np.isfinite(v) else None for v in (value, low, high)]
    return dict(zip(("value", "low", "high"), plain, strict=True))
