"""Load index rows as dense columns aligned by iid, each at its first use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import duckdb
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, first_line
from s2rstore.geometry import rooms as room_geometry
from s2rstore.index import schema
from s2rstore.index.columns import InstanceColumns, RunColumns, SideColumns
from s2rstore.lru_cache import LruCache
from s2rstore.records import NO_RUN, SIDES, SPLITS, TRAINING_SPLITS, Room, Run, Side

_PROJECTED = ("u", "v")
_SELECT = "SELECT iid, {} AS value FROM {} WHERE run = ? AND side = ?"
_LABELLED = """SELECT DISTINCT iid, 1 AS value FROM frame_label JOIN label USING (label)
               WHERE name = ?"""
_FAULTY = "SELECT DISTINCT iid, 1 AS value FROM frame_fault WHERE fault = ?"
_LABEL_GAINS = """SELECT iid, sum(gain) AS value FROM label_gain JOIN label USING (label)
                  WHERE run = ? AND name = ? GROUP BY iid"""


@dataclass(frozen=True)
class ColumnLoader:
    """Loads columns of an open index: `connect` opens a connection, `cache` holds loaded columns.

    `n` is the number of instances.
    """

    connect: Callable[[], duckdb.DuckDBPyConnection]
    cache: LruCache
    n: int

    @cached_property
    def iids(self) -> NDArray[np.int32]:
        return np.arange(self.n, dtype=np.int32)

    def column(
        self, sql: str, parameters: Sequence[object], missing: float | None = None
    ) -> NDArray[Any]:
        """(n,) from rows of iid and value: float64, int32 where there is a number for `missing`.

        Raises RequestError where the index cannot be read or holds other instances.
        """
        try:
            rows = self.connect().execute(sql, list(parameters)).fetchnumpy()
        except duckdb.Error as error:
            message = (
                f"the index cannot be read ({first_line(error)}); open the store again, or run "
                "`s2r verify`"
            )
            raise RequestError(message) from error
        iid, values = rows["iid"], rows["value"]
        kind = np.float64 if missing is None else np.int32
        blank = np.nan if missing is None else missing
        if type(values) is not np.ndarray:  # masked; to ask for numpy.ma would import it
            values = np.ma.filled(values.astype(kind), blank)
        values = np.asarray(values, dtype=kind)
        if np.array_equal(iid, self.iids):
            return values
        if iid.size and not 0 <= iid.min() <= iid.max() < self.n:
            raise RequestError(f"the index has iids beyond {self.n - 1}; run `s2r verify`")
        column = np.full(self.n, blank, dtype=kind)
        column[iid] = values
        return column

    def of_side(
        self, value: str, table: str, run: str, side: Side, missing: float | None = None
    ) -> NDArray[Any]:
        """(n,) an SQL expression over the rows of one side of a run; see `column`."""
        return self.column(_SELECT.format(value, table), (run, side), missing)


def load_instances(
    loader: ColumnLoader,
    trajectories: tuple[str, ...],
    rooms: Mapping[str, str],
    imaged: Callable[[str], NDArray[np.bool_]],
) -> InstanceColumns:
    """All instances in iid order; `rooms` maps displayed names to those in the index."""
    stored = {"trajectory": trajectories, "room": tuple(rooms.values())}

    def read(name: str) -> NDArray[Any]:
        return loader.cache.get(("instance", name), partial(_instance_column, loader, name, stored))

    def named(kind: str, sql: str) -> Callable[[str], NDArray[np.bool_]]:
        return lambda name: loader.cache.get(
            ("instance", kind, name), lambda: loader.column(sql, [name], 0).astype(np.bool_)
        )

    labelled, faulty = named("labelled", _LABELLED), named("faulty", _FAULTY)
    return InstanceColumns(read, loader.n, trajectories, tuple(rooms), imaged, labelled, faulty)


def _instance_column(
    loader: ColumnLoader, name: str, names: dict[str, tuple[str, ...]]
) -> NDArray[Any]:
    if name not in names:
        value = f'coalesce("{name}", 0)' if name in schema.PAIR_OFFSETS else f'"{name}"'
        sql = f"SELECT iid, {value} AS value FROM instance"
        return loader.column(sql, (), -1 if name == "seq" else None)
    sql = f"""SELECT iid, code AS value FROM instance LEFT JOIN
              (SELECT unnest(?) AS name, unnest(range(?)) AS code) ON name = "{name}" """
    return loader.column(sql, (list(names[name]), len(names[name])), -1)


def load_run_columns(
    loader: ColumnLoader, record: Run, truth: InstanceColumns, rooms: Sequence[Room]
) -> RunColumns:
    """Both sides of one run; instances without a prediction are NaN and not valid."""
    run = record.run

    def cached(side: Side | None, load: Callable[[str], NDArray[Any]]) -> Callable[[str], Any]:
        return lambda name: loader.cache.get(("run", run, side, name), partial(load, name))

    def of_side(side: Side, name: str) -> NDArray[Any]:
        part = sides[side]
        if name == "room":
            return room_geometry.room_codes(part.x, part.y, rooms, truth.room_names)
        if name in _PROJECTED:
            return _projected(loader, run, side, name, part.x)
        if name == "imaged":
            return truth.imaged(record.domain(side))
        return _predicted(loader, run, side, name)

    sides: dict[Side, SideColumns] = {
        side: SideColumns(cached(side, partial(of_side, side))) for side in SIDES
    }
    sim, real = sides["sim"], sides["real"]

    def of_run(name: str) -> NDArray[Any]:
        if name == "gap":
            return np.asarray(real.error - sim.error)
        if name == "valid":
            return np.asarray(~(np.isnan(sim.error) | np.isnan(real.error)))
        if name == "paired":
            return np.asarray(sim.imaged & real.imaged)
        if name == "attempted":
            return np.asarray(((sim.split >= 0) & (real.split >= 0)) | columns.valid)
        if name == "trained":
            return trained_instances(loader, run)
        if name == "split":
            known = [np.where(side.split < 0, len(SPLITS), side.split) for side in (sim, real)]
            first = np.minimum(*known).astype(np.int32)
            return np.where(first < len(SPLITS), first, np.int32(-1))
        dx, dy = real.x - sim.x, real.y - sim.y
        return np.asarray(np.sqrt(dx * dx + dy * dy))

    def label_gains(name: str) -> NDArray[np.float64]:
        load = partial(loader.column, _LABEL_GAINS, (run, name))
        return loader.cache.get(("run", run, None, "label_gains", name), load)

    columns = RunColumns(cached(None, of_run), run, sim, real, label_gains)
    return columns


def trained_instances(loader: ColumnLoader, run: str) -> NDArray[np.bool_]:
    """(n,) the instances of which an image of either side is in `records.TRAINING_SPLITS`."""
    splits = ", ".join(f"'{split}'" for split in TRAINING_SPLITS)
    sql = f"SELECT iid, 1 AS value FROM prediction WHERE run = ? AND split IN ({splits})"
    return loader.column(sql, (run,), 0).astype(np.bool_)


def unpredicted(n: int, imaged: Mapping[Side, NDArray[np.bool_]]) -> RunColumns:
    """Columns in place of a run's in a store without one, where every instance is valid.

    `imaged` (n,) are the instances with an image of a side.
    """
    cache: dict[str, NDArray[Any]] = {"paired": imaged["sim"] & imaged["real"]}

    def read(name: str) -> NDArray[Any]:
        blank: NDArray[Any] = np.full(n, np.nan)
        if name in ("split", "room"):
            blank = np.full(n, -1, dtype=np.int32)
        elif name == "rank":
            blank = np.zeros(n, dtype=np.int32)
        elif name in ("valid", "attempted", "trained"):
            blank = np.full(n, name != "trained")
        return cache.setdefault(name, blank)

    def of_side(side: Side) -> SideColumns:
        return SideColumns(lambda name: imaged[side] if name == "imaged" else read(name))

    return RunColumns(read, NO_RUN, of_side("sim"), of_side("real"), lambda name: read("gain"))


def _predicted(loader: ColumnLoader, run: str, side: Side, name: str) -> NDArray[Any]:
    if name == "split":
        sql = _SELECT.format("list_position(?, split) - 1", "prediction")
        return loader.column(sql, (list(SPLITS), run, side), -1)
    return loader.of_side(f'"{name}"', "prediction", run, side, 0 if name == "rank" else None)


def _projected(
    loader: ColumnLoader, run: str, side: Side, name: str, x: NDArray[np.float64]
) -> NDArray[Any]:
    """A projection column, NaN where the side has no prediction."""
    column = loader.of_side(f'"{name}"', "projection", run, side)
    if not np.isnan(x).any():
        return column
    return np.where(loader.of_side("1", "prediction", run, side, 0), column, np.nan)
