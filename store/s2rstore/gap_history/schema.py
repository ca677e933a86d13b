"""The history of nightly gaps, as data: every table and column with its type and comment.

SQL NULL stands for what is missing, never NaN.
"""

from __future__ import annotations

from s2rstore.gap_history.gate_status import EXIT_CODES_TEXT
from s2rstore.index.schema import Column, Table, statements_of
from s2rstore.metrics.bootstrap import LEVEL_TEXT

BOUNDS = {
    "": "",
    "_low": f", lower {LEVEL_TEXT} bound",
    "_high": f", upper {LEVEL_TEXT} bound",
}
"""How the columns of a figure and of its interval end, and what is said of each."""


def _bounds(name: str, comment: str) -> tuple[Column, ...]:
    return tuple(
        Column(f"{name}{end}", "DOUBLE", f"{comment}{suffix}") for end, suffix in BOUNDS.items()
    )


_MEASURED: tuple[Table, ...] = (
    Table(
        "night",
        "one row per night that said something new; of several for one night the last counts",
        (
            Column("id", "INTEGER", "order of writing, from 1"),
            Column("name", "VARCHAR", "of the nightly configuration"),
            Column("night", "DATE", "UTC date"),
            Column("key", "VARCHAR", "SHA-256 of all that the figures depend on"),
            Column("evidence", "VARCHAR", "SHA-256 of what was recorded: data set, run, drives"),
            Column("measured", "INTEGER", "id of the night whose figures these are"),
            Column("dataset", "VARCHAR", "name of the environment"),
            Column("dataset_hash", "VARCHAR", "of the store's data set"),
            Column("run", "VARCHAR", "run of the store"),
            Column("run_key", "VARCHAR", "hash of all that its predictions depend on"),
            Column("model", "VARCHAR", "the run's model"),
            Column("expression", "VARCHAR", "which instances were selected"),
            Column(
                "outcome",
                "VARCHAR",
                "PASS, FAIL or INCONCLUSIVE: headline, golden run and age of the evidence; "
                "ERROR = the request does not fit what is there",
            ),
            Column("exit_code", "INTEGER", EXIT_CODES_TEXT),
            Column("headline", "VARCHAR", "PASS, FAIL or INCONCLUSIVE: the worst axis"),
            *_bounds("gap", "G of the worst axis; 0 = no gap, 100 = the declared bad state"),
            Column("worst", "VARCHAR", "the worst axis; NULL = none was judged"),
            Column("threshold", "DOUBLE", "of G"),
            Column("reason", "VARCHAR", "of the headline, or why nothing was measured"),
            Column("golden", "VARCHAR", "PASS, FAIL or INCONCLUSIVE; NULL = no golden run"),
            *_bounds("golden_change", "mean real error against the golden run, m"),
            Column("golden_margin", "DOUBLE", "by which it may have grown, m"),
            Column(
                "evidence_since", "DATE", "first night that saw the newest part of this evidence"
            ),
            Column("evidence_age", "INTEGER", "days from then to this night"),
            Column("stale_after", "DOUBLE", "days from which on evidence is too old"),
            Column("written_at", "VARCHAR", "UTC, ISO 8601"),
        ),
        ("night", "id"),
    ),
    Table(
        "axis",
        "axes of the gap, once per measurement; none where nothing could be measured",
        (
            Column("measured", "INTEGER", "night.measured"),
            Column("position", "INTEGER", "order in the report, from 0"),
            Column("axis", "VARCHAR", "name"),
            Column(
                "state", "VARCHAR", "measured, absent (no evidence) or inconclusive (too little)"
            ),
            Column("measure", "VARCHAR", "what the value is; NULL = not measured"),
            Column("unit", "VARCHAR", "of value, floor and anchor; NULL = not measured"),
            *_bounds("value", "the measure"),
            *_bounds("floor", "what it would be without a gap"),
            Column("anchor", "DOUBLE", "what it is in the declared bad state; NULL = not judged"),
            *_bounds("gap", "G = 100 (value - floor) / (anchor - floor)"),
            Column("n", "INTEGER", "samples"),
            Column("note", "VARCHAR", "warnings, or why it was not measured"),
        ),
        ("measured", "position"),
    ),
    Table(
        "estimate",
        "parameters of the simulator as identified from drives, once per measurement",
        (
            Column("measured", "INTEGER", "night.measured"),
            Column("position", "INTEGER", "order of declaration, from 0"),
            Column("parameter", "VARCHAR", "name"),
            *_bounds("value", "estimate"),
            Column("unit", "VARCHAR", "of the estimate"),
            Column("note", "VARCHAR", "warnings, as on identifiability"),
        ),
        ("measured", "position"),
    ),
    Table(
        "recorded",
        "what was recorded, once per part; what is deleted later makes the rest no newer",
        (
            Column("name", "VARCHAR", "of the nightly configuration"),
            Column("part", "VARCHAR", "SHA-256 of a log; the data set's or the run's hash"),
            Column("night", "DATE", "that saw it; of several the first counts"),
        ),
        ("name", "part", "night"),
    ),
    Table(
        "report",
        "the whole report, once per measurement",
        (
            Column("measured", "INTEGER", "night.measured"),
            Column("report", "VARCHAR", "JSON, as `s2r gap --json` prints it"),
            Column("version", "VARCHAR", "of the program"),
        ),
        ("measured",),
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
        optional=True,
    )


WITHDRAWN = _withdrawn("night", Column("withdrawn_at", "VARCHAR", "UTC, ISO 8601"))
WITHDRAWN_RECORDED = _withdrawn("recorded")
TABLES: tuple[Table, ...] = (*_MEASURED, WITHDRAWN, WITHDRAWN_RECORDED)

_VIEW = """
    CREATE VIEW gap AS
    SELECT n.name, n.night, n.dataset, n.run, n.outcome, n.threshold, a.axis, a.state,
           a.gap, a.gap_low, a.gap_high, a.value, a.value_low, a.value_high, a.unit, a.n
    FROM night n JOIN axis a USING (measured)
    WHERE n.id IN (SELECT max(id) FROM night GROUP BY name, night)
"""

VIEWS: tuple[str, ...] = (_VIEW,)
"""The statements that make the views of a history."""


def statements() -> list[str]:
    """The SQL that makes an empty history, comments included."""
    sql = [statement for table in TABLES for statement in statements_of(table)]
    return [*sql, _VIEW, "COMMENT ON VIEW gap IS 'one row per night that counts and axis'"]
