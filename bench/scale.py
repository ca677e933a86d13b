"""Cost of user actions at 1e3 and 1e6 instances of eight runs: `python -m bench.scale STORE`.

Each store is measured in a separate process. Every change is made once to load its data, and then
several times with different values; its time is the median. Budgets apply to the wall time after a
short rest, from which a processor wakes slowly. The processor time, which depends less on other
load, and the time of changes without a rest are reported, too. "Drawn" includes the application on
a terminal of 200 x 60 that discards its input: from the change to the last escape code.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from statistics import median

from textual.drivers.headless_driver import HeadlessDriver

from bench import index_store
from bench import scale_steps as steps
from bench.budget import BudgetRow
from s2rtui.app.app import S2RApp
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import RenderOptions
from s2rtui.session import navigation
from s2rtui.session.session import Session

SIZES = (1_000, 1_000_000)
NUMBERS, DRAWN = "selection change, state and all views' numbers", "selection change, drawn"
BUDGETS = {1_000: {NUMBERS: 2.0, DRAWN: 30.0}, 1_000_000: {NUMBERS: 16.0, DRAWN: 50.0}}
_TURNS = 5
_PAUSE = 0.03
Steps = Callable[[Session, int], list[tuple[str, steps.Step]]]
Row = tuple[str, float, str]
Time = tuple[float, float]
"""Wall time and processor time in milliseconds."""
Times = dict[str, Time]
Work = Callable[[steps.Step], Time]


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Measure both sizes; their stores are built in `folder` and removed."""
    for n in SIZES:
        path = index_store.build(folder / f"{n}.s2r", n)
        command = [sys.executable, "-m", "bench.scale", str(path)]
        environment = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"}
        done = subprocess.run(
            command, check=True, stdout=subprocess.PIPE, text=True, env=environment
        )
        shutil.rmtree(path)
        for line in done.stdout.splitlines():
            name, value, unit = json.loads(line)
            yield BudgetRow(f"{n:.0e}: {name}", value, unit, BUDGETS[n].get(name))


class Sink(HeadlessDriver):
    """A terminal that counts the bytes written to it."""

    received = 0

    @property
    def is_headless(self) -> bool:
        """False, so that the application encodes its output."""
        return False

    def write(self, data: str) -> None:
        Sink.received += len(data.encode())


class Probe:
    """The application on one store, with timers and memory figures."""

    def __init__(self, path: Path) -> None:
        self.loaded = _resident()
        self.session = Session(path)
        self.app = S2RApp(self.session, RenderOptions())
        self.app.driver_class = Sink
        self.turn = 0

    async def rows(self) -> list[Row]:
        running = asyncio.create_task(self.app.run_async(headless=False, size=steps.SIZE))
        began = time.perf_counter()
        await self.settle()
        found: list[Row] = [("all views there", 1e3 * (time.perf_counter() - began), "ms")]
        memory = _resident() - self.loaded
        found.append(("memory beside the libraries, one run open", memory, "MB"))
        with self.app._context():  # timers that changes start belong to the application
            self.session.select("worst15")
            found += _spread(NUMBERS, *await self.measured(steps.changes, self.counted))
            _, awake = await self.measured(steps.changes, self.counted, 0)
            found.append((f"{NUMBERS}, one after the other", _middle(awake.values())[0], "ms"))
            before = Sink.received
            taken = await self.measured(steps.changes, self.drawn)
            found += _spread(DRAWN, *taken)
            sent = (Sink.received - before) / (_TURNS + 1) / len(taken[1])
            found.append(("selection change, bytes", sent, "bytes"))
            fresh = [
                self.drawn(lambda: self.session.dispatch(navigation.change_run, 1))
                for _ in index_store.RUNS
            ]
            found.append(("run not seen before, drawn", _middle(fresh[:-1])[0], "ms"))
            await self.settle()
            _, after = await self.measured(steps.moves, self.drawn)
            found += [(f"{name}, drawn", passed, "ms") for name, (passed, _) in after.items()]
        memory = _resident() - self.loaded
        found.append(("memory beside the libraries, all runs seen", memory, "MB"))
        self.app.exit()
        await running
        return found

    async def settle(self) -> None:
        """Wait until all drawing and loading is finished."""
        limit = time.monotonic() + 120
        while not (self.app.is_running and self.app.settled):
            assert time.monotonic() < limit, "the feeds never come to rest"
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.1)

    async def measured(
        self, series: Steps, work: Work, pause: float = _PAUSE
    ) -> tuple[Times, Times]:
        """First time and median of the others for each kind of change, each after a rest."""
        taken: dict[str, list[Time]] = defaultdict(list)
        start, self.turn = self.turn, self.turn + _TURNS + 1
        for turn in range(start, self.turn):
            for name, step in series(self.session, turn):
                taken[name].append(work(step))
                await asyncio.sleep(pause)
            await self.settle()
        return (
            {name: times[0] for name, times in taken.items()},
            {name: _middle(times[1:]) for name, times in taken.items()},
        )

    def counted(self, step: steps.Step) -> Time:
        """Make a change and compute the numbers of all views."""

        def work() -> None:
            step()
            steps.numbers(self.app.updater.scene)

        return _clocked(work)

    def drawn(self, step: steps.Step) -> Time:
        """Make a change and wait until everything is drawn and written."""

        def work() -> None:
            step()
            self.app.updater.refresh()
            screen = self.app.screen
            screen._compositor.update_widgets(set(self.app.query(PlotView)))
            screen._compositor_refresh()

        return _clocked(work)


def _clocked(work: Callable[[], None]) -> Time:
    began, busy = time.perf_counter(), time.thread_time()
    work()
    return 1e3 * (time.perf_counter() - began), 1e3 * (time.thread_time() - busy)


def _middle(times: Iterable[Time]) -> Time:
    passed, busy = zip(*times, strict=True)
    return median(passed), median(busy)


def _spread(name: str, first: Times, after: Times) -> list[Row]:
    """The median over all kinds of change, the slowest kind, and the slowest first change."""
    slowest, new = max(after, key=after.__getitem__), max(first, key=first.__getitem__)
    passed, busy = _middle(after.values())
    return [
        (name, passed, "ms"),
        ("... processor time", busy, "ms"),
        (f"... slowest: {slowest}", after[slowest][0], "ms"),
        ("... processor time of the slowest", max(times[1] for times in after.values()), "ms"),
        (f"... first time, slowest: {new}", first[new][0], "ms"),
    ]


def _resident() -> float:
    """Resident memory of this process in MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text())
    return int(found[1]) / 1024 if found else float("nan")


def main() -> None:
    for row in asyncio.run(Probe(Path(sys.argv[1])).rows()):
        print(json.dumps(row), file=sys.__stdout__, flush=True)


if __name__ == "__main__":
    main()
