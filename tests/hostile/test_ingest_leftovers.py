"""Leftovers of interrupted ingests and their removal."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from msgspec import structs

import s2rstore
from bench.support.processes import wait_until
from s2rstore.files import process_identity
from s2rstore.files.ingest_folder import staging_folder, staging_folders
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.writing import ingest_journal
from s2rtui.cli import main
from tests.support import pairs


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    return pairs.manifest(tmp_path / "data", n=4)


def arguments(manifest: Path, store: Path) -> list[str]:
    return ["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"]


def ended_process_id() -> int:
    """The id of a process that has ended."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def make_leftover(store: Path, identity: ProcessIdentity, days: float = 0.0) -> Path:
    """The building folder of a process with a file's folder, both last changed `days` ago."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process_identity, "this_process", lambda: identity)
        folder = staging_folder(store)
    (folder / "frames.zarr").mkdir(parents=True)
    for path in (folder / "frames.zarr", folder):
        os.utime(path, (time.time() - days * 86_400,) * 2)
    return folder


@pytest.mark.parametrize("changes", [None, {"host": "another-host", "process": 7}, {}])
def test_leftovers_of_an_ended_process_alone_are_removed(manifest, tmp_path, capsys, changes):
    store = tmp_path / "s.s2r"
    changed = {"process": ended_process_id()} if changes is None else changes
    identity = structs.replace(process_identity.this_process(), **changed)
    building = make_leftover(store, identity)
    assert main(arguments(manifest, store)) == 0
    assert building.exists() == (changes is not None)
    error = capsys.readouterr().err
    if changes is None:
        assert f"{building}: removed; an interrupted ingest" in error
    else:
        assert f"process {identity.process}" in error
        assert f"rm -r {building}" in error


def abandoned(store: Path) -> set[str]:
    return {folder.path.name for folder in staging_folders(store) if folder.is_abandoned}


def test_the_name_of_a_building_folder_identifies_its_process(tmp_path):
    """Also where the number of a process is used again, by any host, boot or container."""
    store = tmp_path / "s.s2r"
    own, ended = process_identity.this_process(), ended_process_id()
    identities = {
        "running": own,
        "ended": structs.replace(own, process=ended),
        "reused": structs.replace(own, start=own.start - 1),
        "container": structs.replace(own, process=ended, namespace="pid:[1]"),
        "boot": structs.replace(own, process=ended, boot="another"),
        "host": structs.replace(own, process=ended, host="another-host-7"),
    }
    for days in (0.0, 2.0):
        folders = {name: make_leftover(store, each, days) for name, each in identities.items()}
        expected = {"ended", "reused"} | ({"container", "boot"} if days else set())
        assert abandoned(store) == {folders[name].name for name in expected}
        builders = {folder.path: folder.builder for folder in staging_folders(store)}
        assert builders[folders["host"]] == f"process {ended} on another-host-7"
        assert builders[folders["running"]] == f"process {os.getpid()} on {own.host}"
        (folders["boot"] / "frames.zarr" / "new").touch()
        assert folders["boot"].name not in abandoned(store)
        for folder in folders.values():
            shutil.rmtree(folder)


def test_two_ingests_of_one_process_build_in_separate_folders(tmp_path):
    assert staging_folder(tmp_path / "s.s2r") != staging_folder(tmp_path / "s.s2r")


def start_ingest(manifest: Path, store: Path) -> tuple[subprocess.Popen[bytes], Path]:
    """A running ingest and its building folder."""
    process = subprocess.Popen(
        [sys.executable, "-m", "s2rtui", *arguments(manifest, store)], stderr=subprocess.PIPE
    )

    def folders() -> list[Path]:
        return list(store.parent.glob(f".{store.name}.building-*"))

    assert wait_until(lambda: bool(folders()) or process.poll() is not None, 300, interval=0.002)
    return process, folders()[0]


def test_an_interrupted_ingest_says_how_to_resume_it(tmp_path, s2r):
    manifest, store = pairs.manifest(tmp_path / "data", n=300), tmp_path / "s.s2r"
    process, folder = start_ingest(manifest, store)
    wait_for_shards(process, folder)
    process.send_signal(signal.SIGINT)
    error = process.communicate(timeout=300)[1].decode()
    assert process.returncode == 130
    assert error.strip().endswith(
        f"s2r was not created; the same command resumes, and begins anew after: rm -r {folder}"
    )
    assert not store.exists()
    resumed = s2r(*arguments(manifest, store))
    (line,) = (each for each in resumed.err.splitlines() if "is resumed" in each)
    taken = re.search(r"(\d+) of 300 instances are not decoded again", line)
    assert int(taken[1]) >= 64
    assert verify(store) == []
    assert not staging_folders(store)
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == 300


def wait_for_shards(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Wait until some instances lie in complete shards."""
    journal = folder / ingest_journal.NAME

    def has_shards() -> bool:
        assert process.poll() is None
        return journal.exists() and journal.read_bytes().count(b"\n") > 1

    assert wait_until(has_shards, 300, interval=0.002)
