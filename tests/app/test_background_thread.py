"""Work in threads of their own: of what waits only the newest is done, and nobody waits for it."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
import time
import weakref

from s2rtui.jobs import background_thread
from s2rtui.jobs.background_thread import LatestOnlyWorker


class Gate:
    """Work that waits until it is let through; `done` names what was done, in order."""

    def __init__(self) -> None:
        self.entered, self.open = threading.Event(), threading.Event()
        self.done: list[str] = []
        self.threads: set[str] = set()

    def wait(self) -> None:
        self.entered.set()
        assert self.open.wait(10)
        self.note("first")

    def note(self, name: str) -> None:
        self.threads.add(threading.current_thread().name)
        self.done.append(name)


def test_of_what_waits_only_the_newest_is_done() -> None:
    gate, lane = Gate(), LatestOnlyWorker("lane")
    lane.put(gate.wait)
    assert gate.entered.wait(10)
    for name in "abcd":
        lane.put(lambda name=name: gate.note(name))
    gate.open.set()
    assert background_thread.wait_until_idle(10)
    assert gate.done == ["first", "d"]
    assert gate.threads == {"lane"}
    lane.end()


def test_a_lane_that_ends_drops_what_waits_and_does_its_last() -> None:
    gate, lane = Gate(), LatestOnlyWorker("lane")
    lane.put(gate.wait)
    assert gate.entered.wait(10)
    lane.put(lambda: gate.note("waiting"))
    began = time.monotonic()
    lane.end(lambda: gate.note("last"))
    assert time.monotonic() - began < 0.5
    lane.put(lambda: gate.note("late"))
    gate.open.set()
    assert background_thread.wait_until_idle(10)
    assert gate.done == ["first", "last"]


def test_a_lane_that_never_began_has_no_last() -> None:
    done: list[str] = []
    LatestOnlyWorker("lane").end(lambda: done.append("last"))
    assert done == []


def test_lanes_do_not_wait_for_each_other() -> None:
    gate, busy, other = Gate(), LatestOnlyWorker("busy"), LatestOnlyWorker("other")
    finished = threading.Event()
    busy.put(gate.wait)
    assert gate.entered.wait(10)
    other.put(finished.set)
    assert finished.wait(10)
    gate.open.set()
    assert background_thread.wait_until_idle(10)


def test_a_process_ends_around_what_is_under_way() -> None:
    code = (
        "import sys, time; from s2rtui.jobs import background_thread\n"
        "background_thread.run_in_thread('endless', lambda: time.sleep(60)); print('told')\n"
        "sys.exit(background_thread.end_process(70))"
    )
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=30)
    assert (done.returncode, done.stdout, done.stderr) == (70, "told\n", "")
    assert time.monotonic() - began < 10


class Held:
    """Something that work is made with."""

    def work(self) -> None:
        """Nothing."""


def test_a_lane_at_rest_holds_nothing_of_what_it_did() -> None:
    lane, held = LatestOnlyWorker("lane"), Held()
    gone = weakref.ref(held)
    lane.put(held.work)
    del held
    deadline = time.monotonic() + 10
    while not lane.idle:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    gc.collect()
    assert gone() is None
    lane.end()


def test_a_lane_outlives_what_its_work_raises() -> None:
    told: list[Exception] = []
    gate, lane = Gate(), LatestOnlyWorker("lane", told.append)
    fault = ZeroDivisionError("of the work")

    def work() -> None:
        gate.wait()
        raise fault

    lane.put(work)
    assert gate.entered.wait(10)
    lane.put(lambda: gate.note("after"))
    assert not lane.idle
    gate.open.set()
    deadline = time.monotonic() + 10
    while not lane.idle:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert gate.done == ["first", "after"]
    assert told == [fault]
    lane.end()
