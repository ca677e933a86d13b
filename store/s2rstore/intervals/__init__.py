"""Confidence intervals under dependence, the only ones of the project.

`intervals.mean(values, trajectories)` and its relatives return an `Interval`: an estimate with
bounds, or with the reason why it has none.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from s2rstore.intervals.interval import (
    FEWEST_TRAJECTORIES,
    LEVEL,
    LEVEL_TEXT,
    MIN_DIFFERENCE,
    MIN_MEAN,
    MIN_MEDIAN,
    MIN_SHARE,
    Bound,
    Interval,
    Sample,
    difference_of,
    simultaneous_level,
)

if TYPE_CHECKING:
    from s2rstore.intervals.estimates import (
        linear,
        mean,
        median,
        paired_difference,
        proportion,
        quantile,
        ranked_quantile,
        ratio_of_means,
        spearman,
        stratified_mean,
    )
    from s2rstore.intervals.jackknife import of_rows, of_units, without_each

__all__ = [
    "FEWEST_TRAJECTORIES",
    "LEVEL",
    "LEVEL_TEXT",
    "MIN_DIFFERENCE",
    "MIN_MEAN",
    "MIN_MEDIAN",
    "MIN_SHARE",
    "Bound",
    "Interval",
    "Sample",
    "difference_of",
    "linear",
    "mean",
    "median",
    "of_rows",
    "of_units",
    "paired_difference",
    "proportion",
    "quantile",
    "ranked_quantile",
    "ratio_of_means",
    "simultaneous_level",
    "spearman",
    "stratified_mean",
    "without_each",
]

_JACKKNIFE = ("of_rows", "of_units", "without_each")


def __getattr__(name: str) -> Any:
    """Import the estimates, which load SciPy, when the first one is used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "jackknife" if name in _JACKKNIFE else "estimates"
    return getattr(import_module(f"s2rstore.intervals.{module}"), name)
