"""Expressions that select exactly the instances of a finding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.language import evaluation
from s2rstore.language.canonical_text import string
from s2rstore.reader import Store
from s2rstore.records import SIDES, SPLITS


def exact(
    store: Store, run: str, expression: str, members: NDArray[np.bool_], runs: Sequence[str] = ()
) -> str | None:
    """An expression that selects `members` (N,) in `run`; None where none is known.

    That is `expression` where it selects them, else `expression` without the instances that `run`
    or one of the other `runs` was trained on or has not predicted.
    """
    if _selects(store, run, expression, members):
        return expression
    excluded = []
    for name in dict.fromkeys((run, *runs)):
        prefix = "" if name == run else f"run({string(name)})."
        columns = store.run_columns(name)
        for side in SIDES:
            codes = columns.side(side).split
            excluded += [
                f"{prefix}{side}.split:{split}"
                for split in ("train", "validation")
                if (codes == SPLITS.index(split)).any()
            ]
        if prefix and not columns.valid.all():
            excluded.append(f"!({prefix}sim.error >= 0 & {prefix}real.error >= 0)")
    narrower = f"({expression}) - ({' | '.join(excluded)})"
    return narrower if excluded and _selects(store, run, narrower, members) else None


def _selects(store: Store, run: str, expression: str, members: NDArray[np.bool_]) -> bool:
    return np.array_equal(evaluation.select(store, expression, run), members)
