"""Rows of the selected instances, with the facts of the evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index.population import SPLIT_SQL, Population
from s2rstore.language import Query, evaluation, fields, to_text
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

    `count` is the number of selected instances that count, `unpaired` says how many more lack an
    image of a side. `in_view` counts the valid instances in view, `trained_on` those of them that
    the run's model was trained on; these are left out unless `with_trained`. `note` says for how
    many instances the run is computed where these are not all.
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
    unpaired: str = ""

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
        for name in ("note", "unpaired"):
            if not facts[name]:
                del facts[name]
        return facts


@dataclass(frozen=True, slots=True)
class SelectedRows:
    """Rows ordered by iid."""

    names: tuple[str, ...]
    rows: Sequence[Sequence[Any]]
    facts: EvaluationFacts


def selected_rows(
    store: Store, query: Query, notes: Notes | None = None, columns: Sequence[str] | None = None
) -> SelectedRows:
    """Return the rows of the instances that a query selects.

    `columns` are fields of the selection language, with or without units, `tags` and `note`. Where
    trained instances are included, the default columns have the `split`. Raises ExpressionError,
    and RequestError for columns that do not exist.
    """
    notes, run = notes or Notes(), query.context.run
    population = query.context.population
    iids = np.flatnonzero(query.instances)
    default: tuple[str, ...] = COLUMNS if run != NO_RUN else TRUTH_COLUMNS
    default = default if store.has_poses else IMAGE_COLUMNS
    default += OFFSET_COLUMNS if store.has_loose_pairs else ()
    default += (SPLIT_COLUMN,) if population.with_trained and store.has_poses else ()
    if columns is None:
        rows = _rows_of(store, run, iids, default)
    else:
        names = map(fields.of_name, columns)
        readers = [_column(store, run, name, notes, population) for name in names]
        rows = [tuple(read(iid) for read in readers) for iid in iids.tolist()]
    facts = EvaluationFacts(
        to_text(query.node), to_text(query.expanded), run, population.trajectories or None,
        store.generation, store.dataset.hash, store.dataset.name, query.count,
        int(np.count_nonzero(query.in_view)), int(np.count_nonzero(query.trained)),
        population.with_trained, store.coverage(run).note, query.unpaired_text,
    )  # fmt: skip
    return SelectedRows(
        tuple(column.split(" AS ")[-1] for column in columns or default), rows, facts
    )


def _rows_of(
    store: Store, run: str, iids: NDArray[np.intp], columns: Sequence[str]
) -> list[tuple[Any, ...]]:
    query = (
        f"SELECT {', '.join(columns)} FROM {evaluation.rows_of_run(store, run)} WHERE run = ? AND "
        "iid BETWEEN ? AND ? AND iid IN (SELECT unnest(?::INTEGER[])) ORDER BY iid"
    )
    rows: list[tuple[Any, ...]] = []
    for block in np.split(iids, np.flatnonzero(np.diff(iids // _BLOCK_IIDS)) + 1):
        if block.size:
            rows += store.execute(query, [run, int(block[0]), int(block[-1]), block.tolist()])
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
    if name == "has":
        imaged = {domain: store.imaged(domain) for domain in store.domains}
        return lambda iid: " ".join(domain for domain, mask in imaged.items() if mask[iid])
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
