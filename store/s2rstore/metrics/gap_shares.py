"""Mean shares of the gap: how many metres of it each factor causes over some instances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rstore.records import GAP_FACTORS

MERGED_FACTORS = ("sensor", "camera")
"""Factors whose single shares are too uncertain to be told apart."""
SHARED_FACTORS: dict[str, tuple[str, ...]] = {
    **{factor: (factor,) for factor in GAP_FACTORS if factor not in MERGED_FACTORS},
    " and ".join(MERGED_FACTORS): MERGED_FACTORS,
}
"""The factors that are told, with the columns that each sums."""


@dataclass(frozen=True, slots=True)
class FactorShare:
    """Mean share of one factor in metres, with an interval that holds for all factors at once."""

    factor: str
    mean: Interval


@dataclass(frozen=True, slots=True)
class GapShares:
    """Mean gap in metres over `n` instances and the shares that sum to it, in a fixed order.

    `apart` of the chosen instances are left out, because the poses of their images differ by more
    than 2 cm or 0.5 degrees.
    """

    n: int
    gap: float
    shares: tuple[FactorShare, ...]
    apart: int = 0

    @property
    def largest(self) -> FactorShare:
        return max(self.shares, key=lambda share: share.mean.value)


def has_shares(store: Store, run: str) -> bool:
    """Whether shares of the gap are computed for a run."""
    return any(record.kind == "gap_shares" for record in store.array_kinds(run))


def mean_shares(store: Store, run: str, chosen: NDArray[np.bool_]) -> GapShares | None:
    """Mean shares over the chosen instances (N,) of a run; None where none of them has any.

    Loose pairs, whose images have different poses, are left out.
    """
    if not has_shares(store, run):
        return None
    columns = store.run_columns(run)
    values = np.stack([getattr(columns.real, f"share_{factor}") for factor in GAP_FACTORS])
    comparable = store.comparable_pairs
    rows = store.in_recording_order(chosen & comparable & np.isfinite(values).all(axis=0))
    if not rows.size:
        return None
    trajectory = store.instances.trajectory[rows]
    level = intervals.simultaneous_level(len(SHARED_FACTORS))
    shares = tuple(
        FactorShare(
            name,
            intervals.paired_difference(
                values[[GAP_FACTORS.index(part) for part in parts]][:, rows].sum(axis=0),
                trajectory,
                level=level,
            ),
        )
        for name, parts in SHARED_FACTORS.items()
    )
    apart = int(np.count_nonzero(chosen & ~comparable))
    return GapShares(int(rows.size), float(values[:, rows].sum(axis=0).mean()), shares, apart)
