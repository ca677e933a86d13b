"""From index rows to dense columns aligned by iid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from s2rstore.columns import InstanceColumns, RunColumns, SideColumns
from s2rstore.geometry import rooms as room_geometry
from s2rstore.records import SPLITS, Room

Columns = dict[str, NDArray[Any]]


def instances(connection: duckdb.DuckDBPyConnection) -> InstanceColumns:
    """All instances in iid order."""
    found = connection.execute(
        """SELECT i.*, t.code FROM instance i LEFT JOIN
           (SELECT trajectory, row_number() OVER (ORDER BY trajectory) - 1 AS code FROM trajectory)
           t USING (trajectory) ORDER BY iid"""
    ).fetchnumpy()
    names = [
        row[0]
        for row in connection.execute(
            "SELECT trajectory FROM trajectory ORDER BY trajectory"
        ).fetchall()
    ]
    room_names = [
        row[0]
        for row in connection.execute(
            "SELECT room FROM room GROUP BY room ORDER BY min(position)"
        ).fetchall()
    ]
    return InstanceColumns(
        **{
            name: _floats(found[name])
            for name in (
                "x",
                "y",
                "heading",
                "curvature",
                "odom_x",
                "odom_y",
                "odom_heading",
                "timestamp",
            )
        },
        seq=_integers(found["seq"], -1),
        trajectory=_integers(found["code"], -1),
        trajectory_names=tuple(names),
        room=_codes(found["room"], room_names),
        room_names=tuple(room_names),
    )


def run_columns(
    connection: duckdb.DuckDBPyConnection,
    run: str,
    truth: InstanceColumns,
    rooms: Sequence[Room],
    lacking: frozenset[str] = frozenset(),
) -> RunColumns:
    """Both sides of one run; instances without a prediction are NaN and not valid.

    `lacking` are columns of table `prediction` that the index does not have.
    """
    outlier = "NULL::DOUBLE" if "outlier" in lacking else "p.outlier"
    sides = {}
    for side in ("sim", "real"):
        found = connection.execute(
            f"""SELECT p.iid, p.x, p.y, p.heading, p.error, p.heading_error, p.loss, p.accuracy,
                      p.rank, list_position(?, p.split) - 1 AS split, j.u, j.v,
                      {outlier} AS outlier
               FROM prediction p LEFT JOIN projection j USING (run, iid, side)
               WHERE run = ? AND side = ?""",
            [list(SPLITS), run, side],
        ).fetchnumpy()
        sides[side] = _side(found, truth, rooms)
    sim, real = sides["sim"], sides["real"]
    dx, dy = real.x - sim.x, real.y - sim.y
    return RunColumns(
        run=run,
        sim=sim,
        real=real,
        gap=real.error - sim.error,
        shift=np.sqrt(dx * dx + dy * dy),
        valid=~(np.isnan(sim.error) | np.isnan(real.error)),
    )


def accuracies(
    connection: duckdb.DuckDBPyConnection, run: str, side: str, n: int
) -> NDArray[np.float32]:
    """One side of one run, (n,), NaN where there is no prediction."""
    found = connection.execute(
        "SELECT iid, accuracy FROM prediction WHERE run = ? AND side = ?", [run, side]
    ).fetchnumpy()
    column = np.full(n, np.nan, dtype=np.float32)
    column[np.asarray(found["iid"], dtype=np.int64)] = _floats(found["accuracy"])
    return column


def _side(found: Columns, truth: InstanceColumns, rooms: Sequence[Room]) -> SideColumns:
    n = len(truth)
    iid = np.asarray(found["iid"], dtype=np.int64)

    def spread(name: str) -> NDArray[np.float64]:
        column = np.full(n, np.nan)
        column[iid] = _floats(found[name])
        return column

    def spread_codes(name: str, missing: int) -> NDArray[np.int32]:
        column = np.full(n, missing, dtype=np.int32)
        column[iid] = _integers(found[name], missing)
        return column

    floats = {
        name: spread(name)
        for name in (
            "x", "y", "heading", "error", "heading_error", "loss", "accuracy", "u", "v", "outlier"
        )
    }  # fmt: skip
    return SideColumns(
        **floats,
        rank=spread_codes("rank", 0),
        split=spread_codes("split", -1),
        room=room_geometry.room_codes(floats["x"], floats["y"], rooms, truth.room_names),
    )


def _floats(column: NDArray[Any]) -> NDArray[np.float64]:
    if isinstance(column, np.ma.MaskedArray):
        return np.ma.filled(column.astype(np.float64), np.nan)
    return np.asarray(column, dtype=np.float64)


def _integers(column: NDArray[Any], missing: int) -> NDArray[np.int32]:
    if isinstance(column, np.ma.MaskedArray):
        return np.asarray(column.filled(missing), dtype=np.int32)
    return np.asarray(column, dtype=np.int32)


def _codes(column: NDArray[Any], names: Sequence[str]) -> NDArray[np.int32]:
    code = {name: position for position, name in enumerate(names)}
    values = column.filled(None) if isinstance(column, np.ma.MaskedArray) else column
    return np.array([code.get(value, -1) for value in values], dtype=np.int32)
