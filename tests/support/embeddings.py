"""Add synthetic embeddings to a store."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from s2rstore.arrays import array_writer
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit


def add(path: Path, run: str, points: dict[str, np.ndarray], kind: str = "pca") -> None:
    """Publish `points` (N, D) per side as the run's array of the given kind."""
    ledger = Ledger(path)
    with edit(path) as draft:
        for side, rows in points.items():
            relative = f"{run}/made/{kind}.{side}"
            plan = array_writer.plan_layout(len(rows), rows.shape[1:], "float32", len(rows))
            array_writer.create(path / layout.RUNS / relative, plan)
            file = array_writer.write_shard(
                path / layout.RUNS / relative, 0, rows.astype(np.float32)
            )
            ledger.add(f"{relative}:0", [(file.path, len(rows))])
            draft.insert_row(
                "zarr_array",
                {"run": run, "kind": kind, "side": side, "mode": None, "path": relative,
                 "dtype": "float32", "shape": list(rows.shape), "axes": ["iid", "component"],
                 "scale": 1.0, "zero": 0.0, "unit": ""},
            )  # fmt: skip
