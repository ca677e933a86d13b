"""Queries of stores with rows in files: by plain DuckDB, and by users, who reach nothing else."""

import subprocess
import sys

import duckdb
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index import user_query
from tests.store.conftest import row_file


def test_plain_duckdb_reads_the_index_with_a_search_path(filed):
    index = filed / layout.read_current(filed).index
    script = (
        "import duckdb, sys\n"
        "connection = duckdb.connect(sys.argv[1], read_only=True)\n"
        "connection.execute(f\"SET file_search_path = '{sys.argv[2]}'\")\n"
        "print(connection.execute('SELECT count(*), count(gap_m) FROM pair').fetchall())\n"
        "undescribed = '''SELECT table_name, column_name FROM duckdb_columns() WHERE NOT internal\n"
        "    AND coalesce(comment, '') = '' '''\n"
        "print(connection.execute(undescribed).fetchall())\n"
    )
    command = [sys.executable, "-c", script, str(index), str(index.parent)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd="/").stdout
    assert printed.splitlines() == ["[(80, 80)]", "[]"]


@pytest.mark.parametrize(
    "statement",
    [
        "COPY (SELECT 1) TO '{file}' (FORMAT parquet)",
        "COPY (SELECT 1) TO '{index}' (FORMAT csv)",
        "PREPARE p AS COPY (SELECT 1) TO '{file}' (FORMAT parquet)",
        "EXPLAIN ANALYZE COPY (SELECT 1) TO '{file}' (FORMAT parquet)",
        "COPY (PIVOT room ON room USING count(*)) TO '{file}' (FORMAT parquet)",
        "EXPORT DATABASE '{index}.wal'",
        "ATTACH '{index}.wal' AS other",
        "CREATE TABLE t (a INTEGER)",
        "DELETE FROM run",
        "SET threads = 1",
        "SELECT * FROM read_csv('/etc/hostname')",
        "SELECT * FROM glob('{folder}/*')",
        "SELECT * FROM read_parquet('{folder}/*.parquet')",
    ],
)
def test_queries_of_the_user_reach_nothing_but_the_rows(filed, statement):
    file, index = row_file(filed), filed / layout.read_current(filed).index
    before = {path: path.read_bytes() for path in (file, index)}
    entries = {path.name for path in (filed / "index").iterdir()}
    text = statement.format(file=file, index=index, folder=file.parent)
    with s2rstore.open(filed) as store:
        with pytest.raises(duckdb.Error):
            store.execute(text)
        with pytest.raises(RequestError):
            user_query.run(store.connection(), text, 20.0, 10**9)
    assert {path: path.read_bytes() for path in (file, index)} == before
    assert {path.name for path in (filed / "index").iterdir()} == entries


@pytest.mark.parametrize(
    "statement",
    ["FROM room", "SHOW TABLES", "DESCRIBE pair", "EXPLAIN SELECT * FROM pair", "SUMMARIZE frame",
     "PIVOT room ON room USING count(*)", "SELECT 1; SELECT avg(gap_m) FROM pair"],
)  # fmt: skip
def test_queries_that_read_are_possible(filed, statement):
    with s2rstore.open(filed) as store:
        names, rows = user_query.run(store.connection(), statement, 20.0, 10**9)
    assert names
    assert rows


def test_a_query_for_one_run_reads_its_files_alone(filed):
    with s2rstore.open(filed) as store:
        text = store.execute("EXPLAIN ANALYZE SELECT avg(gap_m) FROM pair WHERE run = 'vanilla'")
        assert "Scanning Files: 1/2" in str(text)
        assert f"dataaug/{row_file(filed, 'dataaug').name}" not in str(text)
