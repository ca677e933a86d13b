"""Background threads run the newest waiting job; delayed calls run, cancelled ones never."""

import asyncio
import gc
import subprocess
import sys
import threading
import weakref
from itertools import count

import pytest
from textual import _time

from bench.support.processes import wait_until
from s2rtui.app.pilot import settle
from s2rtui.jobs import background_thread
from s2rtui.jobs.background_thread import LatestOnlyWorker
from s2rtui.terminal.textual_compat import call_after
from tests.support.application import make_app, running


class BlockingJob:
    """A job that blocks until `open` is set; `done` lists the finished jobs in order."""

    def __init__(self) -> None:
        self.entered, self.open = threading.Event(), threading.Event()
        self.done: list[str] = []

    def wait(self) -> None:
        self.entered.set()
        assert self.open.wait(60)
        self.note("first")

    def note(self, name: str) -> None:
        self.done.append(name)


def test_only_the_newest_waiting_job_runs():
    blocking, worker = BlockingJob(), LatestOnlyWorker("lane")
    worker.put(blocking.wait)
    assert blocking.entered.wait(60)
    for name in "abcd":
        worker.put(lambda name=name: blocking.note(name))
    blocking.open.set()
    assert background_thread.wait_until_idle(60)
    assert blocking.done == ["first", "d"]
    worker.end()


def test_ending_a_worker_drops_waiting_jobs_and_runs_its_last_job():
    blocking, worker = BlockingJob(), LatestOnlyWorker("lane")
    worker.put(blocking.wait)
    assert blocking.entered.wait(60)
    worker.put(lambda: blocking.note("waiting"))
    worker.end(lambda: blocking.note("last"))
    assert blocking.done == []  # the end waits for no job
    worker.put(lambda: blocking.note("late"))
    blocking.open.set()
    assert background_thread.wait_until_idle(60)
    assert blocking.done == ["first", "last"]


def test_a_worker_that_never_started_runs_no_last_job():
    LatestOnlyWorker("lane").end(lambda: pytest.fail("the last job runs"))


def test_the_process_exits_while_a_job_runs():
    code = (
        "import sys, time; from s2rtui.jobs import background_thread\n"
        "background_thread.run_in_thread('endless', lambda: time.sleep(999)); print('told')\n"
        "sys.exit(background_thread.end_process(70))"
    )
    completed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120
    )
    assert (completed.returncode, completed.stdout, completed.stderr) == (70, "told\n", "")


def test_an_idle_worker_keeps_no_reference_to_its_jobs():
    worker, event = LatestOnlyWorker("lane"), threading.Event()
    reference = weakref.ref(event)
    worker.put(event.set)
    del event
    assert wait_until(lambda: worker.idle)
    gc.collect()
    assert reference() is None
    worker.end()


def test_a_worker_survives_a_failing_job():
    errors: list[Exception] = []
    blocking, worker = BlockingJob(), LatestOnlyWorker("lane", errors.append)
    error = ZeroDivisionError("of the work")

    def failing_job() -> None:
        blocking.wait()
        raise error

    worker.put(failing_job)
    assert blocking.entered.wait(60)
    worker.put(lambda: blocking.note("after"))
    assert not worker.idle
    blocking.open.set()
    assert wait_until(lambda: worker.idle)
    assert blocking.done == ["first", "after"]
    assert errors == [error]
    worker.end()


async def test_images_load_although_the_clock_jumps(tiny_store, monkeypatch):
    app, ticks, clock = make_app(tiny_store), count(), _time.get_time
    async with app.run_test(size=(120, 40)) as pilot:
        monkeypatch.setattr(_time, "get_time", lambda: clock() + 0.01 * next(ticks))
        await asyncio.wait_for(settle(app, pilot), 20)
        assert app.loaded.pictures is not None


async def test_a_cancelled_call_never_runs(tiny_store):
    calls: list[str] = []
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        call_after(app, 0, lambda: calls.append("dropped")).cancel()
        call_after(app, 0, lambda: calls.append("kept"))
        async with asyncio.timeout(20):
            while not calls:
                await pilot.pause()
    assert calls == ["kept"]
