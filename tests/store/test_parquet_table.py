"""Columns, lists and records of Parquet files from outside."""

import os
from pathlib import Path

import duckdb
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rstore.index import parquet_table
from s2rstore.index.parquet_table import read_blobs, read_columns, read_vectors
from tests.support.refusals import refused


def write(path: Path, query: str) -> Path:
    with duckdb.connect() as connection:
        connection.execute(f"COPY ({query}) TO '{path}' (FORMAT parquet)")
    return path


def test_numbers_and_texts_of_every_type(tmp_path):
    file = write(
        tmp_path / "p.parquet",
        """SELECT * FROM (VALUES
           (1::BIGINT, 1.5::FLOAT, '2', TIMESTAMP '2001-01-01 00:00:01.25', 'a'),
           (NULL, NULL, 'x', NULL, NULL), (3, 'inf'::FLOAT, '4e1', TIMESTAMP '1970-01-01', ''))
           t(iid, x, y, time, side)""",
    )
    found = read_columns(file, ("iid", "x", "y", "time", "z"), ("side", "image"))
    assert list(found) == ["iid", "x", "y", "time", "side"]
    nan = np.nan
    for name, expected in (("iid", [1, nan, 3]), ("x", [1.5, nan, np.inf]), ("y", [2, nan, 40]),
                           ("time", [978307201.25, nan, 0])):  # fmt: skip
        assert found[name].dtype == np.float64
        np.testing.assert_array_equal(found[name], expected)
    assert found["side"].tolist() == ["a", "", ""]


def test_rows_keep_the_order_of_the_file(tmp_path):
    file = write(tmp_path / "p.parquet", "SELECT 7919 * range % 300007 AS iid FROM range(300000)")
    expected = 7919 * np.arange(300_000) % 300_007
    np.testing.assert_array_equal(read_columns(file, ["iid"], [])["iid"], expected)


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" + bytes(100) + b"PAR1", b"a,b\n1,2\n"])
def test_other_files_are_refused_in_one_line(tmp_path, content):
    file = tmp_path / "p.parquet"
    file.write_bytes(content)
    with refused("p.parquet: "):
        read_columns(file, ["iid"], [])
    for path in (tmp_path / "none.parquet", tmp_path):
        with refused():
            read_columns(path, ["iid"], [])


def test_a_pattern_in_a_name_reads_no_other_file(tmp_path):
    write(tmp_path / "a.parquet", "SELECT 1 AS iid")
    (tmp_path / "*.parquet").write_bytes(b"no Parquet")
    with pytest.raises(RequestError):
        read_columns(tmp_path / "*.parquet", ["iid"], [])


def test_too_many_rows_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(parquet_table, "MAX_ROWS", 3)
    file = write(tmp_path / "p.parquet", "SELECT range AS iid FROM range(4)")
    with pytest.raises(RequestError, match="more than 3 rows; split it"):
        read_columns(file, ["iid"], [])


def test_a_file_without_the_columns_gives_none(tmp_path):
    assert read_columns(write(tmp_path / "p.parquet", "SELECT 1 AS foo"), ["iid"], []) == {}


def test_names_of_columns_may_have_quotes(tmp_path):
    names = """a"b""", """') AS x, (SELECT 1) AS \"y"""
    quoted = ['"' + name.replace('"', '""') + '"' for name in names]
    file = write(tmp_path / "p.parquet", f"SELECT 1.5 AS {quoted[0]}, 'text' AS {quoted[1]}")
    found = read_columns(file, names[:1], names[1:])
    assert {name: values.tolist() for name, values in found.items()} == {
        names[0]: [1.5], names[1]: ["text"],
    }  # fmt: skip


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "it's.parquet"
    with duckdb.connect() as connection:
        columns = "state FLOAT[], fixed FLOAT[2], image STRUCT(bytes BLOB, path VARCHAR)"
        connection.execute(f"CREATE TABLE t ({columns})")
        connection.executemany(
            "INSERT INTO t VALUES (?, ?, ?)",
            [
                ([1.0, 2.0, 3.0], [4.0, 5.0], {"bytes": b"one", "path": "1"}),
                ([1.5, None], [6.0, 7.0], {"bytes": None, "path": "2"}),
                (None, [8.0, 9.0], None),
                ([0.25, 0.5, 0.75], [0.0, 1.0], {"bytes": b"\0\xff", "path": "4"}),
            ],
        )
        connection.execute('ALTER TABLE t RENAME state TO "the ""state"""')
        connection.execute(f"COPY t TO '{str(path).replace(chr(39), chr(39) * 2)}'")
    return path


def test_elements_of_lists_are_nan_where_there_is_no_number(table):
    nan = np.nan
    np.testing.assert_array_equal(
        read_vectors(table, 'the "state"', [2, 0, 1]),
        [[3, 1, 2], [nan, 1.5, nan], [nan] * 3, [0.75, 0.25, 0.5]],
    )
    np.testing.assert_array_equal(read_vectors(table, "fixed", [1])[:, 0], [5, 7, 9, 1])


def test_bytes_of_records_by_row(table):
    assert read_blobs(table, "image", "bytes", 0, 10) == [b"one", b"", b"", b"\0\xff"]
    assert read_blobs(table, "image", "bytes", 3, 10) == [b"\0\xff"]
    assert read_blobs(table, "image", "bytes", 4, 10) == []


def test_what_cannot_be_read_ends_in_one_line(table, tmp_path):
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(table.read_bytes()[:-20])
    pipe = tmp_path / "pipe.parquet"
    os.mkfifo(pipe)
    for path, column in ((table, "none"), (table, "image"), (damaged, "fixed"), (pipe, "fixed")):
        with refused(str(path)):
            read_vectors(path, column, [0])
    with pytest.raises(RequestError, match="cannot be read"):
        read_blobs(table, "fixed", "bytes", 0, 1)
