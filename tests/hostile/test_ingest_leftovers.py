"""What interrupted ingests leave, and who removes it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files.layout import read_current
from s2rtui.cli import main
from tests.support import pairs


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


def arguments(manifest: Path, store: Path) -> list[str]:
    return ["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"]


def dead() -> int:
    """The number of a process that has ended."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def leftover(store: Path, host: str, process: int) -> Path:
    folder = store.with_name(f".{store.name}.building-{host}-{process}")
    (folder / "frames.zarr").mkdir(parents=True)
    return folder


def test_what_a_dead_process_left_is_removed_and_told(
    manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "s.s2r"
    left = leftover(store, socket.gethostname(), dead())
    assert main(arguments(manifest, store)) == 0
    assert not left.exists()
    assert f"{left}: removed; an interrupted ingest" in capsys.readouterr().err


@pytest.mark.parametrize(("host", "living"), [("another-host", False), (None, True)])
def test_what_may_belong_to_a_living_process_stays_and_is_told(
    manifest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], host: str | None,
    living: bool,
) -> None:  # fmt: skip
    store = tmp_path / "s.s2r"
    number = os.getppid() if living else dead()
    left = leftover(store, host or socket.gethostname(), number)
    assert main(arguments(manifest, store)) == 0
    assert left.exists()
    told = capsys.readouterr().err
    assert f"process {number}" in told
    assert f"rm -r {left}" in told


def started(manifest: Path, store: Path) -> tuple[subprocess.Popen[bytes], Path]:
    """An ingest in the midst of its work, and the folder that it builds in."""
    process = subprocess.Popen(
        [sys.executable, "-m", "s2rtui", *arguments(manifest, store)], stderr=subprocess.PIPE
    )
    until = time.monotonic() + 60
    while time.monotonic() < until:
        found = list(store.parent.glob(f".{store.name}.building-*"))
        if found:
            return process, found[0]
        assert process.poll() is None
        time.sleep(0.002)
    raise AssertionError("does not begin")


def test_an_interrupted_ingest_keeps_nothing_and_says_so(tmp_path: Path) -> None:
    manifest, store = pairs.manifest(tmp_path / "data", n=150), tmp_path / "s.s2r"
    process, folder = started(manifest, store)
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 130
    assert told.strip().endswith("s2r was not created")
    assert not store.exists()
    assert not folder.exists()


def test_a_killed_ingest_leaves_nothing_that_looks_like_a_store(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest, store = pairs.manifest(tmp_path / "data", n=150), tmp_path / "s.s2r"
    process, folder = started(manifest, store)
    process.kill()
    process.communicate(timeout=60)
    assert not store.exists()
    assert socket.gethostname() in folder.name
    with pytest.raises(RequestError, match="not a store"):
        read_current(folder)
    assert main(arguments(manifest, store)) == 0
    assert not folder.exists()
    assert "removed; an interrupted ingest" in capsys.readouterr().err
