"""What colours the instances on the map: a column of the run, by its name in the language."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language import fields
from s2rstore.metrics.gap_shares import has_shares
from s2rstore.reader import Store
from s2rstore.records import GAP_FACTORS, NO_RUN

SHIFT = "shift"


@dataclass(frozen=True, slots=True)
class MapValue:
    """A column in metres; `phrase` says what it is in titles, `short` where there is less room."""

    name: str
    phrase: str
    short: str = ""


MAP_VALUES: dict[str, MapValue] = {
    value.name: value
    for value in (
        MapValue(
            SHIFT,
            "distance between the sim and the real prediction",
            "shift (sim to real prediction)",
        ),
        MapValue("real.error", "real error"),
        MapValue("sim.error", "sim error"),
        MapValue("gap", "gap (real error - sim error)"),
        *(MapValue(f"share.{factor}", f"share of {factor} in the gap") for factor in GAP_FACTORS),
    )
}
"""What the map can show, in the order of the key."""


def available(store: Store, run: str) -> tuple[str, ...]:
    """The names of the values that a run has."""
    if run == NO_RUN:
        return (SHIFT,)
    shared = has_shares(store, run)
    return tuple(name for name in MAP_VALUES if shared or not name.startswith("share."))


def shown(store: Store, run: str, name: str) -> MapValue:
    """The value of a name; the shift where the run does not have it."""
    if name.startswith("share.") and name not in available(store, run):
        name = SHIFT
    return MAP_VALUES[SHIFT if run == NO_RUN else name]


def require_available(store: Store, run: str, name: str) -> None:
    """Raise RequestError where a run does not have a value."""
    if name not in available(store, run):
        raise RequestError(
            f"--value {name}: run {run} has no shares of the gap; "
            "`s2r precompute --kinds harm` computes them"
        )


def column(store: Store, run: str, name: str) -> NDArray[np.float64]:
    """The values (N,) of a run in metres; NaN where unknown."""
    return fields.column(fields.NUMERIC[name].path, store.instances, store.run_columns(run))
