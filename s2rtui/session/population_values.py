"""Values of the instances that count in the population of a state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.index.columns import BoolColumn, RunColumns
from s2rstore.index.population import Population
from s2rstore.metrics import pose_metrics
from s2rstore.records import Side
from s2rtui.analysis.identity_cache import cached_by_identity


def population_values(
    population: Population, run: RunColumns, values: NDArray[Any]
) -> NDArray[np.float64]:
    """Values (N, ...) of a run, NaN for trained instances unless the population holds them.

    So these count in no scale. The same columns give the same array. Instances of trajectories that
    are not in view keep their values, so that scales do not change with the view.
    """
    return _without(values, run.trained) if population.leaves_out_trained(run) else values


def population_ranks(population: Population, run: RunColumns, side: Side) -> NDArray[np.int32]:
    """As `pose_metrics.population_ranks`; the same columns give the same array."""
    if not population.leaves_out_trained(run):
        return run.side(side).rank
    return _ranks(population, run, side)


@cached_by_identity(16)
def _without(values: NDArray[Any], trained: BoolColumn) -> NDArray[np.float64]:
    shown = np.array(values, dtype=np.float64)
    shown[trained] = np.nan
    return shown


@cached_by_identity(4)
def _ranks(population: Population, run: RunColumns, side: Side) -> NDArray[np.int32]:
    return pose_metrics.population_ranks(population, run, side)
