"""Queries of stores with rows in files: by plain DuckDB, and by users, who reach nothing else."""

import shutil
from pathlib import Path

import duckdb
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index import schema, user_query
from tests.store.conftest import row_file


@pytest.fixture(params=["filed", "store_copy"], ids=["rows in files", "rows in the index"])
def path(request: pytest.FixtureRequest) -> Path:
    """A private copy of the store in either form."""
    return request.getfixturevalue(request.param)


def test_plain_duckdb_reads_the_index_and_finds_all_described(path, tmp_path):
    index = path / layout.read_current(path).index
    copy = shutil.copy(index, tmp_path)  # DuckDB opens a file only once per process
    columns = "SELECT table_name, column_name, comment FROM duckdb_columns() WHERE NOT internal"
    tables = "SELECT table_name, comment FROM duckdb_tables() WHERE NOT internal"
    with duckdb.connect(str(copy), read_only=True) as plain:
        plain.execute(f"SET file_search_path = '{index.parent}'")
        assert plain.execute("SELECT count(*), count(gap_m) FROM pair").fetchall() == [(80, 80)]
        for query in (columns, tables):
            assert [row for row in plain.execute(query).fetchall() if not row[-1]] == []
        databases = "SELECT tags FROM duckdb_databases() WHERE NOT internal"
        assert schema.STORAGE_VERSION in str(plain.execute(databases).fetchall())


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
        "SET enable_external_access = true",
        "INSTALL httpfs",
        "SELECT * FROM read_csv('/etc/hostname')",
        "SELECT * FROM glob('{folder}/*')",
        "SELECT * FROM read_parquet('{folder}/*.parquet')",
    ],
)
def test_queries_of_the_user_reach_nothing_but_the_rows(path, statement):
    index = path / layout.read_current(path).index
    file = next((index.parent / "rows").rglob("*.parquet"), index.with_name("rows.parquet"))
    before = {each: each.read_bytes() for each in index.parent.rglob("*") if each.is_file()}
    text = statement.format(file=file, index=index, folder=file.parent)
    with s2rstore.open(path) as store:
        with pytest.raises(duckdb.Error):
            store.execute(text)
        with pytest.raises(RequestError):
            user_query.run(store.connection(), text, 20.0, 10**9)
    after = {each: each.read_bytes() for each in index.parent.rglob("*") if each.is_file()}
    assert after == before


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
