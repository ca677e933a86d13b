"""Leftovers of killed writes are reported and removed; unreadable or unwritable files are named."""

import resource
import subprocess
import sys
from pathlib import Path

from msgspec import structs

from s2rstore.files import process_identity
from s2rstore.files.locks import file_lock
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import check
from s2rtools.precompute.executors.local_executors import ProcessExecutor
from tests.hostile.test_ingest_leftovers import ended_process_id, make_leftover

LEFTOVERS = (
    "frames.zarr/sim/a/rgb/.c.0.0.0.0.0123456789abcdef.partial",
    "runs.zarr/vanilla/key0/activation.real/zarr.0123456789abcdef0123456789abcdef.partial",
    "index/.building-99999999.duckdb",
    ".CURRENT.json.0123456789abcdef.partial",
)


def leave_building_folder(store: Path) -> Path:
    """The folder of an ingest whose process has ended."""
    identity = process_identity.this_process()
    return make_leftover(store, structs.replace(identity, process=ended_process_id()))


def test_leftovers_are_reported_and_removed(store_copy):
    for path in LEFTOVERS:
        (store_copy / path).write_bytes(b"half")
    building = leave_building_folder(store_copy)
    report = check(store_copy)
    assert report.damages == ()
    for path in (*LEFTOVERS, building.name):
        assert any(path in note and "prune" in note for note in report.notes)
    pruned = prune(store_copy)
    assert {*LEFTOVERS, f"../{building.name}"} <= set(pruned.paths)
    assert not any((store_copy / path).exists() for path in LEFTOVERS)
    assert not building.exists()
    assert not [note for note in check(store_copy).notes if "killed" in note]


def test_prune_removes_an_unfinished_ingest_without_a_store(tmp_path):
    building = leave_building_folder(tmp_path / "s.s2r")
    assert prune(tmp_path / "s.s2r").paths == (f"../{building.name}",)
    assert not building.exists()


def test_unfinished_histories_are_removed_unless_one_is_being_written(store_copy):
    history = store_copy / "history" / "gap.jsonl"
    history.parent.mkdir(exist_ok=True)
    leftover = history.with_name(".gap.jsonl.0123456789abcdef.partial")
    leftover.write_bytes(b"half")
    with file_lock(history):
        assert prune(store_copy).paths == ()
    assert leftover.exists()
    assert prune(store_copy).paths == (f"history/{leftover.name}",)
    assert not leftover.exists()


_FULL_DISK_SCRIPT = """
import resource, signal, sys
from argparse import Namespace
from pathlib import Path
import numpy as np
from s2rstore.arrays import array_writer
from s2rtui.cli import execute_command

root = Path(sys.argv[1])
path = root / "runs.zarr/vanilla/key9/large"
array_writer.create(path, array_writer.plan_layout(64, (64, 64), "float32", 64))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
rows = np.random.default_rng(0).random((64, 64, 64)).astype(np.float32)
def write(options):
    array_writer.write_shard(path, 0, rows)
raise SystemExit(execute_command(Namespace(execute=write, debug=False)))
"""


def test_a_full_disk_names_the_file_of_the_store(store_copy):
    assert resource.RLIMIT_FSIZE is not None
    command = [sys.executable, "-c", _FULL_DISK_SCRIPT, str(store_copy)]
    process = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert process.returncode == 2
    assert str(store_copy / "runs.zarr/vanilla/key9/large/c.0.0.0") in process.stderr
    assert "standard output" not in process.stderr
    assert not [note for note in check(store_copy).notes if "killed" in note]


_KILLED_WORKER_SCRIPT = """
import multiprocessing, os, signal
from pathlib import Path
from s2rstore.errors import S2RError
from s2rtools.precompute.executors.executor import Task
from s2rtools.precompute.executors.local_executors import ProcessExecutor

kept = []
class Computation:
    root = Path("s.s2r")
    def open(self, threads):
        kept.append(multiprocessing.get_context("spawn").RLock())
        return work
def work(unit):
    os.kill(os.getpid(), signal.SIGKILL)
if __name__ == "__main__":
    try:
        list(ProcessExecutor(1, 1).run([Task(Computation(), unit) for unit in range(2)]))
    except S2RError as error:
        print(error.exit_code, error)
"""


def test_a_killed_worker_is_reported_in_one_line(tmp_path):
    assert callable(ProcessExecutor)
    (tmp_path / "killed.py").write_text(_KILLED_WORKER_SCRIPT)
    command = [sys.executable, str(tmp_path / "killed.py")]
    process = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert process.stdout.startswith("2 ")
    assert "worker" in process.stdout
    assert process.stderr == ""
