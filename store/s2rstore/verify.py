"""Checking a store: does all that the published generation promises lie there, undamaged?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from s2rstore import arrays, layout, sandbox, schema
from s2rstore.errors import RequestError
from s2rstore.ledger import Ledger
from s2rstore.reader import Store
from s2rstore.records import SIDES


@dataclass(frozen=True, slots=True)
class Damage:
    """One thing that is not as it should be: where, and what is wrong with it."""

    where: str
    what: str


def verify(root: Path) -> list[Damage]:
    """Everything wrong with the published generation; an empty list means none was found.

    Raises RequestError where there is no store at all, or none that DuckDB can open.
    """
    sandbox.literal_path(root)
    try:
        current = layout.read_current(root)
    except RequestError as error:
        if not (root / layout.CURRENT).exists():
            raise
        return [Damage(layout.CURRENT, str(error))]
    index = root / current.index
    if not index.exists():
        return [Damage(current.index, "missing")]
    try:
        if index.stat().st_size != current.bytes or layout.file_sha256(index) != current.sha256:
            return [Damage(current.index, "its size or checksum is not the published one")]
        with Store(root) as store:
            return [
                *_tables(store, current),
                *_weights(root, store),
                *_frames(root, store),
                *_arrays(root, store),
            ]
    except (RequestError, duckdb.Error, OSError, ValueError, TypeError) as error:
        return [Damage(current.index, str(error).splitlines()[0])]


_RULES = (
    (
        "instance",
        "pose is NULL or not finite",
        "x IS NULL OR y IS NULL OR heading IS NULL OR "
        "NOT isfinite(x) OR NOT isfinite(y) OR NOT isfinite(heading)",
    ),
    (
        "prediction",
        "a NaN where NULL belongs",
        "isnan(x) OR isnan(y) OR isnan(heading) OR "
        "isnan(error) OR isnan(heading_error) OR isnan(loss) OR isnan(accuracy)",
    ),
    ("prediction", "no such instance", "iid NOT IN (SELECT iid FROM instance)"),
    (
        "prediction",
        "unknown side or split",
        "side NOT IN ('sim', 'real') OR split NOT IN ('train', 'validation', 'test', 'unseen')",
    ),
    ("prediction", "run without a row in run", "run NOT IN (SELECT run FROM run)"),
    ("run", "model without a row in model", "model NOT IN (SELECT model FROM model)"),
    ("run", "name given twice", "run IN (SELECT run FROM run GROUP BY run HAVING count(*) > 1)"),
    (
        "model",
        "name given twice",
        "model IN (SELECT model FROM model GROUP BY model HAVING count(*) > 1)",
    ),
)

_FORMULAS = (
    ("error is not the distance to the truth", "abs(error - sqrt(dx * dx + dy * dy)) > 1e-9"),
    ("loss is not that of its errors", "abs(loss - (0.7 * error * error + 0.3 * turn)) > 1e-9"),
    ("accuracy is not that of its error", "abs(accuracy - greatest(0, 1 - error / scale)) > 1e-9"),
    ("rank is not that of its error", "rank IS DISTINCT FROM place"),
)
_FIGURES = """WITH figures AS (
    SELECT p.error, p.loss, p.accuracy, p.rank, p.heading_error AS turn,
           p.x - i.x AS dx, p.y - i.y AS dy, (SELECT accuracy_scale FROM dataset) AS scale,
           CASE WHEN p.error IS NOT NULL THEN row_number() OVER (
               PARTITION BY p.run, p.side ORDER BY p.error NULLS LAST, p.iid) END AS place
    FROM prediction p JOIN instance i USING (iid))
    SELECT """


def _tables(store: Store, current: layout.Current) -> Iterator[Damage]:
    for table, what, condition in (*_RULES, *_optional_rules(store)):
        count = store.execute(f'SELECT count(*) FROM "{table}" WHERE {condition}')[0][0]
        if count:
            yield Damage(f"table {table}", f"{count} rows: {what}")
    total, least, most, distinct = store.execute(
        "SELECT count(*), min(iid), max(iid), count(DISTINCT iid) FROM instance"
    )[0]
    if total and (least, most, distinct) != (0, total - 1, total):
        yield Damage("table instance", f"iid is not 0 .. {total - 1}, each once")
    stated = sum(trajectory.instances for trajectory in store.trajectories)
    if stated != total:
        yield Damage("table trajectory", f"states {stated} instances, there are {total}")
    counts = ", ".join(f"count(*) FILTER ({condition})" for _, condition in _FORMULAS)
    found = store.execute(f"{_FIGURES} {counts} FROM figures")[0]
    for count, (what, _) in zip(found, _FORMULAS, strict=True):
        if count:
            yield Damage("table prediction", f"{count} rows: {what}")
    yield from _complete_runs(store, total)
    if store.dataset.hash != current.dataset_hash:
        yield Damage(layout.CURRENT, "names another data set than the index")
    plan = store.floor_plan_path()
    if plan is not None and not (plan.is_file() and plan.stat().st_size):
        yield Damage(str(store.dataset.floor_plan), "the floor plan is missing")
    for known in schema.TABLES:
        names = [name for name in known.column_names if name not in store.lacking(known.name)]
        store.execute(f'SELECT {", ".join(names)} FROM "{known.name}" LIMIT 0')


def _optional_rules(store: Store) -> Iterator[tuple[str, str, str]]:
    if "outlier" not in store.lacking("prediction"):
        yield "prediction", "outlier is no distance", "isnan(outlier) OR outlier < 0"


def _complete_runs(store: Store, total: int) -> Iterator[Damage]:
    """Every computed run has one prediction per instance and side."""
    counted = {
        (run, side): count
        for run, side, count in store.execute(
            "SELECT run, side, count(DISTINCT iid) FROM prediction GROUP BY run, side"
        )
    }
    for name, run in store.runs.items():
        for side in SIDES if run.key else ():
            if counted.get((name, side), 0) != total:
                have = counted.get((name, side), 0)
                yield Damage("table prediction", f"run {name}: {have} of {total} {side} rows")


def _weights(root: Path, store: Store) -> Iterator[Damage]:
    """Weights must be the file that was registered, for a model that came with a ledger entry."""
    ledger = Ledger(root)
    entries = ledger.by_path()
    for model in store.models.values():
        for path, known in entries.items():
            if known[0].key == f"model:{model.sha256}" and not ledger.proves(known):
                yield Damage(path, "missing, or not the registered weights")


def _frames(root: Path, store: Store) -> Iterator[Damage]:
    ledger = _Proof(root)
    for domain in store.domains:
        for trajectory in store.trajectories:
            for name in ("rgb", "depth"):
                relative = Path(layout.FRAMES, domain, trajectory.trajectory, name)
                yield from ledger.check(relative, trajectory.instances)


def _arrays(root: Path, store: Store) -> Iterator[Damage]:
    ledger = _Proof(root)
    for run in store.runs:
        for record in store.arrays(run):
            yield from ledger.check(Path(layout.RUNS, record.path), record.shape[0], record.shape)


class _Proof:
    """Holds arrays against the ledger: every shard must have an intact entry."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._ledger = Ledger(root)
        self._entries = self._ledger.by_path()

    def check(
        self, relative: Path, rows: int, shape: tuple[int, ...] | None = None
    ) -> Iterator[Damage]:
        try:
            array = arrays.open_read(self._root / relative)
        except RequestError as error:
            yield Damage(str(relative), str(error))
            return
        if array.shape[0] != rows or (shape is not None and array.shape != shape):
            yield Damage(str(relative), f"shape {array.shape} is not the published one")
            return
        yield from self._shards(relative, array)

    def _shards(self, relative: Path, array: Any) -> Iterator[Damage]:
        shard_rows = array.shards[0] if array.shards else array.chunks[0]
        for shard in range(-(-array.shape[0] // shard_rows)):
            path = arrays.shard_file(relative, shard, array.ndim)
            known = self._entries.get(path.as_posix())
            if known is None:
                yield Damage(str(path), "no ledger entry proves it")
            elif not self._ledger.proves(known):
                missing = not (self._root / path).exists()
                yield Damage(
                    str(path), "missing" if missing else "its checksum is not the ledger's"
                )
