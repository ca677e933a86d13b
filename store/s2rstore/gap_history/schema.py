"""The history of nightly gaps, as data: every table and column with its type and comment.

Missing values are SQL NULL, never NaN.
"""

from __future__ import annotations

from s2rstore.gap_history.gate_status import EXIT_CODES_TEXT
from s2rstore.index.table_definition import (
    Column,
    Table,
    statements_of,
    table_of,
)
from s2rstore.intervals import LEVEL_TEXT

BOUNDS = {"": "", "_low": f", lower {LEVEL_TEXT} bound", "_high": f", upper {LEVEL_TEXT} bound"}
"""Suffixes of the numbers of a figure and its interval, and of their comments."""


def _bounds(name: str, comment: str) -> tuple[tuple[str, str, str], ...]:
    """The columns of `Interval.as_columns`."""
    numbers = [(f"{name}{end}", "DOUBLE", f"{comment}{suffix}") for end, suffix in BOUNDS.items()]
    reason = (f"{name}_reason", "VARCHAR", f"{comment}, why a bound is NULL")
    return (*numbers, reason)


_MEASURED: tuple[Table, ...] = (
    table_of(
        "night",
        "one row per night with a new result; the last row of a night is the valid one",
        "night id",
        ("id", "INTEGER", "order of writing, from 1"),
        ("name", "VARCHAR", "of the nightly configuration"),
        ("night", "DATE", "UTC date"),
        ("key", "VARCHAR", "SHA-256 of all that the figures depend on"),
        ("evidence", "VARCHAR", "SHA-256 of what was recorded: data set, run, drives"),
        ("measured", "INTEGER", "id of the night whose figures these are"),
        ("dataset", "VARCHAR", "name of the environment"),
        ("dataset_hash", "VARCHAR", "of the store's data set"),
        ("run", "VARCHAR", "run of the store"),
        ("run_key", "VARCHAR", "hash of all that its predictions depend on"),
        ("model", "VARCHAR", "the run's model; NULL = its predictions were imported"),
        ("expression", "VARCHAR", "which instances were selected"),
        (
            "outcome",
            "VARCHAR",
            "PASS, FAIL or INCONCLUSIVE: headline, golden run, growth and age of the evidence, "
            "with a budget of false alarms for a year; ERROR = the request does not fit what is "
            "there",
        ),
        ("exit_code", "INTEGER", EXIT_CODES_TEXT),
        ("headline", "VARCHAR", "PASS, FAIL or INCONCLUSIVE: the worst axis"),
        *_bounds("gap", "G of the worst axis; 0 = no gap, 100 = the declared bad state"),
        ("worst", "VARCHAR", "the worst axis; NULL = none was judged"),
        ("threshold", "DOUBLE", "of G"),
        ("reason", "VARCHAR", "of the headline, or why nothing was measured"),
        (
            "change",
            "VARCHAR",
            "PASS, FAIL or INCONCLUSIVE: growth of G over the nights; NULL = none",
        ),
        ("change_reason", "VARCHAR", "of the growth, by axis"),
        ("golden", "VARCHAR", "PASS, FAIL or INCONCLUSIVE; NULL = no golden run"),
        *_bounds("golden_change", "mean real error against the golden run, m"),
        ("golden_margin", "DOUBLE", "by which it may have grown, m"),
        ("evidence_since", "DATE", "first night that saw the newest part of this evidence"),
        ("evidence_age", "INTEGER", "days from then to this night"),
        ("stale_after", "DOUBLE", "days from which on evidence is too old"),
        ("written_at", "VARCHAR", "UTC, ISO 8601"),
    ),
    table_of(
        "axis",
        "axes of the gap, once per measurement; none where nothing could be measured",
        "measured position",
        ("measured", "INTEGER", "night.measured"),
        ("position", "INTEGER", "order in the report, from 0"),
        ("axis", "VARCHAR", "name"),
        ("state", "VARCHAR", "measured, absent (no evidence) or inconclusive (too little)"),
        ("measure", "VARCHAR", "what the value is; NULL = not measured"),
        ("unit", "VARCHAR", "of value, floor and anchor; NULL = not measured"),
        *_bounds("value", "the measure"),
        *_bounds("floor", "what it would be without a gap"),
        ("anchor", "DOUBLE", "what it is in the declared bad state; NULL = not judged"),
        *_bounds("gap", "G = 100 (value - floor) / (anchor - floor)"),
        ("n", "INTEGER", "samples"),
        ("note", "VARCHAR", "warnings, or why it was not measured"),
    ),
    table_of(
        "estimate",
        "parameters of the simulator as identified from drives, once per measurement",
        "measured position",
        ("measured", "INTEGER", "night.measured"),
        ("position", "INTEGER", "order of declaration, from 0"),
        ("parameter", "VARCHAR", "name"),
        *_bounds("value", "estimate"),
        ("unit", "VARCHAR", "of the estimate"),
        ("note", "VARCHAR", "warnings, as on identifiability"),
    ),
    table_of(
        "recorded",
        "first night on which each part of the evidence was used; deletions do not change it",
        "name part night",
        ("name", "VARCHAR", "of the nightly configuration"),
        ("part", "VARCHAR", "SHA-256 of a log; the data set's or the run's hash"),
        ("night", "DATE", "that saw it; of several the first counts"),
    ),
    table_of(
        "report",
        "the whole report, once per measurement",
        "measured",
        ("measured", "INTEGER", "night.measured"),
        ("report", "VARCHAR", "JSON, as `s2r gap --json` prints it"),
        ("version", "VARCHAR", "of the program"),
    ),
)


def _withdrawn(name: str, *added: Column) -> Table:
    """A table that keeps the rows of withdrawn nights of another table."""
    table = next(each for each in _MEASURED if each.name == name)
    return Table(
        "withdrawn" if name == "night" else f"withdrawn_{name}",
        f"rows of `{name}` of nights that were taken back",
        (*table.columns, *added),
        table.order,
    )


WITHDRAWN = _withdrawn("night", Column("withdrawn_at", "VARCHAR", "UTC, ISO 8601"))
WITHDRAWN_RECORDED = _withdrawn("recorded")
TABLES: tuple[Table, ...] = (*_MEASURED, WITHDRAWN, WITHDRAWN_RECORDED)

_VIEW = """
    CREATE VIEW gap AS
    SELECT n.name, n.night, n.dataset, n.run, n.outcome, n.threshold, a.axis, a.state,
           a.gap, a.gap_low, a.gap_high, a.gap_reason, a.value, a.value_low, a.value_high,
           a.value_reason, a.unit, a.n
    FROM night n JOIN axis a USING (measured)
    WHERE n.id IN (SELECT max(id) FROM night GROUP BY name, night)
"""

VIEWS: tuple[str, ...] = (_VIEW,)
"""The statements that make the views of a history."""


def statements() -> list[str]:
    """The SQL that makes an empty history, comments included."""
    sql = [statement for table in TABLES for statement in statements_of(table)]
    return [*sql, _VIEW, "COMMENT ON VIEW gap IS 'one row per night that counts and axis'"]
