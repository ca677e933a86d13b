"""Checking a store: does all that the published generation promises lie there, undamaged?"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from s2rstore import arrays, layout, schema
from s2rstore.errors import RequestError
from s2rstore.ledger import Entry, Ledger
from s2rstore.reader import Store


@dataclass(frozen=True, slots=True)
class Damage:
    """One thing that is not as it should be: where, and what is wrong with it."""

    where: str
    what: str


def verify(root: Path) -> list[Damage]:
    """Everything wrong with the published generation; an empty list means none was found.

    Raises RequestError where there is no store at all.
    """
    current = layout.read_current(root)
    index = root / current.index
    if not index.exists():
        return [Damage(current.index, "missing")]
    if layout.file_sha256(index) != current.sha256:
        return [Damage(current.index, "its checksum is not the published one")]
    try:
        with Store(root) as store:
            return [
                *_tables(store, current),
                *_weights(root, store),
                *_frames(root, store),
                *_arrays(root, store),
            ]
    except (RequestError, duckdb.Error, ValueError, TypeError) as error:
        return [Damage(current.index, str(error).splitlines()[0])]


_RULES = (
    (
        "instance",
        "iid not dense",
        "iid <> (SELECT count(*) FROM instance) - 1 AND iid >= (SELECT count(*) FROM instance)",
    ),
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
)


def _tables(store: Store, current: layout.Current) -> Iterator[Damage]:
    for table, what, condition in _RULES:
        count = store.execute(f'SELECT count(*) FROM "{table}" WHERE {condition}')[0][0]
        if count:
            yield Damage(f"table {table}", f"{count} rows: {what}")
    errors = store.execute(
        """SELECT count(*) FROM prediction p JOIN instance i USING (iid)
           WHERE abs(p.error - sqrt((p.x-i.x)*(p.x-i.x) + (p.y-i.y)*(p.y-i.y))) > 1e-9"""
    )[0][0]
    if errors:
        yield Damage("table prediction", f"{errors} rows: error is not the distance to the truth")
    if store.dataset.hash != current.dataset_hash:
        yield Damage(layout.CURRENT, "names another data set than the index")
    for known in schema.TABLES:
        store.execute(f'SELECT {", ".join(known.column_names)} FROM "{known.name}" LIMIT 0')


def _weights(root: Path, store: Store) -> Iterator[Damage]:
    """Weights must be the file that was registered, for a model that came with a ledger entry."""
    ledger = Ledger(root)
    entries = ledger.by_key()
    for model in store.models.values():
        known = entries.get(f"model:{model.sha256}")
        if known is not None and not ledger.intact(known[-1]):
            yield Damage(known[-1].path, "missing, or not the registered weights")


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
        self._entries: dict[str, Entry] = {entry.path: entry for entry in self._ledger.entries()}

    def check(
        self, relative: Path, rows: int, shape: tuple[int, ...] | None = None
    ) -> Iterator[Damage]:
        try:
            array = arrays.open_read(self._root / relative)
        except RequestError:
            yield Damage(str(relative), "no such array")
            return
        except (ValueError, KeyError, TypeError, json.JSONDecodeError) as error:
            yield Damage(str(relative), f"unreadable metadata ({error})")
            return
        if array.shape[0] != rows or (shape is not None and array.shape != shape):
            yield Damage(str(relative), f"shape {array.shape} is not the published one")
            return
        yield from self._shards(relative, array)

    def _shards(self, relative: Path, array: Any) -> Iterator[Damage]:
        shard_rows = array.shards[0] if array.shards else array.chunks[0]
        for shard in range(-(-array.shape[0] // shard_rows)):
            path = arrays.shard_file(relative, shard, array.ndim)
            entry = self._entries.get(path.as_posix())
            if entry is None:
                yield Damage(str(path), "no ledger entry proves it")
            elif not self._ledger.intact(entry):
                missing = not (self._root / path).exists()
                yield Damage(
                    str(path), "missing" if missing else "its checksum is not the ledger's"
                )
