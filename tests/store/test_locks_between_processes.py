"""Processes that are killed, suspended or simultaneous never hold one lock together."""

import os
import signal
import subprocess
import sys

import pytest

import s2rstore
from s2rstore.errors import StoreBusyError
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.files.locks import compute_lock, publish_lock
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from tests.support.lock_clock import LockClock


def start(script: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def wait_for_line(process: subprocess.Popen[str]) -> None:
    line = process.stdout.readline()
    assert line == "inside\n", process.communicate()


_TAKERS_SCRIPT = """
import os, sys
from pathlib import Path
from s2rstore.files.locks import compute_lock
root, rounds = Path(sys.argv[1]), int(sys.argv[2])
print("inside", flush=True)
sys.stdin.readline()
for _ in range(rounds):
    child = os.fork()
    if child == 0:
        status = 1
        try:
            with compute_lock(root, timeout=100.0) as lease:
                os.close(os.open(root / "in use", os.O_CREAT | os.O_EXCL))
                lease.check()
                with open(root / "log", "a") as log:
                    log.write("x")
                os.unlink(root / "in use")
                status = 0
                os._exit(0)  # without releasing the lock
        finally:
            os._exit(status)
    if os.waitpid(child, 0)[1]:
        raise SystemExit(1)
"""


def test_of_several_takers_of_a_stale_lock_one_gets_it(tmp_path):
    processes = [start(_TAKERS_SCRIPT, tmp_path, 12) for _ in range(3)]
    for process in processes:
        wait_for_line(process)
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    for process in processes:
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
    assert (tmp_path / "log").read_text() == "x" * 36
    assert {path.name for path in (tmp_path / "ledger").iterdir()} == {"compute.lock"}


_PUBLISH_SCRIPT = """
import sys
from pathlib import Path
from s2rstore.errors import StoreBusyError
from s2rstore.index.transaction import edit
try:
    with edit(Path(sys.argv[1])) as draft:
        draft.set_provenance("writer", {"name": "suspended"})
        print("inside", flush=True)
        sys.stdin.readline()
except StoreBusyError as error:
    print(error)
"""


def suspend(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)


def resume(process: subprocess.Popen[str]) -> str:
    process.send_signal(signal.SIGCONT)
    output, errors = process.communicate("\n", timeout=300)
    assert process.returncode == 0, errors
    return output


@pytest.mark.parametrize("publishes", [True, False], ids=["has published", "still holds the lock"])
def test_a_suspended_process_publishes_nothing_after_its_lock_was_taken_over(store_copy, publishes):
    process = start(_PUBLISH_SCRIPT, store_copy)
    wait_for_line(process)
    suspend(process)
    before = layout.read_current(store_copy).generation
    with publish_lock(store_copy, 1000.0, LockClock().timing) as lease:
        if not publishes:
            assert "taken over by process" in resume(process)
            lease.check()
    if publishes:
        with edit(store_copy) as draft:
            draft.set_provenance("writer", {"name": "taker"})
        assert "run the command again" in resume(process)
    assert layout.read_current(store_copy).generation == before + publishes
    with s2rstore.open(store_copy) as store:
        assert store.provenance("writer") == ({"name": "taker"} if publishes else {})
    assert verify(store_copy) == []
    assert not [path for path in (store_copy / "index").iterdir() if path.name.startswith(".")]


def test_a_process_that_lost_a_further_lock_publishes_nothing(store_copy):
    before = layout.read_current(store_copy)

    def publish() -> None:
        with compute_lock(store_copy) as lease, edit(store_copy, lease.check) as draft:
            draft.set_provenance("writer", {"name": "lost"})
            with compute_lock(store_copy, 1000.0, timing=LockClock().timing):
                pass

    with pytest.raises(StoreBusyError, match="compute lock"):
        publish()
    assert layout.read_current(store_copy) == before


_LEDGER_SCRIPT = """
import os, socket, sys
from pathlib import Path
from s2rstore.files.ledger import Ledger
os.getpid, socket.gethostname = lambda: 7, lambda: "lab"
Ledger(Path(sys.argv[1])).add(sys.argv[2], [("file", 1)])
"""


def test_processes_with_one_id_on_two_hosts_of_one_name_write_separate_ledger_files(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    for key in ("first", "second"):
        process = start(_LEDGER_SCRIPT, tmp_path, key)
        assert process.communicate(timeout=300) == ("", "")
    assert len(list((tmp_path / "ledger").glob("lab-*.jsonl"))) == 2
    assert {entry.key for entry in Ledger(tmp_path).entries()} == {"first", "second"}
