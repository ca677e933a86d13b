"""Columns in memory to evaluate expressions on, without a store."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from s2rstore.language import MaskContext, Vocabulary


class _Instances(SimpleNamespace):
    """Ground truth columns; `len` is the number of instances."""

    def __len__(self) -> int:
        return int(self.n)


def mask_context(n: int, valid: np.ndarray | None = None, **columns: np.ndarray) -> MaskContext:
    """One run, "vanilla", of n instances; columns by field name with `_` for the dot.

    `sim_error` is the field `sim.error`; fields without a side, as `x`, belong to the truth.
    """
    sides: dict[str, dict[str, Any]] = {"sim": {}, "real": {}}
    truth: dict[str, Any] = {"n": n, "room_names": (), "trajectory_names": ()}
    for name, values in columns.items():
        side, _, field = name.partition("_")
        sides.get(side, truth)[field or name] = np.asarray(values)
    held = np.ones(n, dtype=np.bool_) if valid is None else valid
    run = SimpleNamespace(valid=held, trained=np.zeros(n, dtype=np.bool_))
    run.sim, run.real = (SimpleNamespace(**sides[side]) for side in ("sim", "real"))
    if "sim_error" in columns and "real_error" in columns:
        run.gap = np.asarray(columns["real_error"]) - np.asarray(columns["sim_error"])
    words = Vocabulary(("vanilla",), (), ())
    return MaskContext(cast(Any, _Instances(**truth)), "vanilla", lambda _: cast(Any, run), words)
