"""Rows of the selected instances, with the facts of the evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.image_faults import FAULTS
from s2rstore.index import schema
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
class SelectedRows:
    """Rows ordered by iid, and the facts of their evaluation; see `evaluation_facts`."""

    names: tuple[str, ...]
    rows: Sequence[Sequence[Any]]
    facts: dict[str, Any]


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
    default += schema.PAIR_OFFSETS if store.has_loose_pairs else ()
    default += (SPLIT_COLUMN,) if population.with_trained and store.has_poses else ()
    if columns is None:
        rows = _rows_of(store, run, iids, default)
    else:
        names = map(fields.of_name, columns)
        readers = [_column(store, run, name, notes, population) for name in names]
        rows = [tuple(read(iid) for read in readers) for iid in iids.tolist()]
    return SelectedRows(
        tuple(column.split(" AS ")[-1] for column in columns or default), rows,
        evaluation_facts(store, query),
    )  # fmt: skip


def evaluation_facts(store: Store, query: Query) -> dict[str, Any]:
    """Expression, run and data of an evaluation, without what adds no information.

    `expanded` has no saved names in it. `in_view` counts the valid instances in view, `trained_on`
    how many of them the run's model was trained on; these are left out unless `with_trained`.
    `note` says for how many instances the run is computed where these are not all; `unpaired` says
    how many more lack an image of a side.
    """
    run, population = query.context.run, query.context.population
    expression, expanded = to_text(query.node), to_text(query.expanded)
    facts: dict[str, Any] = {"expression": expression}
    if expanded != expression:
        facts["expanded"] = expanded
    facts["run"] = run
    if population.trajectories:
        facts["trajectories"] = population.trajectories
    facts |= {
        "generation": store.generation, "dataset": store.dataset.hash,
        "dataset_name": store.dataset.name, "count": query.count,
    }  # fmt: skip
    if trained := int(np.count_nonzero(query.trained)):
        facts["in_view"] = int(np.count_nonzero(query.in_view))
        facts |= {"trained_on": trained, "with_trained": population.with_trained}
    if note := store.coverage(run).note:
        facts["note"] = note
    if query.unpaired_text:
        facts["unpaired"] = query.unpaired_text
    return facts


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
        return _names_of({domain: store.imaged(domain) for domain in store.domains})
    if name == "label":
        classes = dict.fromkeys(store.label_names.values())
        return _names_of({each: store.instances.labelled(each) for each in classes})
    if name == "health":
        return _names_of({fault: store.instances.faulty(fault) for fault in FAULTS})
    if name in fields.TEXT:
        text = fields.TEXT[name]
        truth = store.instances
        labels = {
            "rooms": tuple(store.stored_rooms.values()),
            "trajectories": truth.trajectory_names,
            "splits": SPLITS,
        }[text.vocabulary]
        codes = fields.column(text.path, truth, store.run_columns(run))
        return lambda iid: labels[codes[iid]] if codes[iid] >= 0 else None
    if name not in fields.NUMERIC and (meant := fields.meant(name)):
        raise RequestError(f"--columns {name}: no such field; {meant} is meant")
    if name not in fields.NUMERIC:
        numeric = map(fields.with_unit, fields.NUMERIC)
        allowed = ", ".join((*numeric, *fields.TEXT, *NOTEBOOK_COLUMNS))
        raise RequestError(f"--columns {name}: must be one of {allowed}")
    field, run_columns = fields.NUMERIC[name], store.run_columns(run)
    numbers = fields.column(field.path, store.instances, run_columns)
    if name in fields.RANKS:
        numbers = population_ranks(population, run_columns, fields.RANKS[name])
    if name in _INTEGER_FIELDS:
        return lambda iid: int(numbers[iid]) if numbers[iid] or name in ("iid", "seq") else None
    return lambda iid: None if np.isnan(numbers[iid]) else float(numbers[iid]) / field.scale


def _names_of(masks: Mapping[str, NDArray[np.bool_]]) -> Callable[[int], str]:
    """Return a function from iid to the names, joined, whose mask (N,) holds it."""
    return lambda iid: " ".join(name for name, mask in masks.items() if mask[iid])


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
