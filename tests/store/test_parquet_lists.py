import os
from pathlib import Path

import duckdb
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rstore.index.parquet_table import read_blobs, read_vectors
from tests.support.refusals import refused


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
