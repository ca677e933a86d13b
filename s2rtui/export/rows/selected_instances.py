"""The instances of a selection, and what it was evaluated on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language import evaluation, expand, fields, parse, to_text
from s2rstore.reader import Store
from s2rstore.records import SPLITS
from s2rtui.user_data.notebook import Notes, Remark

COLUMNS = (
    "iid", "trajectory", "seq", "x", "y", "degrees(heading) AS heading", "room", "sim_error",
    "real_error", "gap", "degrees(sim_heading_error) AS sim_heading_error",
    "degrees(real_heading_error) AS real_heading_error",
)  # fmt: skip
"""What a selection's rows hold unless columns are named, as SQL on `pair`."""
_NAMES = tuple(column.split(" AS ")[-1] for column in COLUMNS)
OWN = ("tags", "note")
_BLOCK = 100_000
"""Instances whose rows are joined at a time, where memory is bounded."""
_WHOLE = ("iid", "seq", "sim.rank", "real.rank")


@dataclass(frozen=True, slots=True)
class EvaluationFacts:
    """What a selection was evaluated on; `expanded` has no saved names in it."""

    expression: str
    expanded: str
    run: str
    trajectories: tuple[str, ...] | None
    generation: int
    dataset: str
    dataset_name: str
    count: int

    def told(self) -> dict[str, Any]:
        """Without what says nothing more."""
        facts = asdict(self)
        if self.expanded == self.expression:
            del facts["expanded"]
        if self.trajectories is None:
            del facts["trajectories"]
        return facts


@dataclass(frozen=True, slots=True)
class Picked:
    """Rows by iid."""

    names: tuple[str, ...]
    rows: Sequence[Sequence[Any]]
    facts: EvaluationFacts


def picked(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    notes: Notes | None = None,
    columns: Sequence[str] | None = None,
    selected: NDArray[np.bool_] | None = None,
) -> Picked:
    """What an expression selects; `columns` are fields of the language, `tags` and `note`.

    `selected` (N,) is what it selects, where that is known: its rows need little memory.

    Raises ExpressionError, and RequestError for columns and runs that do not exist.
    """
    notes = notes or Notes()
    name = store.run(run).run
    if columns is None and selected is not None:
        rows = _by_blocks(store, name, np.flatnonzero(selected))
    else:
        text, parameters = evaluation.sql(store, expression, name, trajectories, notes.nodes)
        if columns is None:
            wanted = f"SELECT {', '.join(COLUMNS)} FROM pair JOIN ({text}) USING (iid)"
            rows = store.execute(f"{wanted} WHERE run = ? ORDER BY iid", [*parameters, name])
        else:
            readers = [_column(store, name, column, notes) for column in columns]
            found = store.execute(f"SELECT iid FROM ({text}) ORDER BY iid", parameters)
            rows = [tuple(read(iid) for read in readers) for (iid,) in found]
    node = parse(expression)
    expanded = to_text(expand(node, evaluation.vocabulary(store, notes.nodes)))
    facts = EvaluationFacts(
        to_text(node), expanded, name, tuple(trajectories) if trajectories else None,
        store.generation, store.dataset.hash, store.dataset.name, len(rows),
    )  # fmt: skip
    return Picked(_NAMES if columns is None else tuple(columns), rows, facts)


def _by_blocks(store: Store, run: str, iids: NDArray[np.intp]) -> list[tuple[Any, ...]]:
    wanted = f"SELECT {', '.join(COLUMNS)} FROM pair WHERE run = ? AND iid BETWEEN ? AND ?"
    rows: list[tuple[Any, ...]] = []
    for block in np.split(iids, np.flatnonzero(np.diff(iids // _BLOCK)) + 1):
        if block.size:
            chosen, ends = set(block.tolist()), [int(block[0]), int(block[-1])]
            found = store.execute(f"{wanted} ORDER BY iid", [run, *ends])
            rows += [row for row in found if row[0] in chosen]
    return rows


def _column(store: Store, run: str, name: str, notes: Notes) -> Callable[[int], Any]:
    """What a column says of an iid, in the language's units; None for nothing."""
    if name == "tags":
        return lambda iid: " ".join(notes.remarks.get(iid, Remark()).tags) or None
    if name == "note":
        return lambda iid: notes.remarks.get(iid, Remark()).note or None
    if name in fields.TEXT:
        text = fields.TEXT[name]
        truth = store.instances
        words = {
            "rooms": tuple(store.stored_rooms.values()),
            "trajectories": truth.trajectory_names,
            "splits": SPLITS,
        }[text.vocabulary]
        codes = _values(store, run, text.path)
        return lambda iid: words[codes[iid]] if codes[iid] >= 0 else None
    if name not in fields.NUMERIC:
        known = ", ".join((*fields.NUMERIC, *fields.TEXT, *OWN))
        raise RequestError(f"--columns {name}: one of {known}")
    numbers, scale = _values(store, run, fields.NUMERIC[name].path), fields.NUMERIC[name].scale
    if name in _WHOLE:
        return lambda iid: int(numbers[iid]) if numbers[iid] or name in ("iid", "seq") else None
    return lambda iid: None if np.isnan(numbers[iid]) else float(numbers[iid]) / scale


def _values(store: Store, run: str, path: str) -> np.ndarray:
    """The column (N,) at a path of the language's fields."""
    if path == "iid":
        return np.arange(len(store.instances))
    owner, _, attribute = path.rpartition(".")
    columns = store.run_columns(run)
    holder = {"instances": store.instances, "sim": columns.sim, "real": columns.real}.get(owner)
    return np.asarray(getattr(holder or columns, attribute))
