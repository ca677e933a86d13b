"""Paired figures of groups of instances, with block-bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import bootstrap
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.blocks import Blocks, draws
from s2rtools.gap.bootstrap_correction import widened

Floats = NDArray[np.float64]

_LEAST_UNITS = 3


@dataclass(frozen=True, slots=True, eq=False)
class GroupErrors:
    """Errors of the same instances in recording order, metres, (n,) each, and their blocks.

    `constant` is the error of predicting the mean position.
    """

    sim: Floats
    real: Floats
    constant: Floats
    blocks: Blocks

    @property
    def gap(self) -> Floats:
        return self.real - self.sim


def mean_replicates(values: Floats, blocks: Blocks, settings: GapSettings) -> Floats:
    """Bootstrap replicates (R,) of the mean of `values` (n,)."""
    counts = draws(blocks, settings.replicates, settings.seed)
    means = counts @ blocks.sums(values) / (counts @ blocks.sizes)
    return widened(means, float(values.mean()), blocks.drawn, settings.level)


def grouped(
    errors: GroupErrors, codes: NDArray[np.integer], names: Sequence[str], settings: GapSettings
) -> dict[str, dict[str, Any]]:
    """For each name with instances: n, mean errors, gap and relative drop with their intervals.

    `baseline` is the mean error of the constant prediction. `codes` (n,) index `names`, others
    count for none. Bounds are None where fewer than 3 units of the bootstrap have such instances;
    the relative drop, gap / sim error, is None where the sim error is 0.
    """
    blocks, known = errors.blocks, (codes >= 0) & (codes < len(names))
    label = np.repeat(np.arange(blocks.count), np.diff(blocks.start))
    cell = (label * len(names) + codes)[known]

    def summed(values: Floats) -> Floats:
        flat = np.bincount(cell, values[known], minlength=blocks.count * len(names))
        return np.asarray(flat.reshape(blocks.count, len(names)), dtype=np.float64)

    per_block = summed(np.ones(codes.size))
    sim, real, constant = summed(errors.sim), summed(errors.real), summed(errors.constant)
    counts = draws(blocks, settings.replicates, settings.seed)
    n, touched = per_block.sum(axis=0), _touched(per_block, blocks.units)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = (real - sim).sum(axis=0) / n
        drop = (real - sim).sum(axis=0) / sim.sum(axis=0)
        gaps = widened(counts @ (real - sim) / (counts @ per_block), gap, touched, settings.level)
        drops = widened(counts @ (real - sim) / (counts @ sim), drop, touched, settings.level)
    found = {}
    for index in np.flatnonzero(n).tolist():
        found[names[index]] = {
            "n": int(n[index]),
            "sim": float(sim[:, index].sum() / n[index]),
            "real": float(real[:, index].sum() / n[index]),
            "baseline": float(constant[:, index].sum() / n[index]),
            "gap": _bounded(gap[index], gaps[:, index], settings.level),
            "relative_drop": _bounded(drop[index], drops[:, index], settings.level),
        }
    return found


def _touched(per_block: Floats, units: NDArray[np.int64]) -> Floats:
    """In how many units (B,) of the bootstrap each column of (B, groups) is; too few count as 0."""
    per_unit = np.zeros((int(units.max()) + 1, per_block.shape[1]))
    np.add.at(per_unit, units, per_block)
    found = (per_unit > 0).sum(axis=0).astype(np.float64)
    return np.where(found < _LEAST_UNITS, 0.0, found)


def swap_interval(errors: GroupErrors, settings: GapSettings) -> list[float]:
    """Bounds of the mean gap if sim and real of whole units change places at random: of no gap."""
    rng, units = np.random.default_rng(settings.seed), errors.blocks.units
    signs = rng.choice([-1.0, 1.0], (settings.replicates, errors.blocks.drawn))[:, units]
    means = signs @ errors.blocks.sums(errors.gap) / errors.gap.size
    return list(bootstrap.percentile_bounds(means, settings.level))


def _bounded(value: float, replicates: Floats, level: float) -> dict[str, float | None]:
    low, high = bootstrap.percentile_bounds(replicates[np.isfinite(replicates)], level)
    plain = [float(v) if np.isfinite(v) else None for v in (value, low, high)]
    return dict(zip(("value", "low", "high"), plain, strict=True))
