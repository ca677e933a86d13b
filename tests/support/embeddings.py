"""Add synthetic embeddings to a store."""

from pathlib import Path

import numpy as np

from s2rstore.arrays import array_writer
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit


def add(
    path: Path,
    run: str,
    points: dict[str, np.ndarray],
    kind: str = "pca",
    axes: tuple[str, ...] = ("component",),
    shard_rows: int = 0,
) -> None:
    """Publish `points` (N, ...) per side as the run's array of the given kind.

    It has shards of `shard_rows`, by default one.
    """
    ledger = Ledger(path)
    with edit(path) as draft:
        for side, points_of_side in points.items():
            relative, rows = f"{run}/made/{kind}.{side}", points_of_side.astype(np.float32)
            folder, per_shard = path / layout.RUNS / relative, shard_rows or len(rows)
            plan = array_writer.plan_layout(len(rows), rows.shape[1:], "float32", per_shard)
            array = array_writer.create(folder, plan)
            for number, start in enumerate(range(0, len(rows), per_shard)):
                block = rows[start : start + per_shard]
                file = array_writer.write_shard(folder, number, block)
                ledger.add(f"{relative}:{number}", [(file.path, len(block))])
            draft.insert_row(
                "zarr_array",
                {"run": run, "kind": kind, "side": side, "mode": None, "path": relative,
                 "dtype": "float32", "shape": list(rows.shape), "axes": ["iid", *axes],
                 "scale": 1.0, "zero": 0.0, "unit": "",
                 "metadata_sha256": array.metadata_sha256},
            )  # fmt: skip
