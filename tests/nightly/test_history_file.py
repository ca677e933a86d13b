"""The history file stays consistent under concurrent readers and killed writers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import duckdb
import numpy as np
import pytest

from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.gap_history import reader as history
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rtools.nightly.run import nightly
from tests.nightly.conftest import files
from tests.support import nights
from tests.support.nights import day

pytestmark = pytest.mark.usefixtures("constant_plot")


def test_duckdb_reads_the_history_with_nulls_for_missing_values(recorded_week):
    history_file = f"read_json('{recorded_week.config.history}')"
    mass = duckdb.sql(
        f"SELECT DISTINCT e.value, e.value_low FROM (SELECT unnest(estimates) AS e FROM "
        f"{history_file}) WHERE e.parameter = 'mass'"
    )
    assert mass.fetchall() == [(12.0, None)]
    red = duckdb.sql(
        "SELECT night, a.gap FROM (SELECT night, threshold, unnest(axes) AS a FROM "
        f"{history_file}) WHERE a.axis = 'task' AND a.gap_low > threshold ORDER BY night"
    )
    assert [night for night, _ in red.fetchall()] == [day(5), day(6), day(7)]


def test_every_field_of_a_record_is_described(recorded_week):
    line = json.loads(recorded_week.config.history.read_text().splitlines()[0])
    described = {name: kind for name, kind, _ in history.record_fields(history.Night)}
    assert set(line) == {*described, "report", "crc32"}
    assert described["gap_low"] == "DOUBLE"
    assert described["axes"] == "STRUCT[]"


def test_every_damaged_byte_is_noticed(recorded_week, tmp_path):
    content = recorded_week.config.history.read_bytes()
    path = tmp_path / "gap.jsonl"
    for at in np.random.default_rng(0).integers(0, len(content), 60).tolist():
        path.write_bytes(content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :])
        with pytest.raises(RequestError, match=r"line \d is damaged"):
            history.read(path)


def test_the_history_contains_the_complete_report(recorded_week):
    loaded = history.read(recorded_week.config.history)
    last = loaded.of_configuration("lab")[-1]
    report = json.loads(history.report_text(recorded_week.config.history, last.measured))
    assert report["verdict"]["gap"] == last.gap.value
    assert [entry["gap"] for entry in report["axes"]] == [axis.gap.value for axis in last.axes[:3]]


def test_verify_and_prune_accept_a_history(week):
    week.night(1)
    content = week.config.history.read_bytes()
    assert verify(week.config.store) == []
    prune(week.config.store, keep=1)
    assert week.config.history.read_bytes() == content


def test_a_repeated_night_restores_missing_files(week):
    week.night(1)
    complete = files(week.config)
    folder = week.config.reports / str(day(1))
    (folder / "junit.xml").unlink()
    (folder / "report.md").write_text("ha")
    assert week.config.metrics is not None
    week.config.metrics.unlink()
    (week.config.reports / "latest").unlink()
    leftover = week.config.history.with_name(".gap.jsonl.0123456789abcdef.partial")
    leftover.write_bytes(b"half")
    night_run = week.night(1, new_log=False)
    assert not night_run.new
    names = {path.name for path in night_run.written}
    assert names == {"junit.xml", "report.md", "gap.prom", "latest"}
    assert {path: text for path, (text, _) in files(week.config).items() if path != leftover} == {
        path: text for path, (text, _) in complete.items()
    }
    week.night(2)
    assert not leftover.exists()


_KILLED_NIGHT_SCRIPT = """
import os, signal, sys
from dataclasses import replace
from pathlib import Path
from s2rstore.gap_history import writer
from s2rtools.nightly import config
from tests.support import nights
{patch}
week = nights.Week(config.read(Path(sys.argv[1])), {{}}, 9)
week.night(2)
"""
_DIE = "os.kill(os.getpid(), signal.SIGKILL)"


@pytest.mark.parametrize(
    ("patch", "expected_nights"),
    [
        pytest.param(f"writer.reader.line_of = lambda *a: {_DIE}", 1, id="while adding"),
        pytest.param(f"Path.replace = lambda *a: {_DIE}", 1,
                     id="before the rename", marks=pytest.mark.deep),
        pytest.param(f"writer.atomic_writes.sync_path = lambda path: {_DIE}", 2,
                     id="after the rename", marks=pytest.mark.deep),
        pytest.param(f"import s2rtools.nightly.publish as p; p.junit = lambda *a: {_DIE}", 2,
                     id="while telling", marks=pytest.mark.deep),
    ],
)  # fmt: skip
def test_a_killed_writer_loses_at_most_the_current_night(week, patch, expected_nights):
    week.config = replace(week.config, sysid=None)
    week.night(1)
    code = _KILLED_NIGHT_SCRIPT.format(patch=patch)
    process = subprocess.run([sys.executable, "-c", code, str(week.config.source)], check=False,
                          cwd=Path(__file__).parents[2], env={**os.environ, "PYTHONPATH":
                          os.pathsep.join(sys.path)}, capture_output=True)  # fmt: skip
    assert process.returncode == -signal.SIGKILL, process.stderr.decode()
    assert len(history.read(week.config.history).of_configuration("lab")) == expected_nights
    assert week.night(2, new_log=False).night.night == day(2)
    assert len(history.read(week.config.history).of_configuration("lab")) == 2
    assert {path.name for path in week.config.history.parent.iterdir()} == {"gap.jsonl"}


def test_a_night_whose_lock_was_taken_over_is_not_recorded(week, monkeypatch):
    week.night(1)
    before = files(week.config)
    line_of = history.line_of

    def add_and_lose_the_lock(*arguments) -> bytes:
        lock = week.config.history.with_name(".gap.jsonl.lock")
        lock.unlink()
        lock.write_text("another holder")
        return line_of(*arguments)

    monkeypatch.setattr(history, "line_of", add_and_lose_the_lock)
    with pytest.raises(StoreBusyError, match="run the command again"):
        week.night(2)
    assert files(week.config) == before


def test_temporary_links_of_killed_processes_are_removed(week):
    leftovers = [week.config.reports / f".latest.{digit * 16}" for digit in "0a"]
    unrelated = week.config.reports / ".latest.txt"
    week.config.reports.mkdir(parents=True, exist_ok=True)
    leftovers[0].symlink_to("2026-01-01")
    (leftovers[1] / "folder").mkdir(parents=True)
    unrelated.touch()
    week.night(1)
    assert not any(path.exists() or path.is_symlink() for path in leftovers)
    assert unrelated.exists()


def test_readers_see_complete_nights_during_writes(week):
    week.night(1)
    stop, counts, errors = threading.Event(), [], []

    def read() -> None:
        while not stop.is_set():
            try:
                loaded = history.read(week.config.history).of_configuration("lab")
                counts.append(len(loaded))
                assert all(len(night.axes) == 4 for night in loaded)
            except Exception as error:
                errors.append(error)

    reader = threading.Thread(target=read)
    reader.start()
    for number in range(2, 6):
        week.night(number)
    stop.set()
    reader.join()
    assert errors == []
    assert counts == sorted(counts)


def test_two_simultaneous_runs_add_one_night(week):
    barrier = threading.Barrier(2)

    def measure(store, config) -> dict:
        barrier.wait(30)
        return nights.report(store, {"task": 5.0})

    with ThreadPoolExecutor(2) as pool:
        nights_run = pool.map(
            lambda _: nightly(week.config, day(1), measure, week.estimate), range(2)
        )
    assert sorted(night_run.new for night_run in nights_run) == [False, True]
    assert len(history.read(week.config.history).nights) == 1


@pytest.mark.parametrize(
    "content",
    [
        b"", b"no history", b"{}\n", b'{"id": 1, "crc32": 3}\n',
        *map(history.checked_line, [b"[1]", b'{"id": "\xff"}', b'{"id": ' + 10_000 * b"["]),
    ],
    ids=range(7),
)  # fmt: skip
def test_an_invalid_history_file_is_rejected(tmp_path, content):
    path = tmp_path / "h.jsonl"
    path.write_bytes(content)
    with pytest.raises(RequestError, match=r"h\.jsonl: .*no history that this version reads"):
        history.read(path)


@pytest.mark.parametrize(
    ("changes", "field"),
    [({"id": "1"}, "id"), ({"axes": 3}, "axes"), ({"night": "today"}, "night"),
     ({"axes": [{"axis": "task"}]}, "state"), ({"gap_low": "x"}, "gap"),
     ({"exit_code": 10**400}, "exit_code")],
)  # fmt: skip
def test_a_record_of_other_types_is_rejected(recorded_week, tmp_path, changes, field):
    line = json.loads(recorded_week.config.history.read_text().splitlines()[0])
    line.pop("crc32")
    path = tmp_path / "gap.jsonl"
    path.write_bytes(history.checked_line(json.dumps(line | changes).encode()))
    with pytest.raises(RequestError, match=rf"{field}: no history that this version reads"):
        history.read(path)
