"""Runs saved in the background: equal to the command's, cancellable, and free of leftovers."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support.processes import wait_until
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import locks
from s2rstore.maintenance.verify import verify
from s2rtools.adjustments import make_chain
from s2rtools.precompute.run_registration import add_run, drop_run
from s2rtui.cli import main
from s2rtui.jobs.command_job import CommandJob
from s2rtui.jobs.precompute_job import precompute_job, save_run
from tests.support.copies import copy_store

UNADJUSTED: dict[str, list] = {"sim": [], "real": []}


def test_a_saved_run_equals_the_one_of_the_command_line(few_pairs_store, tmp_path):
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    chain = {
        "sim": make_chain("sim", {"contrast": 1.2}),
        "real": make_chain("real", {"contrast": 0.9, "brightness": 1.15}),
    }
    with s2rstore.open(path) as reader:
        job = save_run(path, "saved", "vanilla", chain)
        updates = list(job.follow())
        assert updates[-1] == job.progress
        assert (updates[-1].outcome, updates[-1].fraction) == ("done", 1.0)
        assert [p.is_running for p in updates] == [True] * (len(updates) - 1) + [False]
        fractions = [p.fraction for p in updates]
        assert fractions == sorted(fractions)
        assert len(set(fractions)) > 3
        assert "saved" not in reader.runs
    arguments = ["--adjust", "real:brightness=1.15,contrast=0.9", "--store", str(path),
             "--adjust", "sim:contrast=1.2"]  # fmt: skip
    assert main(["run", "add", "typed", "--model", "vanilla", *arguments]) == 0
    assert main(["precompute", str(path), "--run", "typed"]) == 0
    with s2rstore.open(path) as store:
        assert store.run("saved").key == store.run("typed").key
        assert len(store.array_kinds("saved")) == len(store.array_kinds("typed"))
        for record in store.array_kinds("saved"):
            names = record.kind, record.side, record.mode
            array, other_array = (store.array(run, *names)[1][:] for run in ("saved", "typed"))
            assert np.asarray(array).tobytes() == np.asarray(other_array).tobytes(), names
        rows = "SELECT * EXCLUDE (run) FROM prediction WHERE run = ? ORDER BY side, iid"
        assert store.execute(rows, ["saved"]) == store.execute(rows, ["typed"])
    assert verify(path) == []


def wait_for_stage(job: CommandJob, stage: str) -> None:
    deadline = time.monotonic() + 60
    for progress in job.follow():
        assert time.monotonic() < deadline
        if progress.stage.startswith(stage):
            return
    raise AssertionError(job.progress)


def test_a_job_ends_when_the_application_is_killed(few_pairs_store, tmp_path):
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    add_run(path, "saved", "vanilla", None, None, UNADJUSTED)
    code = (
        "import sys; from pathlib import Path\n"
        "from s2rtui.jobs.precompute_job import precompute_job\n"
        "saving = precompute_job(Path(sys.argv[1]), 'saved', 3)\n"
        "shown = saving.follow(); next(shown); next(shown)\n"
        "print(saving._process.pid, flush=True); list(shown)"
    )
    command = [sys.executable, "-c", code, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as application:
        child = int(application.stdout.readline())
        os.kill(child, signal.SIGSTOP)  # the job must not finish earlier
        application.kill()
        application.wait()
    os.kill(child, signal.SIGCONT)
    assert wait_until(lambda: not Path(f"/proc/{child}").exists() or _state(child) == "Z")
    with s2rstore.open(path) as store:
        assert store.run("saved").key is None


def _state(process: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    return "Z"


def test_a_locked_store_is_rejected_immediately(few_pairs_store, tmp_path):
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    with locks.compute_lock(path), pytest.raises(RequestError, match="holds the compute lock"):
        save_run(path, "saved", "vanilla", {})
    with s2rstore.open(path) as store:
        assert "saved" not in store.runs


def test_a_cancelled_run_can_be_completed(few_pairs_store, tmp_path):
    path = copy_store(few_pairs_store, tmp_path / "s.s2r")
    job = save_run(path, "saved", "vanilla", {"sim": make_chain("sim", {"black": 0.5})})
    wait_for_stage(job, "forward")
    job.cancel()
    assert list(job.follow())[-1].outcome == "cancelled"
    with s2rstore.open(path) as store:
        assert store.run("saved").key is None
    arguments = ["--run", "saved", "--kinds", "activation"]
    assert main(["precompute", str(path), *arguments]) == 0
    with s2rstore.open(path) as store:
        assert store.run("saved").key is not None


def test_invalid_requests_start_no_job(few_pairs_store):
    with pytest.raises(RequestError, match="choose another name"):
        save_run(few_pairs_store, "vanilla", "vanilla", {})
    with pytest.raises(RequestError, match="runs: vanilla"):
        save_run(few_pairs_store, "saved", "nothing", {})
    with pytest.raises(RequestError, match="taken, not rendered"):
        save_run(few_pairs_store, "saved", "vanilla", {"sim": make_chain("sim", {"camera_fov": 5})})


def test_computed_runs_are_not_dropped(store_copy):
    assert not drop_run(store_copy, "vanilla")
    assert not drop_run(store_copy, "nothing")
    add_run(store_copy, "later", "vanilla", None, None, UNADJUSTED)
    assert drop_run(store_copy, "later")
    with s2rstore.open(store_copy) as store:
        assert list(store.runs) == ["vanilla", "dataaug"]


def test_json_progress_survives_a_closed_reader(moved_camera_store, tmp_path):
    path = copy_store(moved_camera_store, tmp_path / "s.s2r")
    add_run(path, "later", "perlin", None, None, UNADJUSTED)
    command = [sys.executable, "-m", "s2rtui", "precompute", str(path), "--run", "later",
               "--kinds", "feature_distance", "--progress", "json"]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert json.loads(process.stdout.readline()).keys() == {"said"}
        assert json.loads(process.stdout.readline()) == {
            "stage": "later: forward", "done": 0, "total": 8,
        }  # fmt: skip
        process.stdout.close()
        assert process.wait(timeout=120) == 0
        assert process.stderr.read() == b""
    with s2rstore.open(path) as store:
        assert store.run("later").key is not None


def test_a_failed_job_keeps_a_run_that_another_process_may_compute(store_copy, monkeypatch):
    add_run(store_copy, "saved", "vanilla", None, None, UNADJUSTED)
    program = shutil.which("false")
    assert program is not None
    monkeypatch.setattr(sys, "executable", program)
    with locks.compute_lock(store_copy):
        failed = list(precompute_job(store_copy, "saved", 3).follow())[-1]
        assert failed.outcome == "failed"
        assert "run saved stays, because another process computes" in failed.error
        with pytest.raises(StoreBusyError):
            drop_run(store_copy, "saved")
    with s2rstore.open(store_copy) as store:
        assert "saved" in store.runs
    assert list(precompute_job(store_copy, "saved", 3).follow())[-1].outcome == "failed"
    with s2rstore.open(store_copy) as store:
        assert "saved" not in store.runs
