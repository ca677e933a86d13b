"""Columns of lengths and angles name their units, and equal numbers are equal everywhere."""

import re

import s2rstore
from s2rstore.index import pair_view
from s2rstore.language import evaluation, fields, parse, to_text

UNIT = re.compile(r"_(m|deg|rad|s)$")
PHYSICAL = re.compile(
    r"(^|_|\.| )(x|y|heading|error|gap|shift|curvature|offset|timestamp|from|to|mean|difference)"
    r"(_(error|x|y|m|deg|rad|s))*$"
)
"""Names of lengths, angles and times."""


def assert_units(names: list[str]) -> None:
    assert [name for name in names if PHYSICAL.search(name) and not UNIT.search(name)] == []
    assert [name for name in names if UNIT.search(name)]


def test_columns_of_rows_name_their_units(tiny_store, s2r):
    assert_units(list(s2r("query", tiny_store, "all", "--json").json[0]))
    for view in ("map", "errors", "orientation", "instance", "list", "compare"):
        options = ("--with", "dataaug") if view == "compare" else ()
        shown = s2r("show", tiny_store, view, "--select", "ids(3..8)", *options, "--json").json
        assert_units(list(shown[0]))
    assert_units(list(pair_view.column_comments()))


def test_expressions_take_fields_with_their_units(tiny_store):
    with s2rstore.open(tiny_store) as store:
        for name in fields.NUMERIC:
            named = fields.with_unit(name)
            assert to_text(parse(f"{named} > 1")) == to_text(parse(f"{name} > 1"))
            query, parameters = evaluation.sql(store, f"worst(3, {named}) | {named} > 0.5")
            stored = [row[0] for row in store.execute(query, parameters)]
            chosen = evaluation.select(store, f"worst(3, {name}) | {name} > 0.5")
            assert stored == chosen.nonzero()[0].tolist()
        text = 'run("dataaug").real.error_m > 0.5 & heading_deg:90+-45'
        assert to_text(parse(text)) == 'run("dataaug").real.error > 0.5 & heading:90+-45'


def test_columns_and_sort_take_the_names_that_rows_have(tiny_store, s2r):
    found = []
    for name in ("real.error", "real.error_m", "real_error_m"):
        columns = ["--columns", f"iid,{name}", "--format", "csv"]
        found.append(s2r("query", tiny_store, "all", *columns).lines[1:])
        found.append(s2r("show", tiny_store, "list", "--sort", name, "--format", "csv").lines[1:])
    assert all(found)
    assert found[:2] * 3 == found
