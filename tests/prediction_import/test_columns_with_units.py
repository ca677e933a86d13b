"""Rows of view `pair` can be imported by columns that name their units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import s2rstore
from s2rtools.prediction_import.prediction_table import read_table
from s2rtui.cli import main


def export(store: Path, columns: str, out: Path) -> Path:
    query = f"SELECT {columns} FROM pair WHERE run = 'vanilla' ORDER BY iid"
    assert main(["sql", str(store), query, "--format", "csv", "--out", str(out)]) == 0
    return out


def test_rows_with_units_give_the_stored_poses(tiny_store, store_copy, tmp_path):
    file = export(tiny_store, "* EXCLUDE (run)", tmp_path / "rows.csv")
    words = ["run", "import", "again", "--predictions", str(file), "--store", str(store_copy)]
    assert main(words) == 0
    query = (
        "SELECT x, y, cos(heading), sin(heading) FROM prediction WHERE run = ? ORDER BY side, iid"
    )
    with s2rstore.open(store_copy) as store:
        found, expected = (np.array(store.execute(query, [run])) for run in ("again", "vanilla"))
    assert len(found) == 80
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_column_with_its_unit_is_preferred(tmp_path):
    file = tmp_path / "rows.csv"
    file.write_text("iid,side,x,y,heading,x_m,y_m,heading_rad\n0,sim,7,7,7,1,2,3\n")
    table = read_table(file)
    assert {name: table.numbers[name].tolist() for name in ("x", "y", "heading_rad")} == {
        "x": [1.0], "y": [2.0], "heading_rad": [3.0],
    }  # fmt: skip
    assert "heading" not in table.numbers
