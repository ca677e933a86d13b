"""Commands on a store whose pairs have instances of one side beside them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from s2rstore.maintenance.verify import verify
from s2rtui.cli import main
from tests.support.copies import copy_store
from tests.support.one_side import append_side

PAIRS, SIM, REAL = 40, 100, 7
COMMANDS = (
    *(("show", view) for view in ("overview", "recall", "rooms", "umap", "orientation", "errors",
                                  "scatter", "shares", "map", "compare")),
    ("findings",), ("runs",), ("gap",),
)  # fmt: skip


OF_STORE = ("no image on one side", '"hash"', '"note"', '"generation"', '"dataset')
"""Words of lines about the store, which an append changes."""


@pytest.fixture(scope="module")
def mixed(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = copy_store(tiny_store, tmp_path_factory.mktemp("mixed") / "tiny.s2r")
    append_side(path, "sim", SIM, "renders")
    append_side(path, "real", REAL, "photos")
    return path


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_figures_are_those_of_the_pairs_alone(tiny_store, mixed, capsys, command):
    printed = []
    for store in (tiny_store, mixed):
        name, *view = command
        code = main([name, str(store), *view, "--json"])
        text = capsys.readouterr().out.replace(str(store), "STORE")
        lines = [line for line in text.splitlines() if not any(word in line for word in OF_STORE)]
        printed.append((code, lines))
    assert printed[0] == printed[1]
    assert printed[0][1]


def test_a_query_lists_instances_of_one_side_and_counts_them_apart(mixed, capsys):
    assert verify(mixed) == []
    for expression, count in (
        ("all", PAIRS + SIM + REAL), ("has:sim", PAIRS + SIM), ("has:real", PAIRS + REAL),
        ("paired", PAIRS), ("traj:photos", REAL), ("worst15", 6),
    ):  # fmt: skip
        assert main(["query", str(mixed), expression, "--count"]) == 0
        assert capsys.readouterr().out == f"{count}\n", expression
    assert main(["query", str(mixed), "traj:renders | ids(3)", "--json", "--with-expression"]) == 0
    output = capsys.readouterr()
    assert f"1 of {PAIRS} pairs, {SIM} sim only instances of run vanilla" in output.err
    document = json.loads(output.out)
    assert document["unpaired"] == f"{SIM} sim only"
    rows = document["instances"]
    assert len(rows) == SIM + 1
    assert rows[0]["real_error_m"] > 0
    assert rows[1] | {"sim_error_m": None, "real_error_m": None, "gap_m": None} == rows[1]
    assert (
        main(["query", str(mixed), "ids(39..40)", "--columns", "iid,has", "--format", "csv"]) == 0
    )
    assert capsys.readouterr().out.split() == ["iid,has", "39,real", "sim", "40,sim"]


def test_reports_and_figures_say_what_is_missing(mixed, tmp_path, capsys):
    report = tmp_path / "r.html"
    assert main(["report", str(mixed), "--select", "!paired", "--out", str(report)]) == 0
    text = report.read_text()
    assert f"0 of {PAIRS} pairs, {SIM} sim only, {REAL} real only instances" in text
    assert "No selected instance has images of both sides." in text
    capsys.readouterr()
    assert main(["show", str(mixed), "instance", "--iid", str(PAIRS + SIM)]) == 0
    assert "no sim image of this instance" in capsys.readouterr().out
