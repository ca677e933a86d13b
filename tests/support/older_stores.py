"""Stores as earlier releases wrote them."""

from __future__ import annotations

from pathlib import Path

from s2rstore.index import pair_view, schema
from s2rstore.index.transaction import edit


def without(path: Path, prediction: tuple[str, ...]) -> Path:
    """The store as an earlier release wrote it, without pair offsets and some other columns."""
    view = pair_view.view_statement(with_units=False)
    for side, alias in (("sim", "s"), ("real", "r")):
        for name in prediction:
            view = view.replace(f"{alias}.{name} AS {side}_{name}, ", "")
    for name in schema.PAIR_OFFSETS:
        view = view.replace(f"coalesce(i.{name}, 0) AS {name}, ", "")
    assert not any(name in view for name in (*prediction, *schema.PAIR_OFFSETS))
    columns = [("prediction", name) for name in prediction]
    columns += [("instance", name) for name in schema.PAIR_OFFSETS]
    with edit(path) as draft:
        draft._connection.execute("DROP VIEW pair")
        for table, name in (*columns, ("domain", "has_depth")):
            draft._connection.execute(f"ALTER TABLE {table} DROP COLUMN {name}")
        draft._connection.execute("DROP TABLE frame_pose")
        draft._connection.execute(view)
    return path
