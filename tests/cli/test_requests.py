"""Invalid requests: exit code 2, a one-line message and no partial output."""

import argparse
import errno
import json
import os
import shlex
import sys
from decimal import Decimal
from pathlib import Path

import duckdb
import pytest

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rtools.common.command_line import output
from s2rtui.cli import main

INVALID_REQUESTS = [
    ("query STORE 'ids(all)'", "whole numbers"),
    ("query STORE 'worst(1e30, gap)'", "beyond"),
    ("query STORE '" + " & ".join(["all"] * 2000) + "'", "more than 200 parts"),
    ("query STORE 'heading:90'  --run nobody", "nobody"),
    ("sql STORE ''", "no statement"),
    ("sql STORE 'SELECT 1 AS a, 2 AS a' --json", "twice"),
    ("sql STORE 'SELECT 1' --format parquet", "--out"),
    ("snapshot STORE --keys nosuchkey --out a.txt", "nosuchkey"),
    ("train --recipe vanilla --minutes nan --store STORE", "--minutes"),
    ("ingest csv --store x.s2r", "path"),
    ("ingest world somewhere --store x.s2r", "somewhere"),
    ("ingest world --calibration c.toml --store x.s2r", "--calibration"),
    ("ingest csv m.csv --seed 3 --store x.s2r", "--seed"),
    ("ingest world --factors lights= --store x.s2r", "not a number"),
    ("ingest world --factors lights,lights --store x.s2r", "twice"),
    ("score STORE", "ground truth is unknown"),
    ("score STORE --instances 1", "--instances"),
    ("model pretrained --store STORE", "--seed 1"),
    ("demo --data . --seed 3", "--data"),
    ("ingest csv m.csv --size 0 --store x.s2r", "--size"),
    ("ingest world --factors moon --store x.s2r", "moon"),
    ("query", "required"),
    ("nosuchcommand", "nosuchcommand"),
    ("runs /nowhere/x.s2r", "no such folder"),
    ("query STORE \udcff", "UTF-8"),
    ("export STORE --view adjust --out a.png", "adjust"),
    ("export STORE --view map --out a.gif", ".pdf"),
    ("export STORE --view workbench --out a.svg", ".png"),
    ("export STORE --view map --out a.png --size 10x10", "--size"),
    ("export STORE --view map --out a.png --heat feature_distance", "--on selection"),
    ("export STORE --view map --out a.png --heat occlusion:x", "occlusion:rgb"),
    ("export STORE --view map --out a.png --trajectory c", "one of a, b"),
    ("export STORE --view map --out a.png --iid 40", "0 to 39"),
    ("export STORE --view compare --out a.png --with vanilla", "dataaug"),
    ("export STORE --view list --out a.png --sort rubbish", "real.error"),
    ("export STORE --view instance --out a.png --select none", "selects nothing"),
    ("export STORE --view map --out no/folder/a.png", "cannot be written"),
    ("export STORE --view map --out a.png --width 80 --size 300x300", "--size: pixels; leave it"),
    ("tui STORE --graphics --ascii", "--ascii"),
    ("tui STORE --cell-size 10x20", "--graphics"),
    ("query STORE all --columns iid,rubbish", "rubbish: must be one of iid, seq, x_m"),
    ("query STORE all --columns iid,iid --json", "twice"),
    ("query STORE @nothing", "saved selection"),
]


def test_an_invalid_request_prints_one_line(tiny_store, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command_line, expected in INVALID_REQUESTS:
        words = shlex.split(command_line)
        try:
            code = main([str(tiny_store) if word == "STORE" else word for word in words])
        except SystemExit as stop:
            code = int(stop.code or 0)
        err = capsys.readouterr().err
        assert code == 2, err
        assert err.count("\n") == 1, err
        assert expected in err
        assert not list(tmp_path.iterdir()), command_line


def _write_and_read(
    tmp_path: Path, names: list[str], rows: list[tuple[object, ...]]
) -> list[tuple]:
    target = tmp_path / "out.parquet"
    output.write(names, rows, argparse.Namespace(format="parquet", out=target))
    with duckdb.connect() as connection:
        return connection.execute(f"SELECT * FROM '{target}'").fetchall()


def test_column_names_cannot_inject_sql(tmp_path):
    injected_file = tmp_path / "leak.csv"
    name = f"a\" INTEGER); COPY (SELECT 1) TO '{injected_file}'; CREATE TABLE q (\"b"
    assert _write_and_read(tmp_path, [name], [(1,)]) == [(1,)]
    assert not injected_file.exists()


def test_numbers_keep_their_types_in_parquet(tmp_path):
    rows = [(1, 2**70, Decimal("1.5"), True, None), (2, 1, 2.5, False, "x")]
    assert _write_and_read(tmp_path, list("abcde"), rows) == [
        (1, float(2**70), 1.5, True, None), (2, 1.0, 2.5, False, "x"),
    ]  # fmt: skip


def test_json_has_numbers_and_null(capsys):
    rows = [(Decimal("1.5"), [float("nan"), 1.0], {"k": float("inf")})]
    output.write(["a", "b", "c"], rows, argparse.Namespace(format="json", out=None))
    assert json.loads(capsys.readouterr().out) == [{"a": 1.5, "b": [None, 1.0], "c": {"k": None}}]


def test_a_full_disk_keeps_the_previous_file(tmp_path, monkeypatch):
    def fail_with_no_space(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a.csv").write_text("old")
    monkeypatch.setattr(atomic_writes.os, "fsync", fail_with_no_space)
    with pytest.raises(RequestError, match=r"a\.csv: cannot be written \(No space left"):
        output.write_file(tmp_path / "a.csv", b"new")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_writing_follows_links_and_keeps_pipes(tmp_path):
    (tmp_path / "a.csv").write_text("old")
    (tmp_path / "link").symlink_to("a.csv")
    output.write_file(tmp_path / "link", b"new")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "link").read_bytes() == b"new"
    assert (tmp_path / "link").is_symlink()
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    output.write_file(tmp_path / "pipe", b"rows")
    assert os.read(reader, 10) == b"rows"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


def test_sql_says_how_to_read_times_with_a_time_zone(tiny_store, s2r, monkeypatch):
    monkeypatch.setitem(sys.modules, "pytz", None)  # without it, DuckDB gives no such values
    s2r("sql", tiny_store, "SELECT now()").assert_refused("now()::TIMESTAMP")
    assert s2r("sql", tiny_store, "SELECT now()::TIMESTAMP > '2000-01-01' AS ok", "--json").json
