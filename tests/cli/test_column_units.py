"""Columns of lengths and angles name their units, and equal numbers are equal everywhere."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

import s2rstore
from s2rstore.index import pair_view
from s2rstore.language import evaluation, fields, parse, to_text
from s2rtui.cli import main

UNIT = re.compile(r"_(m|deg|rad|s)$")
PHYSICAL = re.compile(
    r"(^|_|\.| )(x|y|heading|error|gap|shift|curvature|offset|timestamp|from|to|mean|difference)"
    r"(_(error|x|y|m|deg|rad|s))*$"
)
"""Names of lengths, angles and times."""
TO_DEGREES = {"rad": 180 / math.pi, "m": 1.0, "deg": 1.0, "s": 1.0}


@pytest.fixture
def rows(tiny_store: Path, capsys):
    """A function that returns the rows of a command on the tiny store."""

    def of(*arguments: str) -> list[dict[str, Any]]:
        assert main([arguments[0], str(tiny_store), *arguments[1:], "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return of


def assert_units(names: list[str]) -> None:
    assert [name for name in names if PHYSICAL.search(name) and not UNIT.search(name)] == []
    assert [name for name in names if UNIT.search(name)]


def test_columns_of_rows_name_their_units(rows):
    assert_units(list(rows("query", "all")[0]))
    for view in ("map", "errors", "orientation", "instance", "list", "compare"):
        options = ("--with", "dataaug") if view == "compare" else ()
        shown = rows("show", view, "--select", "ids(3..8)", *options)
        assert_units(list(shown[0]))
    assert_units(list(pair_view.column_comments()))


def test_query_and_sql_agree_after_conversion(rows):
    queried = rows("query", "all")
    stored = rows("sql", "SELECT * FROM pair WHERE run = 'vanilla' ORDER BY iid")
    shown = rows("show", "map", "--select", "all")
    assert len(queried) == len(stored) == len(shown) == 40
    for table in (queried, shown):
        for name in table[0]:
            if (unit := UNIT.search(name)) is None:
                continue
            stem = name[: unit.start()]
            (column,) = [c for c in stored[0] if UNIT.search(c) and UNIT.sub("", c) == stem]
            factor = TO_DEGREES[UNIT.search(column)[1]]
            for row, truth in zip(table, stored, strict=True):
                assert row[name] == pytest.approx(truth[column] * factor, rel=1e-12)


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


def test_columns_and_sort_take_the_names_that_rows_have(tiny_store, capsys):
    found = []
    for name in ("real.error", "real.error_m", "real_error_m"):
        columns = ["--columns", f"iid,{name}", "--format", "csv"]
        assert main(["query", str(tiny_store), "all", *columns]) == 0
        found.append(capsys.readouterr().out.splitlines()[1:])
        assert main(["show", str(tiny_store), "list", "--sort", name, "--format", "csv"]) == 0
        found.append(capsys.readouterr().out.splitlines()[1:])
    assert all(found)
    assert found[:2] * 3 == found
