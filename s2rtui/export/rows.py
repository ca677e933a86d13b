"""Rows of the selected instances, with the facts of the evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index.population import SPLIT_SQL, Population, count_text
from s2rstore.language import evaluation, expand, fields, parse, to_text
from s2rstore.metrics.pose_metrics import population_ranks
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SPLITS
from s2rtools.common.command_line.row_formats import (
    Metadata,
    Rows,
    csv_text,
    json_text,
    write_parquet,
)
from s2rtui.user_data.notebook import Notes, Remark

COLUMNS = (
    "iid", "trajectory", "seq", "x_m", "y_m", "degrees(heading_rad) AS heading_deg", "room",
    "sim_error_m", "real_error_m", "gap_m",
    "degrees(sim_heading_error_rad) AS sim_heading_error_deg",
    "degrees(real_heading_error_rad) AS real_heading_error_deg",
)  # fmt: skip
"""Default columns, as SQL on `pair`."""
TRUTH_COLUMNS = COLUMNS[:7]
"""Default columns where no run is computed."""
OFFSET_COLUMNS = ("pair_offset_m", "pair_offset_deg")
"""Further default columns where some pairs are loose."""
IMAGE_COLUMNS = ("iid", "trajectory", "seq", "timestamp_s")
"""Default columns in a data set without poses."""
SPLIT_COLUMN = f"{SPLIT_SQL} AS split"
"""A further default column where trained instances are included."""
NOTEBOOK_COLUMNS = ("tags", "note")
_BLOCK_IIDS = 100_000
"""Number of instances whose rows are read at a time, which bounds the memory."""
_INTEGER_FIELDS = ("iid", "seq", "sim.rank", "real.rank")


@dataclass(frozen=True, slots=True)
class EvaluationFacts:
    """Expression, run and data of an evaluation; `expanded` has no saved names in it.

    `in_view` counts the valid instances in view, `trained_on` those of them that the run's model
    was trained on; these are left out unless `with_trained`. `note` says for how many instances the
    run is computed where these are not all.
    """

    expression: str
    expanded: str
    run: str
    trajectories: tuple[str, ...] | None
    generation: int
    dataset: str
    dataset_name: str
    count: int
    in_view: int = 0
    trained_on: int = 0
    with_trained: bool = False
    note: str = ""

    @property
    def count_text(self) -> str:
        """`8 of 40 (32 trained on)`."""
        return count_text(self.count, self.in_view, self.trained_on, self.with_trained)

    def as_dict(self) -> dict[str, Any]:
        """Return the facts without those that add no information."""
        facts = asdict(self)
        if self.expanded == self.expression:
            del facts["expanded"]
        if not self.trained_on:
            for name in ("in_view", "trained_on", "with_trained"):
                del facts[name]
        if self.trajectories is None:
            del facts["trajectories"]
        if not self.note:
            del facts["note"]
        return facts


@dataclass(frozen=True, slots=True)
class SelectedRows:
    """Rows ordered by iid."""

    names: tuple[str, ...]
    rows: Sequence[Sequence[Any]]
    facts: EvaluationFacts


def selected_rows(
    store: Store,
    expression: str,
    run: str | None = None,
    trajectories: Sequence[str] | None = None,
    notes: Notes | None = None,
    columns: Sequence[str] | None = None,
    selected: NDArray[np.bool_] | None = None,
    with_trained: bool = False,
) -> SelectedRows:
    """Return the rows of the instances that an expression selects.

    Instances that the run's model was trained on are left out unless `with_trained`; the default
    columns then have the `split`. `columns` are fields of the selection language, with or without
    units, `tags` and `note`. `selected` (N,) is the result of the expression if it is known, which
    then is not evaluated again. Raises ExpressionError, and RequestError for columns and runs that
    do not exist.
    """
    notes = notes or Notes()
    name = store.run_name(run)
    default: tuple[str, ...] = COLUMNS if name != NO_RUN else TRUTH_COLUMNS
    default = default if store.has_poses else IMAGE_COLUMNS
    default += OFFSET_COLUMNS if store.has_loose_pairs else ()
    default += (SPLIT_COLUMN,) if with_trained and store.has_poses else ()
    if columns is None and selected is not None:
        rows = _rows_of(store, name, np.flatnonzero(selected), default)
    else:
        text, parameters = evaluation.sql(
            store, expression, name, trajectories, notes.nodes, with_trained
        )
        if columns is None:
            pairs = evaluation.pairs(store)
            query = f"SELECT {', '.join(default)} FROM {pairs} JOIN ({text}) USING (iid)"
            rows = store.execute(f"{query} WHERE run = ? ORDER BY iid", [*parameters, name])
        else:
            population = Population(with_trained=with_trained)
            readers = [
                _column(store, name, fields.of_name(column), notes, population)
                for column in columns
            ]
            iids = store.execute(f"SELECT iid FROM ({text}) ORDER BY iid", parameters)
            rows = [tuple(read(iid) for read in readers) for (iid,) in iids]
    node = parse(expression)
    expanded = to_text(expand(node, evaluation.vocabulary(store, notes.nodes)))
    facts = EvaluationFacts(
        to_text(node), expanded, name, tuple(trajectories) if trajectories else None,
        store.generation, store.dataset.hash, store.dataset.name, len(rows),
        *count_in_view(store, name, trajectories), with_trained,
        store.coverage(name).note,
    )  # fmt: skip
    names = [column.split(" AS ")[-1] for column in columns or default]
    return SelectedRows(tuple(names), rows, facts)


def count_in_view(store: Store, run: str, trajectories: Sequence[str] | None) -> tuple[int, int]:
    """Numbers of valid instances in view, and of those that the run's model was trained on."""
    view = Population(None if trajectories is None else tuple(trajectories))
    columns = store.run_columns(run)
    in_view = view.in_view(store.instances, columns)
    return int(np.count_nonzero(in_view)), int(np.count_nonzero(in_view & columns.trained))


def _rows_of(
    store: Store, run: str, iids: NDArray[np.intp], columns: Sequence[str]
) -> list[tuple[Any, ...]]:
    pairs = evaluation.pairs(store)
    query = f"SELECT {', '.join(columns)} FROM {pairs} WHERE run = ? AND iid BETWEEN ? AND ?"
    rows: list[tuple[Any, ...]] = []
    for block in np.split(iids, np.flatnonzero(np.diff(iids // _BLOCK_IIDS)) + 1):
        if block.size:
            chosen, ends = set(block.tolist()), [int(block[0]), int(block[-1])]
            block_rows = store.execute(f"{query} ORDER BY iid", [run, *ends])
            rows += [row for row in block_rows if row[0] in chosen]
    return rows


def _column(
    store: Store, run: str, name: str, notes: Notes, population: Population
) -> Callable[[int], Any]:
    """Return a function from iid to the value of a column, in units of the language, or None."""
    if name == "tags":
        return lambda iid: " ".join(notes.remarks.get(iid, Remark()).tags) or None
    if name == "note":
        return lambda iid: notes.remarks.get(iid, Remark()).note or None
    is_field = name in fields.TEXT or name in fields.NUMERIC
    if run == NO_RUN and store.has_poses and is_field and not fields.is_truth(name):
        raise RequestError(f"--columns {name}: needs predictions: {store.no_run}")
    if name in fields.TEXT:
        text = fields.TEXT[name]
        truth = store.instances
        labels = {
            "rooms": tuple(store.stored_rooms.values()),
            "trajectories": truth.trajectory_names,
            "splits": SPLITS,
        }[text.vocabulary]
        codes = _values(store, run, text.path)
        return lambda iid: labels[codes[iid]] if codes[iid] >= 0 else None
    if name not in fields.NUMERIC and (field := fields.meant(name)):
        raise RequestError(f"--columns {name}: no such field; {field} is meant")
    if name not in fields.NUMERIC:
        numeric = map(fields.with_unit, fields.NUMERIC)
        allowed = ", ".join((*numeric, *fields.TEXT, *NOTEBOOK_COLUMNS))
        raise RequestError(f"--columns {name}: must be one of {allowed}")
    numbers, scale = _values(store, run, fields.NUMERIC[name].path), fields.NUMERIC[name].scale
    if name in fields.RANKS:
        numbers = population_ranks(population, store.run_columns(run), fields.RANKS[name])
    if name in _INTEGER_FIELDS:
        return lambda iid: int(numbers[iid]) if numbers[iid] or name in ("iid", "seq") else None
    return lambda iid: None if np.isnan(numbers[iid]) else float(numbers[iid]) / scale


def _values(store: Store, run: str, path: str) -> np.ndarray:
    """Return the column (N,) at a path of the fields of the language."""
    if path == "iid":
        return np.arange(len(store.instances))
    owner, _, attribute = path.rpartition(".")
    columns = store.run_columns(run)
    holder = {"instances": store.instances, "sim": columns.sim, "real": columns.real}.get(owner)
    return np.asarray(getattr(holder or columns, attribute))


def write_rows(
    target: Path,
    names: Sequence[str],
    rows: Rows,
    metadata: Metadata | None = None,
    safe_csv: bool = False,
) -> None:
    """Write a file in the format of its suffix. Raises RequestError, OSError."""
    if target.suffix == ".parquet":
        write_parquet(names, rows, target, metadata)
    elif target.suffix == ".csv":
        target.write_text(csv_text(names, rows, metadata, safe_csv), encoding="utf-8")
    else:
        target.write_text(json_text(names, rows, metadata), encoding="utf-8")
